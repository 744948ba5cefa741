"""The area of the API that each endpoint belongs to, and the tokens that are limited to some areas."""

from __future__ import annotations

from collections.abc import Collection
from enum import Enum
from http import HTTPStatus

from fastapi import Request
from starlette.exceptions import HTTPException

from valerie.access import Area, Caller


def area_of(tags: Collection[str | Enum]) -> Area | None:
    """Return the area of an endpoint with these tags; None if it has not exactly one tag, or one that is no area."""
    (tag,) = tags if len(tags) == 1 else ("",)
    return Area(tag) if tag in list(Area) else None


def require_scope(request: Request) -> None:
    """Refuse a request whose token has scopes, unless one of them is the area of the endpoint.

    Raises:
        HTTPException: 403, with the scope that is needed and those of the token.
    """
    caller: Caller | None = request.state.caller
    if caller is None or not caller.scopes:
        return
    area = area_of(request.scope["route"].tags)
    if area not in caller.scopes:
        needed = "a token without scopes" if area is None else f"the scope {area}"
        raise HTTPException(
            HTTPStatus.FORBIDDEN, f"this needs {needed}; the token's scopes: {', '.join(caller.scopes)}"
        )


def require_within(caller: Caller, scopes: Collection[str]) -> None:
    """Refuse to issue a token that reaches more areas than the caller.

    Raises:
        HTTPException: 403, with the caller's scopes.
    """
    if caller.scopes and not (scopes and {*scopes} <= {*caller.scopes}):
        limit = ", ".join(caller.scopes)
        raise HTTPException(
            HTTPStatus.FORBIDDEN, f"scopes: a token with scopes issues tokens within them; limit: {limit}"
        )
