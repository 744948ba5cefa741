"""Queries about studies and their batches."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import TypedDict, Unpack

from sqlalchemy import ColumnElement, Connection, Update, func, insert, select, update

from valerie.db.links import links_of
from valerie.db.models import Product, StudyBatch
from valerie.db.models import Study as StudyTable
from valerie.db.rows import columns_of, read_all, read_first, required
from valerie.db.statements import Seen, insert_ignoring, newest_first, within
from valerie.runs.study.study_document import Outcomes, StudyDocument, StudyResult, StudyState


@dataclass(frozen=True)
class StudyRow:
    """A study; see `valerie.db.models.Study`."""

    id: str
    name: str
    state: StudyState
    reason: str | None
    document: StudyDocument
    asset_digest: str
    by_hand: bool
    result: StudyResult | None
    owner: str | None
    project: str
    created_at: datetime
    finished_at: datetime | None


class StudyValues(TypedDict, total=False):
    """Columns of a study that change."""

    state: StudyState
    reason: str | None
    by_hand: bool
    result: StudyResult | None
    finished_at: datetime | None


@dataclass(frozen=True)
class BatchRow:
    """A batch of a study; see `valerie.db.models.StudyBatch`."""

    study_id: str
    number: int
    count: int
    points: list[list[float]]
    rejected: list[int]
    reason: str
    basis: str
    based_on: int
    accepted_at: datetime | None
    run_id: str | None = None
    retries: int = 0
    outcomes: Outcomes | None = None
    cpu_seconds: float | None = None

    @property
    def ended(self) -> bool:
        """True if nothing is left to do for it."""
        return self.outcomes is not None or not self.points

    @property
    def legal(self) -> int:
        """Number of variants that are not rejected; they count against the budget."""
        return len(self.points) - len(self.rejected)


_STUDY = select(*columns_of(StudyRow, StudyTable))
_RUNNING = _STUDY.where(StudyTable.state == StudyState.RUNNING).order_by(StudyTable.created_at, StudyTable.id)


def create(connection: Connection, study: StudyRow) -> None:
    """Insert a study."""
    connection.execute(insert(StudyTable).values(**vars(study)))


def get(connection: Connection, study_id: str) -> StudyRow:
    """Return a study.

    Raises:
        NotFound: no such study.
    """
    return required(read_first(connection, _STUDY.where(StudyTable.id == study_id), StudyRow), "study", study_id)


def require(connection: Connection, study_id: str, *, project: str) -> None:
    """Refuse a study that does not exist, or not in the project, if that is not empty.

    Raises:
        NotFound: no such study.
    """
    query = select(StudyTable.id).where(StudyTable.id == study_id, within(StudyTable, project))
    required(connection.scalar(query), "study", study_id)


def page(connection: Connection, *, limit: int, before: Seen | None = None, project: str = "") -> list[StudyRow]:
    """Return studies, newest first.

    Args:
        connection: to read with.
        limit: largest number of studies.
        before: the last study of the page before.
        project: only its studies; empty: all.
    """
    query = newest_first(_STUDY, StudyTable, limit=limit, before=before).where(within(StudyTable, project))
    return read_all(connection, query, StudyRow)


def named(connection: Connection, name: str) -> list[StudyRow]:
    """Return the studies with a name, oldest first."""
    query = _STUDY.where(StudyTable.name == name).order_by(StudyTable.created_at, StudyTable.id)
    return read_all(connection, query, StudyRow)


def running(connection: Connection) -> list[StudyRow]:
    """Return the studies in state ``running``, oldest first."""
    return read_all(connection, _RUNNING, StudyRow)


def set_values(connection: Connection, study_id: str, *, expected: StudyState, **values: Unpack[StudyValues]) -> bool:
    """Change columns of a study in state ``expected``; return False if it is in another."""
    changed = connection.execute(
        update(StudyTable).where(StudyTable.id == study_id, StudyTable.state == expected).values(**values)
    )
    return changed.rowcount == 1


def batches(connection: Connection, study_id: str) -> list[BatchRow]:
    """Return the batches of a study, in order."""
    query = select(*columns_of(BatchRow, StudyBatch)).where(StudyBatch.study_id == study_id)
    return read_all(connection, query.order_by(StudyBatch.number), BatchRow)


def propose(connection: Connection, batch: BatchRow) -> None:
    """Insert a proposal, unless another process has inserted it already."""
    insert_ignoring(connection, StudyBatch, [vars(batch)])


def accept(connection: Connection, study_id: str, number: int, now: datetime) -> bool:
    """Accept a proposal; return False if it was accepted already."""
    changed = connection.execute(_of(study_id, number).where(StudyBatch.accepted_at.is_(None)).values(accepted_at=now))
    return changed.rowcount == 1


def replace_proposal(connection: Connection, batch: BatchRow) -> bool:
    """Replace a proposal unless it is accepted; return False if it is."""
    changed = connection.execute(
        _of(batch.study_id, batch.number).where(StudyBatch.accepted_at.is_(None)).values(**vars(batch))
    )
    return changed.rowcount == 1


def set_run(connection: Connection, study_id: str, number: int, run_id: str) -> None:
    """Set the run of a batch."""
    connection.execute(_of(study_id, number).values(run_id=run_id))


def count_retry(connection: Connection, study_id: str, number: int, retries: int) -> bool:
    """Count a retry after ``retries`` earlier ones; return False if another process counted it."""
    changed = connection.execute(_of(study_id, number).where(StudyBatch.retries == retries).values(retries=retries + 1))
    return changed.rowcount == 1


def reset_retries(connection: Connection, study_id: str) -> None:
    """Reset the retries of a study's unfinished batches."""
    connection.execute(
        update(StudyBatch).where(StudyBatch.study_id == study_id, StudyBatch.outcomes.is_(None)).values(retries=0)
    )


def end(connection: Connection, study_id: str, number: int, outcomes: Outcomes) -> None:
    """Write the outcomes of a batch and the CPU time spent on it, unless it has ended already."""
    row = connection.execute(
        select(StudyBatch.run_id, StudyBatch.accepted_at).where(
            StudyBatch.study_id == study_id, StudyBatch.number == number
        )
    ).first()
    spent = 0.0
    if row is not None and row.run_id is not None and row.accepted_at is not None:
        spent = cpu_seconds(connection, row.run_id, Product.finished_at >= row.accepted_at.timestamp())
    connection.execute(
        _of(study_id, number).where(StudyBatch.outcomes.is_(None)).values(outcomes=outcomes, cpu_seconds=spent)
    )


def cpu_seconds(connection: Connection, run_id: str, *conditions: ColumnElement[bool]) -> float:
    """Return the CPU time, seconds, of the products of a run that meet all conditions."""
    links = links_of(run_id)
    query = select(func.sum(Product.cpu_seconds)).join(links, links.c[0] == Product.digest).where(*conditions)
    return float(connection.scalar(query) or 0.0)


def _of(study_id: str, number: int) -> Update:
    return update(StudyBatch).where(StudyBatch.study_id == study_id, StudyBatch.number == number)
