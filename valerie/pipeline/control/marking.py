"""Tags and notes on runs, frames and findings."""

from __future__ import annotations

from valerie.db import frames, marks, runs
from valerie.db.engine import database_moment, writing
from valerie.errors import InvalidInput, NotFound
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.run_artifacts import read_summary
from valerie.runs.marks import Mark, MarkKind, Subject
from valerie.runs.products.frame_keys import FrameKey


def put_mark(context: Context, run_id: str, subject: Subject, mark: Mark) -> None:
    """Replace the tags and the note of a run, of one of its frames or of one of its findings.

    Raises:
        NotFound: no such run, frame or finding.
        Conflict: a finding of a run that has not completed, or the run is archived.
        InvalidInput: the name is not that of a frame or finding.
    """
    if subject.kind is MarkKind.FINDING and subject.name not in _findings(context, run_id):
        raise NotFound("finding", subject.name)
    if subject.kind is MarkKind.RUN and subject.name:
        raise InvalidInput("a run needs no name here", field="name", value=subject.name)
    with writing(context.engine) as connection:
        runs.to_change(connection, run_id)
        if subject.kind is MarkKind.FRAME:
            frames.get(connection, FrameKey.parse(f"{run_id}.{subject.name}", field="name"))
        marks.put(connection, run_id, subject, mark, database_moment(connection))


def _findings(context: Context, run_id: str) -> list[str]:
    """Return the sentences of a run's findings and candidates."""
    findings = read_summary(context, run_id)["findings"]
    return [finding["sentence"] for finding in (*findings["items"], *findings["candidates"])]
