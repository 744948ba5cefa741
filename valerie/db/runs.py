"""Queries about runs: their rows, states and products."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime
from typing import Final, NamedTuple, TypedDict, Unpack

from sqlalchemy import Connection, Select, String, bindparam, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from valerie.db import marks
from valerie.db.links import links_of
from valerie.db.models import Evaluation, FedBlock, Frame, FrameAnnotation, Product, Run, StudyBatch, Variant
from valerie.db.rows import columns_of, read_all, read_first, required
from valerie.db.statements import Seen, newest_first, within
from valerie.errors import Conflict
from valerie.runs.forecasting.costs import Cost
from valerie.runs.products.archive import Archive
from valerie.runs.products.pins import AnyPins
from valerie.runs.products.progress import Progress
from valerie.runs.products.states import UPLOADED_ROUTE, Priority, ProductKind, ProductState, RunState
from valerie.runs.resolving.spec import RunSpec

#: States of runs that have not ended.
ACTIVE: Final = (RunState.SUBMITTED, RunState.RUNNING, RunState.PAUSED, RunState.FINISHING)


@dataclass(frozen=True)
class SubmittedRun:
    """The columns of a run that are known at submission; see `valerie.db.models.Run`."""

    id: str
    name: str
    state: RunState
    reason: str | None
    spec: RunSpec
    spec_digest: str
    asset_digest: str
    pins: AnyPins | None
    parent_run: str | None
    iteration: int
    variant_count: int
    priority: Priority
    deadline: datetime | None
    owner: str | None
    project: str
    tenant: str
    forecast: Cost | None
    created_at: datetime


@dataclass(frozen=True)
class RunRow(SubmittedRun):
    """A stored run."""

    next_index: int
    turn: float
    rejected_count: int
    progress: Progress | None
    archive: Archive | None
    started_at: datetime | None
    finished_at: datetime | None


class RunValues(TypedDict, total=False):
    """Columns of a run that change."""

    pins: AnyPins
    reason: str | None
    next_index: int
    rejected_count: int
    turn: float
    progress: Progress
    archive: Archive | None
    started_at: datetime
    finished_at: datetime | None


class Fed(NamedTuple):
    """The part of a run that has rows.

    Attributes:
        state: state of the run.
        next_index: variants before this one have rows.
        rejected_count: number of rejected variants among them.
        turn: turn of the next product.
    """

    state: RunState
    next_index: int
    rejected_count: int
    turn: float


@dataclass(frozen=True, slots=True)
class Relative:
    """A run among those that descend from each other.

    Attributes:
        id, name, state, parent_run, iteration, created_at: see `valerie.db.models.Run`.
        study: id of the study that made it as a batch; None for other runs.
    """

    id: str
    name: str
    state: RunState
    parent_run: str | None
    iteration: int
    created_at: datetime
    study: str | None


_RUN = select(*columns_of(RunRow, Run))
# Built once: building a statement costs more than executing it, and the control loop asks for these in each round.
_RUN_OF_ID = _RUN.where(Run.id == bindparam("run_id"))
_TO_CHANGE = _RUN_OF_ID.with_for_update(key_share=True)
_FED = (
    select(Run.state, Run.next_index, Run.rejected_count, Run.turn)
    .where(Run.id == bindparam("run_id"))
    .with_for_update(key_share=True)  # SQLite: no one else writes
)
_OF_ID = update(Run).where(Run.id == bindparam("run"))
_IN_STATES = _OF_ID.where(Run.state.in_(bindparam("expected", expanding=True)))
_RUNS_IN_STATES = _RUN.where(Run.state.in_(bindparam("states", expanding=True))).order_by(Run.created_at, Run.id)


def create(connection: Connection, run: SubmittedRun, *, idempotency_key: str | None = None) -> str:
    """Insert a run and return its id; if a run has its idempotency key already, return that run's id.

    Raises:
        Conflict: the idempotency key belongs to a run with another spec.
    """
    known = of_key(connection, idempotency_key, run.spec_digest)
    if known is not None:
        return known
    try:
        with connection.begin_nested():
            connection.execute(insert(Run).values(**vars(run), idempotency_key=idempotency_key))
    except IntegrityError as error:
        # On Postgres, another request may have stored the same key between the SELECT and the INSERT.
        known = of_key(connection, idempotency_key, run.spec_digest)
        if known is not None:
            return known
        raise Conflict(f"the run could not be stored: {error.orig}") from error
    return run.id


def of_key(connection: Connection, key: str | None, spec_digest: str) -> str | None:
    """Return the id of the run with this idempotency key, if any.

    Raises:
        Conflict: the run has another spec.
    """
    if key is None:
        return None
    row = connection.execute(select(Run.id, Run.spec_digest).where(Run.idempotency_key == key)).first()
    if row is None:
        return None
    run_id, known_digest = row
    if known_digest != spec_digest:
        raise Conflict(f"the idempotency key was used for another spec (run {run_id})")
    return run_id


def latest_of(connection: Connection, spec_digest: str, *, project: str = "") -> str | None:
    """Return the id of the newest run with a spec, if any; in a project, if it is not empty."""
    newest = select(Run.id).where(Run.spec_digest == spec_digest, within(Run, project))
    found: str | None = connection.scalar(newest.order_by(Run.created_at.desc()).limit(1))
    return found


def get(connection: Connection, run_id: str) -> RunRow:
    """Return a run.

    Raises:
        NotFound: no such run.
    """
    return required(find(connection, run_id), "run", run_id)


def find(connection: Connection, run_id: str) -> RunRow | None:
    """Return a run, or None if there is no such run."""
    return read_first(connection, _RUN_OF_ID, RunRow, run_id=run_id)


def to_change(connection: Connection, run_id: str) -> RunRow:
    """Return a run whose rows or marks may change; it is not archived until the commit.

    Raises:
        NotFound: no such run.
        Conflict: it is archived.
    """
    run = required(read_first(connection, _TO_CHANGE, RunRow, run_id=run_id), "run", run_id)
    if run.archive is not None:
        raise Conflict(f"run {run_id} is archived; `valerie archive --undo {run_id}` makes it changeable")
    return run


def require(connection: Connection, run_id: str, *, project: str = "") -> None:
    """Refuse a run that does not exist, or not in the project, if that is not empty.

    Raises:
        NotFound: no such run.
    """
    required(connection.scalar(select(Run.id).where(Run.id == run_id, within(Run, project))), "run", run_id)


def fed(connection: Connection, run_id: str) -> Fed:
    """Return the part of a run that has rows; the run stays as it is until the commit.

    Transactions that write a run and its products do so in this order.

    Raises:
        NotFound: no such run.
    """
    return Fed(*required(connection.execute(_FED, {"run_id": run_id}).first(), "run", run_id))


def page(
    connection: Connection,
    *,
    limit: int,
    before: Seen | None = None,
    state: RunState | None = None,
    tag: str | None = None,
    project: str = "",
) -> list[RunRow]:
    """Return runs, newest first.

    Args:
        connection: to read with.
        limit: largest number of runs.
        before: the last run of the page before.
        state: only runs in this state.
        tag: only runs that carry it.
        project: only its runs; empty: all.
    """
    query = newest_first(_RUN, Run, limit=limit, before=before).where(within(Run, project))
    if state is not None:
        query = query.where(Run.state == state)
    if tag is not None:
        query = query.where(marks.tagged(tag))
    return read_all(connection, query, RunRow)


def lineage(connection: Connection, run_id: str, *, project: str = "", most: int = 300) -> list[Relative]:
    """Return a run, the runs that it descends from, and all that descend from the oldest of these, oldest first.

    Args:
        connection: to read with.
        run_id: of an existing run.
        project: only its runs; empty: all.
        most: runs; of more descendants the nearest generations are returned.

    Raises:
        NotFound: no such run.
    """
    oldest, path = get(connection, run_id), {run_id}
    while oldest.parent_run is not None and oldest.parent_run not in path and len(path) < most:
        path.add(oldest.parent_run)
        oldest = get(connection, oldest.parent_run)
    relatives: dict[str, Relative] = {}
    generation = Run.id.in_(path)
    while len(relatives) < most:
        query = (
            select(*columns_of(Relative, Run, study=StudyBatch.study_id))
            .outerjoin(StudyBatch, StudyBatch.run_id == Run.id)
            .where(generation, within(Run, project))
            .order_by(Run.created_at, Run.id)
            .limit(most)
        )
        new = [run for run in read_all(connection, query, Relative) if run.id not in relatives]
        if not new:
            break
        relatives |= {run.id: run for run in new[: most - len(relatives)]}
        generation = Run.parent_run.in_([run.id for run in new])
    return sorted(relatives.values(), key=lambda run: (run.created_at, run.id))


def in_states(connection: Connection, states: Collection[RunState]) -> list[RunRow]:
    """Return all runs in one of ``states``, oldest first."""
    return read_all(connection, _RUNS_IN_STATES, RunRow, states=list(states))


def count_by_state(connection: Connection) -> dict[RunState, int]:
    """Return the number of runs by state; states without runs are left out."""
    rows = connection.execute(select(Run.state, func.count()).group_by(Run.state))
    return {state: count for state, count in rows}  # noqa: C416  # mypy reads the types of rows


def change_state(
    connection: Connection,
    run_id: str,
    *,
    expected: Collection[RunState],
    state: RunState,
    **values: Unpack[RunValues],
) -> bool:
    """Move a run from one of ``expected`` to ``state``; its old reason is dropped.

    Returns:
        False if it was in none of them: another process was faster.
    """
    changes: RunValues = {"reason": None, **values}
    identity = {"run": run_id, "expected": list(expected)}
    return connection.execute(_IN_STATES, {**identity, "state": state, **changes}).rowcount == 1


def set_values(connection: Connection, run_id: str, **values: Unpack[RunValues]) -> None:
    """Set columns of a run."""
    connection.execute(_OF_ID, {"run": run_id, **values})


def remove(connection: Connection, run_id: str) -> None:
    """Delete a run with its variants, frames, links and marks; its products stay until `gc` frees those without a link."""
    for table in (Evaluation, FrameAnnotation, Frame, Variant, FedBlock):
        connection.execute(delete(table).where(table.run_id == run_id))
    marks.remove_all(connection, run_id)
    connection.execute(delete(Run).where(Run.id == run_id))


_LINKS: Final = links_of(bindparam("run", type_=String))
_LINKED: Final = (
    select(Product.digest)
    .join(_LINKS, _LINKS.c[0] == Product.digest)
    .where(Product.state.in_(bindparam("states", expanding=True)))
)


def linked_digests(connection: Connection, run_id: str, states: Collection[ProductState]) -> list[str]:
    """Return the digests of the run's products in one of ``states``."""
    return list(connection.scalars(_LINKED, {"run": run_id, "states": list(states)}))


def cpu_seconds(connection: Connection, run_id: str) -> dict[ProductKind, float]:
    """Return the CPU time that made the run's products, by kind; products that another run had made count, too."""
    links = links_of(run_id)
    rows = connection.execute(
        select(Product.kind, func.sum(Product.cpu_seconds))
        .join(links, links.c[0] == Product.digest)
        .where(Product.cpu_seconds.is_not(None))
        .group_by(Product.kind)
    )
    return {kind: float(seconds or 0.0) for kind, seconds in rows}


def awaited(connection: Connection, run_id: str, function_index: int) -> list[str]:
    """Return the digests of a function's predictions that can be uploaded, since their frames are rendered."""
    return list(connection.scalars(_awaited(run_id).where(Evaluation.function_index == function_index)))


def awaited_count(connection: Connection, run_id: str) -> int:
    """Return the number of predictions of a run that can be uploaded now."""
    return connection.scalar(select(func.count()).select_from(_awaited(run_id).subquery())) or 0


def _awaited(run_id: str) -> Select[str]:
    uploadable = Product.state == ProductState.READY, Product.route == UPLOADED_ROUTE
    links = select(Product.digest).distinct().join(Evaluation, Evaluation.prediction == Product.digest)
    return links.where(Evaluation.run_id == run_id, *uploadable)
