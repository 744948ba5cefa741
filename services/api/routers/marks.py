"""Tags and notes that people put on runs, frames and findings."""

from __future__ import annotations

from fastapi import APIRouter

from services.api.dependencies import ContextDependency, ProjectDependency, RunId
from services.api.openapi import example, problems
from services.api.schemas.marks import MarkPut, MarkRead
from valerie.db import marks, runs
from valerie.db.engine import reading
from valerie.pipeline.control.marking import put_mark
from valerie.runs.marks import Mark

router = APIRouter(prefix="/v1", tags=["marks"])


@router.get(
    "/tags",
    responses={**problems(422), **example({"night": 3})},
    summary="Number of runs that carry each tag",
)
def tags(context: ContextDependency, project: ProjectDependency) -> dict[str, int]:
    with reading(context.engine) as connection:
        return marks.known_tags(connection, project=project)


@router.get(
    "/runs/{run_id}/marks", responses=problems(404, 422), summary="Tags and notes on a run, its frames and its findings"
)
def list_marks(run_id: RunId, context: ContextDependency) -> list[MarkRead]:
    with reading(context.engine) as connection:
        runs.require(connection, run_id)
        rows = marks.listed(connection, run_id)
    return [_read(row) for row in rows]


@router.put(
    "/runs/{run_id}/marks",
    responses=problems(404, 409, 422),
    summary="Replace the tags and the note of a run, of a frame or of a finding",
)
def put(run_id: RunId, mark: MarkPut, context: ContextDependency) -> list[MarkRead]:
    put_mark(context, run_id, mark.subject, Mark(tags=tuple(mark.tags), note=mark.note))
    return list_marks(run_id, context)


def _read(row: marks.MarkRow) -> MarkRead:
    return MarkRead.model_validate({**row.subject.model_dump(), **row.mark.model_dump(), "changed_at": row.changed_at})
