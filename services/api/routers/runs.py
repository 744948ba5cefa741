"""Runs: plan, create, list, read, follow, stop, go on, delete."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response, status

from services.api.dependencies import (
    ContextDependency,
    Cursor,
    Limit,
    RunId,
    decode_cursor,
    encode_cursor,
    wake_control,
)
from services.api.schemas import Failure, Progress, RunDetail, RunPage, RunRead
from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.pipeline import lifecycle
from valerie.pipeline.plan import plan_run
from valerie.pipeline.submit import submit
from valerie.runs.planning import Plan
from valerie.runs.spec import RunSpec, parse
from valerie.runs.states import RunState

router = APIRouter(prefix="/v1", tags=["runs"])

_EXAMPLE = {
    "name": "two lists of the paper",
    "asset": "urban-street",
    "parameters": [
        ["p1", "scene.person-1.pos.x", "FLOAT", 0.0, 20.0],
        ["p2", "scene.person-1.pos.y", "FLOAT", 0.0, 10.0],
    ],
    "vary": [["p1", "HOMOGENEOUS", 1.5, 5.5, 1.0], ["p2", "HOMOGENEOUS", 4.0, 5.0, 1.0]],
    "functions": ["deeplabv3plus-small"],
}
_SPEC_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "description": "A validation-run spec as JSON or YAML (docs/run-spec.schema.json).",
        "content": {
            "application/json": {"schema": {"type": "object"}, "example": _EXAMPLE},
            "application/yaml": {"schema": {"type": "string"}},
        },
    }
}


async def _spec(request: Request) -> RunSpec:
    return parse(await request.body())


@router.post("/plan", openapi_extra=_SPEC_BODY, summary="What a spec would cost; stores nothing")
async def plan(request: Request, context: ContextDependency) -> Plan:
    return plan_run(context, await _spec(request))


@router.post(
    "/runs",
    status_code=status.HTTP_202_ACCEPTED,
    openapi_extra=_SPEC_BODY,
    summary="Submit a run",
    response_description="accepted; Location names the run",
)
async def create(
    request: Request,
    response: Response,
    context: ContextDependency,
    idempotency_key: Annotated[
        str | None, Header(min_length=1, max_length=200, description="a repeated POST with it makes no second run")
    ] = None,
) -> RunRead:
    run_id = submit(context, await _spec(request), idempotency_key=idempotency_key)
    wake_control(request)
    response.headers["Location"] = f"/v1/runs/{run_id}"
    with reading(context.engine) as connection:
        return RunRead.model_validate(runs.get(connection, run_id))


@router.get("/runs", summary="Runs, newest first")
def list_runs(
    context: ContextDependency,
    limit: Limit = 50,
    cursor: Cursor = None,
    state: Annotated[RunState | None, Query(description="only runs in this state")] = None,
) -> RunPage:
    before = decode_cursor(cursor, str, str)
    with reading(context.engine) as connection:
        rows = runs.page(
            connection,
            limit=limit + 1,
            before=None if before is None else (datetime.fromisoformat(before[0]), before[1]),
            state=state,
        )
    more = len(rows) > limit
    items = [RunRead.model_validate(row) for row in rows[:limit]]
    return RunPage(items=items, next=encode_cursor(items[-1].created_at.isoformat(), items[-1].id) if more else None)


@router.get("/runs/{run_id}", summary="One run with its spec")
def read(run_id: RunId, context: ContextDependency) -> RunDetail:
    with reading(context.engine) as connection:
        return RunDetail.model_validate(runs.get(connection, run_id))


@router.get("/runs/{run_id}/progress", summary="How far a run is; one cheap row")
def progress(run_id: RunId, context: ContextDependency) -> Progress:
    with reading(context.engine) as connection:
        return Progress.model_validate(lifecycle.progress(connection, run_id))


@router.get("/runs/{run_id}/failures", summary="What failed for good, with stage, error and attempts")
def failures(run_id: RunId, context: ContextDependency, limit: Limit = 100) -> list[Failure]:
    with reading(context.engine) as connection:
        runs.get(connection, run_id)
        return [Failure.model_validate(one) for one in results.failures(connection, run_id, limit=limit)]


@router.get("/runs/{run_id}/rejections", summary="Rejected variants by reason")
def rejections(run_id: RunId, context: ContextDependency) -> dict[str, int]:
    with reading(context.engine) as connection:
        runs.get(connection, run_id)
        return runs.rejections(connection, run_id)


@router.post("/runs/{run_id}/cancel", summary="Stop a run; what is done stays")
def cancel(run_id: RunId, context: ContextDependency) -> RunRead:
    lifecycle.cancel(context, run_id)
    return _after(context, run_id)


@router.post("/runs/{run_id}/resume", summary="Let a paused or cancelled run go on")
def resume(run_id: RunId, request: Request, context: ContextDependency) -> RunRead:
    lifecycle.resume(context, run_id)
    wake_control(request)
    return _after(context, run_id)


@router.post("/runs/{run_id}/retry", summary="Try again what failed for good")
def retry(run_id: RunId, request: Request, context: ContextDependency) -> RunRead:
    lifecycle.retry(context, run_id)
    wake_control(request)
    return _after(context, run_id)


@router.delete(
    "/runs/{run_id}", status_code=status.HTTP_204_NO_CONTENT, summary="Delete a run; `gc` frees its products"
)
def delete(run_id: RunId, context: ContextDependency) -> None:
    lifecycle.delete(context, run_id)


def _after(context: Any, run_id: str) -> RunRead:
    with reading(context.engine) as connection:
        return RunRead.model_validate(runs.get(connection, run_id))
