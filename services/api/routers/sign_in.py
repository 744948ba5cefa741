"""Sign-in by the operator's OpenID provider. These endpoints need no token, since they give one."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter, Depends, Request

from services.api.dependencies import ContextDependency, only_declared_queries
from services.api.identity_provider import IdentityProvider
from services.api.openapi import problems
from services.api.schemas.tokens import SignInOffer, SignInRequest, TokenIssued
from valerie.errors import NotFound
from valerie.pipeline.control.tokens import issue_to

router = APIRouter(prefix="/v1", tags=["access"], dependencies=[Depends(only_declared_queries)])


@router.get("/sign-in", responses=problems(422), summary="Where a browser signs in")
def offer(request: Request, context: ContextDependency) -> SignInOffer:
    provider: IdentityProvider | None = request.app.state.identity_provider
    if provider is None:
        return SignInOffer(page=None, client=None)
    return SignInOffer(page=provider.page, client=context.settings.oidc_client)


@router.post("/sign-in", status_code=201, responses=problems(404, 413, 422), summary="Get a token as a provider's user")
def sign_in(proof: SignInRequest, request: Request, context: ContextDependency) -> TokenIssued:
    provider: IdentityProvider | None = request.app.state.identity_provider
    if provider is None:
        raise NotFound("OpenID provider", "for this server (VALERIE_OIDC_ISSUER)")
    id_token = proof.id_token or provider.redeem(proof.code, proof.verifier, proof.redirect_uri)
    identity = provider.identity(id_token, nonce=None if proof.id_token else proof.nonce)
    token, secret = issue_to(context, *identity, hours=context.settings.oidc_hours)
    return TokenIssued.model_validate({**asdict(token), "secret": secret})
