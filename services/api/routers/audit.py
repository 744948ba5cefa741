"""The audit log, for admins."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Query

from services.api.dependencies import ContextDependency, Limit
from services.api.openapi import problems
from services.api.schemas.tokens import AuditRead
from valerie.db import audit
from valerie.db.engine import reading

router = APIRouter(prefix="/v1", tags=["audit"])


@router.get("/audit", responses=problems(422), summary="The audit log, oldest rows first")
def read_audit(
    context: ContextDependency,
    after: Annotated[int, Query(ge=0, le=2**53, description="number of the last row that was read")] = 0,
    limit: Limit = 100,
) -> list[AuditRead]:
    with reading(context.engine) as connection:
        rows = audit.entries(connection, after=after, limit=limit)
        return [AuditRead.model_validate({"number": number, **asdict(entry)}) for number, entry in rows]
