"""Specs that are being written: their schema, changes of their text, and pictures of their variants. Nothing is stored."""

from __future__ import annotations

from functools import cache
from typing import Annotated, cast

from fastapi import APIRouter, Query, Request
from pydantic import JsonValue

from services.api.dependencies import ContextDependency, RunId
from services.api.openapi import example, problems
from services.api.routers.runs import SPEC_BODY, Spec
from services.api.schemas.drafts import DraftChanges, DraftRead, PreviewRead
from valerie.db import runs
from valerie.db.engine import reading
from valerie.pipeline.control.preview import Previews
from valerie.runs.document.descent import descent
from valerie.runs.document.draft import changed_draft, draft_of, read_draft
from valerie.runs.document.schema import run_spec_schema

router = APIRouter(prefix="/v1", tags=["drafts"])

#: Most pictures of one request.
_MOST = 4


@router.get(
    "/schema",
    responses={**problems(422), **example({"title": "VALERIE run spec", "type": "object"})},
    summary="The JSON Schema of specs in either notation",
)
def schema() -> dict[str, JsonValue]:
    return _schema()


@cache
def _schema() -> dict[str, JsonValue]:
    return cast("dict[str, JsonValue]", run_spec_schema())


@router.post(
    "/draft",
    responses=problems(413, 422),
    summary="The text of a spec after changes, which keep its comments, and its values for a form",
)
def draft(changes: DraftChanges) -> DraftRead:
    text = changed_draft(changes.text, changes.changes)
    document = read_draft(text)
    return DraftRead.model_validate(
        {"text": text, **document._asdict(), "vary": [entry._asdict() for entry in document.vary]}
    )


@router.get("/runs/{run_id}/draft", responses=problems(404, 422), summary="The spec of a run as a text to go on from")
def draft_of_run(
    run_id: RunId,
    context: ContextDependency,
    child: Annotated[bool, Query(description="the spec of a run that descends from this one")] = False,
) -> DraftRead:
    with reading(context.engine) as connection:
        spec = runs.get(connection, run_id).spec
    if child:
        spec = spec.model_copy(update=descent(spec, run_id, change="edited"))
    return draft(DraftChanges(text=draft_of(spec)))


@router.post(
    "/preview",
    openapi_extra=SPEC_BODY,
    responses=problems(413, 422, 501),
    summary="Small pictures of variants of a spec before it is submitted",
)
def preview(
    spec: Spec,
    request: Request,
    variant: Annotated[
        list[Annotated[int, Query(ge=0, lt=2**62)]],
        Query(min_length=1, max_length=_MOST, description="indexes of variants", examples=[[0, 9]]),
    ],
    camera: Annotated[
        str | None, Query(max_length=200, description="by default the first of the spec", examples=["camera-1"])
    ] = None,
    accepted: Annotated[bool, Query(description="take the nearest accepted variant for a rejected one")] = False,
) -> PreviewRead:
    previews: Previews = request.app.state.previews
    return PreviewRead.model_validate(previews.render(spec, variant, camera=camera, accepted=accepted))
