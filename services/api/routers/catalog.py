"""What can be asked for: assets with their parameters, render engines, functions under test; and who is at work."""

from __future__ import annotations

import time
from typing import Annotated, Any

from fastapi import APIRouter, Path

from services.api.dependencies import ContextDependency
from services.api.schemas import WorkerRead
from valerie.db import processes
from valerie.db.engine import reading
from valerie.pipeline import catalog

router = APIRouter(prefix="/v1", tags=["catalog"])

Name = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")]


@router.get("/assets", summary="Assets that a spec may name")
def assets(context: ContextDependency) -> list[dict[str, Any]]:
    return catalog.assets(context.settings)


@router.get("/assets/{name}", summary="An asset with its parameters")
def asset(name: Name, context: ContextDependency) -> dict[str, Any]:
    return catalog.asset(context.settings, name)


@router.get("/renderers", summary="Render engines, and the numeric classes in which living workers offer them")
def renderers(context: ContextDependency) -> list[dict[str, Any]]:
    return catalog.renderers(context)


@router.get("/functions", summary="Functions under test with their cards")
def functions(context: ContextDependency) -> list[dict[str, Any]]:
    return catalog.functions(context)


@router.get("/workers", summary="Worker processes that are alive")
def workers(context: ContextDependency) -> list[WorkerRead]:
    with reading(context.engine) as connection:
        return [WorkerRead.model_validate(row) for row in processes.workers(connection, now=time.time())]
