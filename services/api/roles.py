"""The role that each endpoint needs."""

from __future__ import annotations

from http import HTTPStatus
from typing import Final

from fastapi import Request
from starlette.exceptions import HTTPException

from valerie.access import Role

#: Endpoints that change something or compute, and those that not everybody may read. All others only read.
ROLES: Final = {
    "POST /v1/plan": Role.VIEWER,
    "POST /v1/draft": Role.VIEWER,
    "POST /v1/sign-in": Role.VIEWER,
    "POST /v1/studies/plan": Role.VIEWER,
    "POST /v1/preview": Role.RUNNER,
    "POST /v1/runs": Role.RUNNER,
    "POST /v1/runs/{run_id}/cancel": Role.RUNNER,
    "POST /v1/runs/{run_id}/resume": Role.RUNNER,
    "POST /v1/runs/{run_id}/retry": Role.RUNNER,
    "DELETE /v1/runs/{run_id}": Role.RUNNER,
    "POST /v1/runs/{run_id}/archive": Role.ADMIN,
    "POST /v1/runs/{run_id}/unarchive": Role.ADMIN,
    "PUT /v1/runs/{run_id}/marks": Role.RUNNER,
    "POST /v1/studies": Role.RUNNER,
    "POST /v1/studies/{study_id}/accept": Role.RUNNER,
    "POST /v1/studies/{study_id}/mode": Role.RUNNER,
    "POST /v1/studies/{study_id}/stop": Role.RUNNER,
    "POST /v1/studies/{study_id}/resume": Role.RUNNER,
    "POST /v1/selections": Role.RUNNER,
    "DELETE /v1/selections/{name}": Role.RUNNER,
    "POST /v1/functions": Role.RUNNER,
    "DELETE /v1/functions/{reference}": Role.RUNNER,
    "PUT /v1/frames/{frame_id}/prediction": Role.RUNNER,
    "GET /v1/audit": Role.ADMIN,
    "GET /v1/tokens": Role.ADMIN,
    "POST /v1/tokens": Role.ADMIN,
    "DELETE /v1/tokens/{name}": Role.ADMIN,
}


def needed(method: str, path: str) -> Role:
    """Return the role that an endpoint needs.

    Raises:
        KeyError: the endpoint may change something and declares no role.
    """
    endpoint = f"{method} {path}"
    return ROLES.get(endpoint, Role.VIEWER) if method == "GET" else ROLES[endpoint]


def changes_nothing(method: str, path: str) -> bool:
    """Return True if a request only reads or computes."""
    return method in ("GET", "HEAD", "OPTIONS") or ROLES.get(f"{method} {path}") is Role.VIEWER


def refused(role: Role) -> list[str]:
    """Return the endpoints that a role may not use, as `ROLES` names them."""
    return [endpoint for endpoint, least in ROLES.items() if not role.includes(least)]


def require_role(request: Request) -> None:
    """Refuse a request whose token lacks the role of the endpoint.

    Raises:
        HTTPException: 403, with both roles.
    """
    role, least = request.state.caller.role, needed(request.method, request.scope["route"].path)
    if not role.includes(least):
        raise HTTPException(HTTPStatus.FORBIDDEN, f"this needs the role {least}; the token's role: {role}")
