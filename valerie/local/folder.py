"""The runs, frames and studies of the data folder, for commands that work without a server."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

from valerie.answers import (
    Failure,
    Frame,
    Progress,
    Quota,
    Run,
    RunSummary,
    Study,
    StudyBatch,
    StudyKnown,
    StudyOutcomes,
)
from valerie.runs.products.states import RunState

if TYPE_CHECKING:
    from valerie.db.runs import RunRow
    from valerie.db.studies import BatchRow, StudyRow
    from valerie.pipeline.base.context import Context


#: Number of frames that are read at once.
_PAGE: Final = 1000


class Folder:
    """The methods of `valerie.client.Client` about runs, frames and studies, reading from the data folder.

    Every method with an id may raise `NotFound`; those about the results of a run raise `Conflict` before it has ended.
    """

    def __init__(self, context: Context, up: str) -> None:
        """Read from an open deployment.

        Args:
            context: context of the deployment.
            up: command line that starts a server on the folder.
        """
        self._context = context
        self._up = up

    def runs(self, *, limit: int = 20, tag: str | None = None) -> list[Run]:
        """Return runs, newest first; with ``tag`` only those that carry it."""
        from valerie.db import marks, runs
        from valerie.db.engine import reading

        with reading(self._context.engine) as connection:
            rows = runs.page(connection, limit=limit, tag=tag)
            tags = marks.tags_of_runs(connection, [row.id for row in rows])
        return [_run(row, tags.get(row.id, ())) for row in rows]

    def quotas(self) -> list[Quota]:
        """Return the quotas of all owners and projects that have runs."""
        from valerie.db.engine import reading
        from valerie.pipeline.control.quotas import quotas_of

        with reading(self._context.engine) as connection:
            quotas = quotas_of(connection, self._context.settings, None, "")
        return [Quota(**asdict(quota)) for quota in quotas]

    def run(self, run_id: str) -> Run:
        """Return a run."""
        from valerie.db import runs
        from valerie.db.engine import reading

        with reading(self._context.engine) as connection:
            return _run(runs.get(connection, run_id))

    def progress(self, run_id: str) -> Progress:
        """Return the progress of a run; for one that has not ended, the reason says how to continue it."""
        from valerie.db.engine import reading
        from valerie.pipeline.control import lifecycle

        with reading(self._context.engine) as connection:
            progress = Progress.model_validate(lifecycle.progress(connection, run_id).model_dump(mode="json"))
        if RunState(progress.state).is_final:
            return progress
        return progress.model_copy(update={"reason": f"no server runs; `{self._up}` continues the run"})

    def failures(self, run_id: str) -> list[Failure]:
        """Return the products of a run that failed for good, at most 1000."""
        from valerie.db import results, runs
        from valerie.db.archives import reading_run

        with reading_run(self._context.engine, run_id) as connection:
            runs.require(connection, run_id)
            failed = results.failures(connection, run_id)
        return [
            Failure.model_validate({"kind": link.kind, "error": link.error.model_dump(mode="json")}) for link in failed
        ]

    def summary(self, run_id: str) -> RunSummary:
        """Return summary, findings and verdicts of an ended run."""
        from valerie.pipeline.base.run_artifacts import SUMMARY, read_artifact

        return RunSummary.model_validate_json(read_artifact(self._context, run_id, SUMMARY))

    def report(self, run_id: str) -> bytes:
        """Return the self-contained HTML report of an ended run."""
        from valerie.pipeline.base.run_artifacts import REPORT, read_artifact

        return read_artifact(self._context, run_id, REPORT)

    def annotations(self, run_id: str) -> tuple[str, ...]:
        """Return the kinds of annotations that the spec of a run requests."""
        from valerie.pipeline.base.resolved_runs import read_run

        return read_run(self._context, run_id).resolved.spec.annotations

    def frames(self, run_id: str) -> Iterator[Frame]:
        """Yield the frames of a run, in order."""
        from valerie.pipeline.reading.frame_details import list_frames
        from valerie.runs.products.frame_keys import FrameKey

        after: FrameKey | None = None
        while page := list_frames(self._context, run_id, after=after, limit=_PAGE):
            yield from (Frame(id=one.id, state=one.state, removed=one.removed) for one in page)
            after = FrameKey.parse(page[-1].id)

    def picture(self, frame_id: str, *, sensor: str | None = None) -> bytes:
        """Return the picture of a frame as PNG."""
        from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
        from valerie.pipeline.reading.painting import png
        from valerie.runs.products.frame_keys import FrameKey

        source = find_picture(self._context, FrameKey.parse(frame_id), kind="picture", sensor=sensor)
        return png(paint_picture(self._context, source))

    def annotation(self, frame_id: str, kind: str) -> bytes:
        """Return an annotation of a frame as a file for ``numpy.load``."""
        from valerie.pipeline.reading.annotation_files import annotation_arrays, find_annotations, npz
        from valerie.pipeline.reading.product_reader import ProductReader
        from valerie.runs.products.frame_keys import FrameKey

        key = FrameKey.parse(frame_id)
        ((name, product),) = find_annotations(self._context, key, [kind]).items()
        return npz(annotation_arrays(self._context, ProductReader(self._context.store), key.run_id, name, product))

    def studies(self) -> list[Study]:
        """Return the newest studies, at most 20, newest first."""
        from valerie.db import studies
        from valerie.db.engine import reading

        with reading(self._context.engine) as connection:
            return [_study(row) for row in studies.page(connection, limit=20)]

    def study(self, study_id: str) -> Study:
        """Return a study with its batches."""
        from valerie.db import studies
        from valerie.db.engine import reading
        from valerie.pipeline.control.studies.reporting import outlook

        with reading(self._context.engine) as connection:
            row, batches = studies.get(connection, study_id), studies.batches(connection, study_id)
        return _study(row, batches, outlook=outlook(row, batches, row.result))

    def study_report(self, study_id: str) -> bytes:
        """Return the self-contained HTML report of a study, with what is known now."""
        from valerie.pipeline.control.studies.reporting import report

        return report(self._context, study_id).encode()


def _run(row: RunRow, tags: Iterable[str] = ()) -> Run:
    return Run(
        id=row.id,
        name=row.name,
        state=row.state,
        reason=row.reason,
        variant_count=row.variant_count,
        rejected_count=row.rejected_count,
        tags=tuple(tags),
        archived=row.archive is not None,
        deadline=row.deadline,
        created_at=row.created_at,
        started_at=row.started_at,
        finished_at=row.finished_at,
    )


def _study(row: StudyRow, batches: Iterable[BatchRow] = (), *, outlook: str | None = None) -> Study:
    return Study(
        id=row.id,
        name=row.name,
        state=row.state,
        reason=row.reason,
        by_hand=row.by_hand,
        goal=row.document.goal.name,
        result=None if row.result is None else StudyKnown(sentences=row.result.sentences),
        outlook=outlook,
        created_at=row.created_at,
        batches=tuple(map(_batch, batches)),
    )


def _batch(row: BatchRow) -> StudyBatch:
    return StudyBatch(
        number=row.number,
        reason=row.reason,
        legal=row.legal,
        accepted_at=row.accepted_at,
        run_id=row.run_id,
        outcomes=None if row.outcomes is None else StudyOutcomes(**row.outcomes.model_dump()),
        cpu_seconds=row.cpu_seconds,
    )
