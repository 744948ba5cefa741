"""Rights and quotas of the caller; tokens of the API and the audit log, for admins."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Final

from fastapi import APIRouter, Path, Query, Request

from services.api.dependencies import ContextDependency, Limit, OwnerDependency, ProjectDependency
from services.api.openapi import gives, problems
from services.api.roles import refused
from services.api.schemas.tokens import AccessRead, AuditRead, QuotaRead, TokenIssued, TokenRead
from valerie.access import OPERATOR, Caller
from valerie.db import audit, tokens
from valerie.db.engine import reading
from valerie.pipeline.control.quotas import quotas_of
from valerie.pipeline.control.tokens import NAME, TokenRequest, issue, revoke
from valerie.settings import LOOPBACK, Settings

router = APIRouter(prefix="/v1", tags=["tokens"])

#: Headers that a proxy adds.
_OF_PROXIES: Final = frozenset({"forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-real-ip"})


@router.get("/access", responses=problems(422), summary="The role of the caller, and what it may not do")
def access(request: Request, context: ContextDependency) -> AccessRead:
    caller: Caller = request.state.caller
    folder = context.settings.data_dir
    told = _is_operator_here(request) and folder != Settings.model_fields["data_dir"].default.absolute()
    return AccessRead(
        role=caller.role,
        project=caller.project,
        refused=refused(caller.role),
        data_dir=str(folder) if told else "",
    )


def _is_operator_here(request: Request) -> bool:
    """Return True if the operator asks on the machine of the server, not through a proxy."""
    return (
        request.state.caller is OPERATOR
        and request.client is not None
        and {request.client.host, request.url.hostname} <= {*LOOPBACK}
        and _OF_PROXIES.isdisjoint(request.headers)
    )


@router.get("/quotas", responses=problems(422), summary="The caller's quotas, and its project's; for the operator all")
def read_quotas(context: ContextDependency, owner: OwnerDependency, project: ProjectDependency) -> list[QuotaRead]:
    with reading(context.engine) as connection:
        quotas = quotas_of(connection, context.settings, owner, project)
    return [QuotaRead.model_validate(quota) for quota in quotas]


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
def create(request: TokenRequest, context: ContextDependency) -> TokenIssued:
    token, secret = issue(context, request)
    return TokenIssued.model_validate({**asdict(token), "secret": secret})


@router.delete("/tokens/{name}", status_code=204, responses=problems(404, 422), summary="Revoke a token at once")
def remove(
    name: Annotated[str, Path(pattern=NAME, description="name of a token", examples=["nightly"])],
    context: ContextDependency,
) -> None:
    revoke(context, name)


@router.get("/audit", responses=problems(422), summary="The audit log, oldest rows first")
def read_audit(
    context: ContextDependency,
    after: Annotated[int, Query(ge=0, le=2**53, description="number of the last row that was read")] = 0,
    limit: Limit = 100,
) -> list[AuditRead]:
    with reading(context.engine) as connection:
        rows = audit.entries(connection, after=after, limit=limit)
        return [AuditRead.model_validate({"number": number, **asdict(entry)}) for number, entry in rows]
