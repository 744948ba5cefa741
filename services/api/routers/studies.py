"""Studies: plan, begin, list, read, preview and accept the next batch, change the mode, stop, resume."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Depends, Path, Query, Request, Response, status

from services.api.dependencies import (
    Body,
    ContextDependency,
    Limit,
    OwnerDependency,
    ProjectDependency,
    SeenDependency,
    next_page,
    wake_control,
)
from services.api.openapi import BINARY, document_body, example, gives, problems
from services.api.routers.runs import PLAN, gives_run
from services.api.schemas.studies import (
    REASON,
    STUDY,
    STUDY_ID,
    BatchCounts,
    BatchRead,
    NextBatchRead,
    StudyDetail,
    StudyPage,
    StudyRead,
    StudyTemplate,
)
from services.api.transfer import IfNoneMatch, send_page
from valerie.db import studies
from valerie.db.engine import reading
from valerie.db.studies import BatchRow, StudyRow
from valerie.document import template
from valerie.pipeline.base.context import Context
from valerie.pipeline.control.studies import commands, reporting
from valerie.pipeline.control.studies.advancing import left
from valerie.plain import JsonObject
from valerie.runs.products.frame_keys import ID
from valerie.runs.study.measure import parse_measure
from valerie.runs.study.study_document import Outcomes, StudyDocument, parse_study

router = APIRouter(prefix="/v1", tags=["studies"])

_YAML = """name: how often
asset: urban-street
vary: [[person-1.pos.x, UNIFORM, -3, 5]]
functions: [deeplabv3plus-small]
measure: min(pacc) >= 0.5
goal: estimate
budget: {variants: 256}
"""
_STUDY_BODY: Final = document_body(
    "A study as JSON or YAML; `valerie study new` writes one with comments.", example=STUDY, yaml=_YAML
)
_NEXT: JsonObject = {
    "number": 0,
    "reason": REASON,
    "legal": 32,
    "rejected": 0,
    "accepted": False,
    "run_id": None,
    "spec": "name: how often, batch 1\n…",
    "plan": PLAN,
}
_OF_STUDY = problems(404, 422)
_OF_CHANGE = problems(404, 409, 422)

StudyId = Annotated[str, Path(pattern=ID, description="id of a study", examples=[STUDY_ID])]


def _document(content: Body) -> StudyDocument:
    return parse_study(content)


Document = Annotated[StudyDocument, Depends(_document)]


@router.post(
    "/studies/plan",
    openapi_extra=_STUDY_BODY,
    responses={**problems(413, 422), **example(_NEXT)},
    summary="First batch of a study and its price; stores nothing",
)
def plan(document: Document, context: ContextDependency, project: ProjectDependency) -> NextBatchRead:
    return NextBatchRead.model_validate(commands.plan_study(context, document, project=project))


@router.post(
    "/studies",
    status_code=status.HTTP_202_ACCEPTED,
    openapi_extra=_STUDY_BODY,
    responses={**problems(413, 422, 507), **gives(202, ("study_id", "/v1/studies", "/id"))},
    summary="Begin a study",
    response_description="accepted; Location names the study",
)
def create(
    document: Document,
    request: Request,
    response: Response,
    context: ContextDependency,
    owner: OwnerDependency,
    project: ProjectDependency,
) -> StudyRead:
    study_id = commands.begin(context, document, owner=owner, project=project)
    wake_control(request)
    response.headers["Location"] = f"/v1/studies/{study_id}"
    return _read(context, study_id)


@router.get(
    "/studies",
    responses={**problems(422), **gives(200, ("study_id", "/v1/studies", "/items/0/id"))},
    response_model=StudyPage,
    summary="Studies, newest first",
)
def list_studies(
    request: Request,
    context: ContextDependency,
    project: ProjectDependency,
    limit: Limit = 50,
    seen: SeenDependency = None,
    if_none_match: IfNoneMatch = None,
) -> Response:
    with reading(context.engine) as connection:
        rows = studies.page(connection, limit=limit + 1, before=seen, project=project)
    page = StudyPage(items=[_study(row) for row in rows[:limit]], next=next_page(rows, limit))
    return send_page(page, known=if_none_match, encodings=request.headers.get("accept-encoding"))


@router.get("/studies/template", responses=problems(422), summary="A commented study to start from")
def read_template() -> StudyTemplate:
    return StudyTemplate(text=template("valerie.studies"))


@router.get(
    "/studies/{study_id}",
    responses={**_OF_STUDY, **gives_run(200, "/batches/0/run_id")},
    response_model=StudyDetail,
    summary="One study with its batches",
)
def read(
    request: Request, study_id: StudyId, context: ContextDependency, if_none_match: IfNoneMatch = None
) -> Response:
    with reading(context.engine) as connection:
        row, batches = studies.get(connection, study_id), studies.batches(connection, study_id)
    bound = parse_measure(row.document.measure).at_least
    detail = StudyDetail(
        **_study(row).model_dump(),
        document=row.document.to_yaml(),
        left=left(row, batches),
        outlook=reporting.outlook(row, batches, row.result),
        batches=[BatchRead.model_validate(vars(batch) | _derived(batch, bound)) for batch in batches],
    )
    return send_page(detail, known=if_none_match, encodings=request.headers.get("accept-encoding"))


@router.get(
    "/studies/{study_id}/next",
    responses={**_OF_CHANGE, **example(_NEXT)},
    summary="The newest open batch, with its reason, spec and price",
)
def next_batch(study_id: StudyId, context: ContextDependency) -> NextBatchRead:
    return NextBatchRead.model_validate(commands.next_batch(context, study_id))


@router.get(
    "/studies/{study_id}/report",
    responses={**_OF_CHANGE, 200: {"content": {"text/html": BINARY}}},
    response_class=Response,
    summary="Report of a study, with its result so far",
)
def report(study_id: StudyId, context: ContextDependency) -> Response:
    return Response(reporting.report(context, study_id), media_type="text/html; charset=utf-8")


@router.post("/studies/{study_id}/accept", responses=_OF_CHANGE, summary="Accept the proposed batch")
def accept(
    study_id: StudyId,
    request: Request,
    context: ContextDependency,
    count: Annotated[
        int | None,
        Query(ge=1, le=1000, description="another number of variants; the strategy proposes them", examples=[16]),
    ] = None,
) -> StudyRead:
    commands.accept(context, study_id, count=count)
    wake_control(request)
    return _read(context, study_id)


@router.post("/studies/{study_id}/mode", responses=_OF_CHANGE, summary="Accept batches by hand, or automatically")
def mode(
    study_id: StudyId,
    request: Request,
    context: ContextDependency,
    by_hand: Annotated[bool, Query(description="a person accepts each batch", examples=[True])],
) -> StudyRead:
    commands.set_mode(context, study_id, by_hand=by_hand)
    wake_control(request)
    return _read(context, study_id)


@router.post("/studies/{study_id}/stop", responses=_OF_CHANGE, summary="End a study with its result so far")
def stop(study_id: StudyId, context: ContextDependency) -> StudyRead:
    commands.stop(context, study_id)
    return _read(context, study_id)


@router.post("/studies/{study_id}/resume", responses=_OF_CHANGE, summary="Resume a paused study")
def resume(study_id: StudyId, request: Request, context: ContextDependency) -> StudyRead:
    commands.resume(context, study_id)
    wake_control(request)
    return _read(context, study_id)


def _read(context: Context, study_id: str) -> StudyRead:
    with reading(context.engine) as connection:
        return _study(studies.get(connection, study_id))


def _study(row: StudyRow) -> StudyRead:
    document, goal = row.document, row.document.goal
    own = {"goal": goal.name, "question": goal.question}
    terms = {"measure": document.measure, "where": document.where, "budget": document.budget}
    return StudyRead.model_validate(vars(row) | own | terms)


def _derived(batch: BatchRow, bound: float) -> dict[str, int | BatchCounts | None]:
    """Return the fields of an answer that are derived from a batch; variants with a score below ``bound`` fail."""
    return {"legal": batch.legal, "counts": None if batch.outcomes is None else _counts(batch, batch.outcomes, bound)}


def _counts(batch: BatchRow, outcomes: Outcomes, bound: float) -> BatchCounts:
    failed = outcomes.failed(bound)
    passed = sum(all(score is not None and score >= bound for score in scores) for scores in outcomes.by_variant)
    return BatchCounts(failed=failed, passed=passed, undefined=batch.legal - failed - passed)
