"""Rights and quotas of the caller."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter, Request

from services.api.dependencies import ContextDependency, OwnerDependency, ProjectDependency
from services.api.openapi import problems
from services.api.roles import refused
from services.api.schemas.tokens import AccessRead, QuotaRead
from valerie.access import OPERATOR, Caller
from valerie.db.engine import reading
from valerie.pipeline.control.quotas import quotas_of
from valerie.settings import LOOPBACK, Settings

router = APIRouter(prefix="/v1", tags=["access"])

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
        scopes=list(caller.scopes),
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
