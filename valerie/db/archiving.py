"""Queries that archive a run: who needs its rows in the database, and how they leave it."""

from __future__ import annotations

from typing import Final

from sqlalchemy import Connection, delete, func, select, update

from valerie.db import runs
from valerie.db.copying import PARTS
from valerie.db.models import Evaluation, FedBlock, Frame, FrameAnnotation, Run, Study, StudyBatch, Variant
from valerie.db.runs import RunRow
from valerie.errors import Conflict
from valerie.runs.products.archive import Archive
from valerie.runs.study.study_document import StudyState

_ONGOING: Final = [state for state in StudyState if not state.is_final]


def require_unneeded(connection: Connection, run: RunRow) -> None:
    """Refuse to archive a run whose rows others still need.

    Raises:
        Conflict: it has not ended, or a study or a run that goes on from it has not.
    """
    if run.state in runs.ACTIVE:
        raise Conflict(f"run {run.id} is {run.state}: it can be archived when it has ended or is cancelled")
    study = connection.execute(
        select(Study.id, Study.state)
        .join(StudyBatch, StudyBatch.study_id == Study.id)
        .where(StudyBatch.run_id == run.id, Study.state.in_(_ONGOING))
    ).first()
    if study is not None:
        raise Conflict(
            f"run {run.id} belongs to study {study.id}, which is {study.state}: archive it when that has ended"
        )
    query = select(Run.id, Run.state).where(Run.parent_run == run.id, Run.state.in_(runs.ACTIVE))
    child = connection.execute(query).first()
    if child is not None:
        raise Conflict(f"run {child.id}, which goes on from {run.id}, is {child.state}: archive it when that has ended")


def ended_before(connection: Connection, moment: float) -> list[str]:
    """Return the runs that ended before a moment, Unix seconds, and are not archived, oldest first."""
    query = select(Run.id, Run.finished_at).where(Run.state.not_in(runs.ACTIVE), Run.archive.is_(None))
    rows = connection.execute(query.order_by(Run.finished_at, Run.id))
    return [run_id for run_id, finished_at in rows if finished_at is not None and finished_at.timestamp() < moment]


def name_archive(connection: Connection, run: RunRow, archive: Archive) -> None:
    """Name the archive of a run, from which it is read from the commit on.

    Raises:
        NotFound: the run was deleted.
        Conflict: it is archived, or not as it was when it was copied.
    """
    same = runs.to_change(connection, run.id) == run
    for table in PARTS:
        count = connection.scalar(select(func.count()).select_from(table).where(table.run_id == run.id))
        same &= count == archive.tables[table.__tablename__].rows
    if not same:
        raise Conflict(f"run {run.id} changed while it was copied: repeat the command")
    require_unneeded(connection, run)
    connection.execute(update(Run).where(Run.id == run.id).values(archive=archive))


def remove_variants(connection: Connection, run_id: str, first: int, last: int) -> None:
    """Delete the rows of the variants ``first`` … ``last`` of a run."""
    for table in (Evaluation, FrameAnnotation, Frame):
        connection.execute(delete(table).where(table.run_id == run_id, table.variant_index.between(first, last)))
    connection.execute(delete(Variant).where(Variant.run_id == run_id, Variant.index.between(first, last)))


def remove_blocks(connection: Connection, run_id: str) -> None:
    """Delete the blocks of a run."""
    connection.execute(delete(FedBlock).where(FedBlock.run_id == run_id))
