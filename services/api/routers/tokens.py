"""Tokens of the API, for admins."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Path, Request

from services.api.dependencies import ContextDependency
from services.api.openapi import gives, problems
from services.api.schemas.tokens import TokenIssued, TokenRead
from services.api.scopes import require_within
from valerie.db import tokens
from valerie.db.engine import reading
from valerie.pipeline.control.tokens import NAME, TokenRequest, issue, revoke

router = APIRouter(prefix="/v1", tags=["tokens"])


@router.get("/tokens", responses=problems(422), summary="All tokens without their secrets")
def list_tokens(context: ContextDependency) -> list[TokenRead]:
    with reading(context.engine) as connection:
        return [TokenRead.model_validate(row) for row in tokens.listed(connection)]


@router.post(
    "/tokens",
    status_code=201,
    responses={**problems(409, 413, 422), **gives(201, ("name", "/v1/tokens", "/name"))},
    summary="Issue a token; only this answer has the secret",
)
def create(new: TokenRequest, request: Request, context: ContextDependency) -> TokenIssued:
    require_within(request.state.caller, new.scopes)
    token, secret = issue(context, new)
    return TokenIssued.model_validate({**asdict(token), "secret": secret})


@router.delete("/tokens/{name}", status_code=204, responses=problems(404, 422), summary="Revoke a token at once")
def remove(
    name: Annotated[str, Path(pattern=NAME, description="name of a token", examples=["nightly"])],
    context: ContextDependency,
) -> None:
    revoke(context, name)
