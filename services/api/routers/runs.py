"""Runs: plan, submit, list, read, follow, cancel, resume, retry, delete."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Final, NamedTuple

from fastapi import APIRouter, Depends, Header, Query, Request, Response, status

from services.api.dependencies import (
    Body,
    ContextDependency,
    Limit,
    OwnerDependency,
    ProjectDependency,
    RunId,
    SeenDependency,
    next_page,
    wake_control,
)
from services.api.openapi import document_body, example, gives, problems
from services.api.schemas.base import CAMERAS, DIGEST
from services.api.schemas.runs import SPEC, Failure, Progress, RelativeRead, RunDetail, RunPage, RunRead
from services.api.transfer import IfNoneMatch, send_page
from valerie.db import marks, results, runs, variants
from valerie.db.archives import reading_run
from valerie.db.engine import database_moment, reading
from valerie.errors import InvalidInput
from valerie.pipeline.base.context import Context
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.archiving import archive_run, restore_rows
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.control.submit import submit
from valerie.plain import JsonObject
from valerie.runs.forecasting.plan import Plan
from valerie.runs.moments import Moment, moment_text
from valerie.runs.products.states import Priority, RunState
from valerie.runs.resolving.spec import RunSpec, parse

router = APIRouter(prefix="/v1", tags=["runs"])

_YAML = "name: first\nasset: urban-street\nvary:\n  - [person-1.pos.x, HOMOGENEOUS, 1.5, 5.5, 1.0]\n"
SPEC_BODY: Final = document_body(
    "A validation-run spec as JSON or YAML; `valerie new` writes one with comments.", example=SPEC, yaml=_YAML
)
#: The plan of `SPEC`.
PLAN: Final[JsonObject] = {
    "name": SPEC["name"],
    "asset": "urban-street",
    "spec_digest": DIGEST,
    "variants": 10,
    "accepted": 10,
    "rejected": {},
    "cameras": CAMERAS,
    "frames": 30,
    "evaluations": 30,
    "renders": 63,
    "inferences": 30,
    "products": [
        {
            "kind": "layer",
            "maker": "raster",
            "needed": 30,
            "present": 0,
            "cpu_seconds": 10.2,
            "bytes": 1900000,
            "basis": "shipped",
        }
    ],
    "cpu_seconds": 41.5,
    "bytes": 24000000,
    "cost_basis": "shipped table: layer raster",
    "first": [{"index": 0, "values": {"p1": 1.5, "p2": 4.0}, "rejection": None}],
    "last": [{"index": 9, "values": {"p1": 5.5, "p2": 5.0}, "rejection": None}],
    "units": {"p1": "m", "p2": "m"},
    "estimated": False,
    "sample": None,
    "warnings": [],
    "notes": [],
}
_OF_RUN = problems(404, 422)
_OF_CHANGE = problems(404, 409, 422)


def gives_run(status: int, pointer: str) -> dict[int | str, JsonObject]:
    """Return ``responses=`` of an answer with a run's id at a JSON pointer."""
    return gives(status, ("run_id", "/v1/runs", pointer), ("run", "/v1/explore", pointer))


def _spec(body: Body) -> RunSpec:
    # Runs in a thread, so that a large document does not delay other requests.
    return parse(body)


Spec = Annotated[RunSpec, Depends(_spec)]


class _Urgency(NamedTuple):
    priority: Priority
    deadline: datetime | None


def _urgency(
    context: ContextDependency,
    priority: Annotated[
        Priority,
        Query(description="a high run gets four times the work of a normal one of its owner, a low one a quarter"),
    ] = Priority.NORMAL,
    deadline: Annotated[
        Moment | None,
        Query(
            description="when it should be done; UTC unless it names a time zone. Among the runs of its owner, it gets more of "
            "the work as the time gets short, at most eight times",
            examples=["2099-12-01T06:00:00Z"],
        ),
    ] = None,
) -> _Urgency:
    if deadline is not None:
        with reading(context.engine) as connection:
            now = database_moment(connection)
        if deadline <= now:
            limit = f"after {moment_text(now)}"
            raise InvalidInput("the deadline has passed", field="deadline", value=moment_text(deadline), limit=limit)
    return _Urgency(priority, deadline)


@router.post(
    "/plan",
    openapi_extra=SPEC_BODY,
    responses={**problems(413, 422), **example(PLAN)},
    summary="Size and cost of a run before it is submitted; stores nothing",
)
def plan(spec: Spec, context: ContextDependency, owner: OwnerDependency, project: ProjectDependency) -> Plan:
    return plan_run(context, spec, owner=owner, project=project)


@router.post(
    "/runs",
    status_code=status.HTTP_202_ACCEPTED,
    openapi_extra=SPEC_BODY,
    responses={**problems(404, 409, 413, 422, 507), **gives_run(202, "/id")},
    summary="Submit a run",
    response_description="accepted; Location names the run",
)
def create(
    spec: Spec,
    request: Request,
    response: Response,
    context: ContextDependency,
    owner: OwnerDependency,
    project: ProjectDependency,
    urgency: Annotated[_Urgency, Depends(_urgency)],
    idempotency_key: Annotated[
        str | None,
        Header(
            pattern=r"^[\x21-\x7e][\x20-\x7e]{0,199}$",
            description="a repeated POST with the same key makes no second run; with another spec it is refused (409)",
            examples=["4be1f0d2-first-run"],
        ),
    ] = None,
) -> RunRead:
    run_id = submit(
        context,
        spec,
        idempotency_key=idempotency_key,
        priority=urgency.priority,
        deadline=urgency.deadline,
        owner=owner,
        project=project,
    )
    wake_control(request)
    response.headers["Location"] = f"/v1/runs/{run_id}"
    return _read(context, run_id)


@router.get(
    "/runs",
    responses={**problems(422), **gives_run(200, "/items/0/id")},
    response_model=RunPage,
    summary="Runs, newest first",
)
def list_runs(
    request: Request,
    context: ContextDependency,
    project: ProjectDependency,
    limit: Limit = 50,
    seen: SeenDependency = None,
    state: Annotated[RunState | None, Query(description="only runs in this state", examples=["running"])] = None,
    tag: Annotated[
        str | None,
        Query(max_length=40, pattern=r"^[^\x00]*$", description="only runs that carry it", examples=["night"]),
    ] = None,
    if_none_match: IfNoneMatch = None,
) -> Response:
    with reading(context.engine) as connection:
        rows = runs.page(connection, limit=limit + 1, before=seen, state=state, tag=tag, project=project)
        tags = marks.tags_of_runs(connection, [row.id for row in rows])
    page = RunPage(items=[_run(row, tags.get(row.id, [])) for row in rows[:limit]], next=next_page(rows, limit))
    return send_page(page, known=if_none_match, encodings=request.headers.get("accept-encoding"))


@router.get("/runs/{run_id}", responses=_OF_RUN, summary="One run with its spec")
def read(run_id: RunId, context: ContextDependency) -> RunDetail:
    with reading(context.engine) as connection:
        row = runs.get(connection, run_id)
        tags = marks.tags_of_runs(connection, [run_id])
    return RunDetail(**_run(row, tags.get(run_id, [])).model_dump(), spec=row.spec.model_dump(mode="json"))


@router.get("/runs/{run_id}/progress", responses=_OF_RUN, summary="Progress of a run; cheap to poll")
def progress(run_id: RunId, context: ContextDependency) -> Progress:
    with reading(context.engine) as connection:
        return Progress.model_validate(lifecycle.progress(connection, run_id))


@router.get(
    "/runs/{run_id}/failures",
    responses=_OF_RUN,
    summary="Products that failed for good, with stage, error and attempts",
)
def failures(run_id: RunId, context: ContextDependency, limit: Limit = 100) -> list[Failure]:
    with reading_run(context.engine, run_id) as connection:
        runs.require(connection, run_id)
        failed = results.failures(connection, run_id, limit=limit)
    return [
        Failure(
            variant_index=link.frame.variant,
            camera_index=link.frame.camera,
            time_index=link.frame.time,
            digest=link.digest,
            kind=link.kind,
            error=link.error,
        )
        for link in failed
    ]


@router.get(
    "/runs/{run_id}/rejections",
    responses={**_OF_RUN, **example({"person-1 stands inside car-3": 2})},
    summary="Number of rejected variants by reason",
)
def rejections(run_id: RunId, context: ContextDependency) -> dict[str, int]:
    with reading_run(context.engine, run_id) as connection:
        runs.require(connection, run_id)
        return variants.rejections(connection, run_id)


@router.get(
    "/runs/{run_id}/lineage",
    responses=_OF_RUN,
    summary="The runs that this one descends from, and all that descend from the oldest of them, oldest first",
)
def lineage(run_id: RunId, context: ContextDependency, project: ProjectDependency) -> list[RelativeRead]:
    with reading(context.engine) as connection:
        relatives = runs.lineage(connection, run_id, project=project)
    return [RelativeRead.model_validate(relative) for relative in relatives]


@router.post("/runs/{run_id}/cancel", responses=_OF_CHANGE, summary="Cancel a run; its results so far stay")
def cancel(run_id: RunId, context: ContextDependency) -> RunRead:
    lifecycle.cancel(context, run_id)
    return _read(context, run_id)


@router.post("/runs/{run_id}/resume", responses=_OF_CHANGE, summary="Resume a paused or cancelled run")
def resume(run_id: RunId, request: Request, context: ContextDependency) -> RunRead:
    lifecycle.resume(context, run_id)
    wake_control(request)
    return _read(context, run_id)


@router.post("/runs/{run_id}/retry", responses=_OF_CHANGE, summary="Retry the products that failed for good")
def retry(run_id: RunId, request: Request, context: ContextDependency) -> RunRead:
    lifecycle.retry(context, run_id)
    wake_control(request)
    return _read(context, run_id)


@router.delete(
    "/runs/{run_id}",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=_OF_CHANGE,
    summary="Delete an ended run; `valerie gc` frees its products",
)
def delete(run_id: RunId, context: ContextDependency) -> None:
    lifecycle.delete(context, run_id)


@router.post(
    "/runs/{run_id}/archive",
    responses=problems(404, 409, 422, 507),
    summary="Move the rows of an ended run into the artifact store; everything reads them there",
)
def archive(run_id: RunId, context: ContextDependency) -> RunRead:
    archive_run(context, run_id)
    return _read(context, run_id)


@router.post("/runs/{run_id}/unarchive", responses=_OF_CHANGE, summary="Move the rows of an archived run back")
def unarchive(run_id: RunId, context: ContextDependency) -> RunRead:
    restore_rows(context, run_id)
    return _read(context, run_id)


def _read(context: Context, run_id: str) -> RunRead:
    with reading(context.engine) as connection:
        return _run(runs.get(connection, run_id), marks.tags_of_runs(connection, [run_id]).get(run_id, []))


def _run(row: runs.RunRow, tags: list[str]) -> RunRead:
    stages = {} if row.progress is None else row.progress.stages
    archived = row.archive is not None
    return RunRead.model_validate(vars(row) | {"stages": stages, "tags": tags, "archived": archived})
