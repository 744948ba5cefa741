"""Queries about runs: their rows, variants and links."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Set
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final, NamedTuple, TypedDict, Unpack

from sqlalchemy import (
    BindParameter,
    ColumnElement,
    Connection,
    Select,
    String,
    Subquery,
    and_,
    bindparam,
    case,
    delete,
    func,
    insert,
    select,
    union,
    update,
)
from sqlalchemy.exc import IntegrityError

from valerie.db import marks
from valerie.db.engine import database_time
from valerie.db.links import PRODUCT_LINKS
from valerie.db.models import (
    Assignment,
    DeletedRun,
    Evaluation,
    FedBlock,
    Frame,
    FrameAnnotation,
    Product,
    Run,
    StudyBatch,
    Variant,
)
from valerie.db.rows import columns_of, read_all, read_first
from valerie.db.statements import Seen, newest_first, within
from valerie.errors import Conflict, NotFound
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


class Unfinished(NamedTuple):
    """The unfinished runs of an owner or a project.

    Attributes:
        runs: their number.
        variants: number of their variants.
        forecast: what the rest of them is forecast to take.
    """

    runs: int
    variants: int
    forecast: Cost


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
class VariantRow:
    """A variant; see `valerie.db.models.Variant`."""

    index: int
    block: int
    assignment: Assignment
    rejection: str | None


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
    row = read_first(connection, _RUN_OF_ID, RunRow, run_id=run_id)
    if row is None:
        raise NotFound("run", run_id)
    return row


def archive_of(connection: Connection, run_id: str) -> Archive | None:
    """Return where the rows of a run are; None: in the database.

    Raises:
        NotFound: no such run.
    """
    row = connection.execute(select(Run.archive).where(Run.id == run_id)).first()
    if row is None:
        raise NotFound("run", run_id)
    archive: Archive | None = row[0]
    return archive


def to_change(connection: Connection, run_id: str) -> RunRow:
    """Return a run whose rows or marks may change; it is not archived until the commit.

    Raises:
        NotFound: no such run.
        Conflict: it is archived.
    """
    run = read_first(connection, _TO_CHANGE, RunRow, run_id=run_id)
    if run is None:
        raise NotFound("run", run_id)
    if run.archive is not None:
        raise Conflict(f"run {run_id} is archived; `valerie archive --undo {run_id}` makes it changeable")
    return run


def require(connection: Connection, run_id: str, *, project: str = "") -> None:
    """Refuse a run that does not exist, or not in the project, if that is not empty.

    Raises:
        NotFound: no such run.
    """
    if connection.scalar(select(Run.id).where(Run.id == run_id, within(Run, project))) is None:
        raise NotFound("run", run_id)


def fed(connection: Connection, run_id: str) -> Fed:
    """Return the part of a run that has rows; the run stays as it is until the commit.

    Transactions that write a run and its products do so in this order.

    Raises:
        NotFound: no such run.
    """
    row = connection.execute(_FED, {"run_id": run_id}).first()
    if row is None:
        raise NotFound("run", run_id)
    return Fed(*row)


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


def unfinished(connection: Connection, *, owner: str | None = None, project: str = "", besides: str = "") -> Unfinished:
    """Return what an owner or a project has unfinished; also paused runs, which may go on by themselves.

    Args:
        connection: to read with.
        owner: of the runs; None: all.
        project: of the runs; empty: all.
        besides: id of a run that is not counted.
    """
    columns = Run.variant_count, Run.forecast, Run.progress
    query = select(*columns).where(Run.state.in_(ACTIVE), Run.id != besides, _held(Run, owner, project))
    rows = connection.execute(query).all()
    rests = [rest(forecast, progress) for _, forecast, progress in rows]
    return Unfinished(
        len(rows),
        sum(variants for variants, _, _ in rows),
        Cost(sum(each.cpu_seconds for each in rests), sum(each.bytes for each in rests)),
    )


def rest(forecast: Cost | None, progress: Progress | None) -> Cost:
    """Return the part of a run's forecast that is ahead of it; nothing without a forecast."""
    left = 1.0 if progress is None else progress.left
    return Cost(0.0, 0.0) if forecast is None else Cost(forecast.cpu_seconds * left, forecast.bytes * left)


def made(connection: Connection, *, owner: str | None = None, project: str = "", since: float = 0.0) -> Cost:
    """Return the CPU time that the products of an owner or a project took, and the size of those that are stored.

    A product counts once and in full, also if runs of others share it. CPU time counts after its run is deleted. Of an archived
    run, what no other run shared counts.

    Args:
        connection: to read with.
        owner: of the runs; None: all.
        project: of the runs; empty: all.
        since: Unix seconds; CPU time of what was made before does not count.
    """
    links = union(*_links_of_runs(_held(Run, owner, project))).subquery()
    seconds, size = connection.execute(select(*_sums(since)).join(links, links.c[0] == Product.digest)).one()
    of_deleted = DeletedRun.finished_at >= since, _held(DeletedRun, owner, project)
    deleted = connection.scalar(select(func.sum(DeletedRun.cpu_seconds)).where(*of_deleted))
    costs = [Cost(float(seconds or 0.0) + float(deleted or 0.0), float(size or 0.0))]
    query = select(Run.archive, Run.finished_at).where(Run.archive.is_not(None), _held(Run, owner, project))
    for archive, finished_at in connection.execute(query):
        if archive is not None:
            recent = finished_at is None or finished_at.timestamp() >= since
            costs.append(Cost(archive.cpu_seconds if recent else 0.0, archive.stored_bytes))
    return Cost(sum(cost.cpu_seconds for cost in costs), sum(cost.bytes for cost in costs))


def unshared(connection: Connection, run: RunRow, *, since: float) -> Cost:
    """Return the CPU time, since a moment, and the size of what no other run of a run's owner and project shares with it."""
    if run.archive is not None:
        return Cost(run.archive.cpu_seconds, run.archive.stored_bytes)
    others = Run.owner == run.owner, Run.project == run.project, Run.id != run.id
    own = links_of(run.id)
    shared = union(*_links_of_runs(*others)).subquery()
    sums = connection.execute(
        select(*_sums(since))
        .join(own, own.c[0] == Product.digest)
        .outerjoin(shared, shared.c[0] == Product.digest)
        .where(shared.c[0].is_(None))
    ).one()
    return Cost(*(float(value or 0.0) for value in sums))


def _sums(since: float) -> tuple[ColumnElement[Any], ColumnElement[Any]]:
    """Return the columns for the CPU time, since a moment, and the size of products."""
    return (
        func.sum(case((Product.finished_at >= since, Product.cpu_seconds))),
        func.sum(case((Product.state == ProductState.DONE, Product.bytes))),
    )


def remember(connection: Connection, run: RunRow, cpu_seconds: float, *, since: float) -> None:
    """Keep the CPU time of a run that is about to be deleted, for `made`; forget that of runs that ended before ``since``."""
    ended = database_time(connection) if run.finished_at is None else run.finished_at.timestamp()
    connection.execute(delete(DeletedRun).where((DeletedRun.finished_at < since) | (DeletedRun.id == run.id)))
    values = {"owner": run.owner, "project": run.project, "cpu_seconds": cpu_seconds, "finished_at": ended}
    connection.execute(insert(DeletedRun).values(id=run.id, **values))


def holders(connection: Connection) -> list[tuple[str, str]]:
    """Return the owners of runs with their projects, sorted; the operator is none."""
    query = select(Run.owner, Run.project).distinct().where(Run.owner.is_not(None)).order_by(Run.owner, Run.project)
    return [(str(owner), project) for owner, project in connection.execute(query)]


def _links_of_runs(*conditions: ColumnElement[bool]) -> Iterator[Select[tuple[str]]]:
    """Yield queries of the digests that runs link to."""
    for table, column in PRODUCT_LINKS:
        yield select(column).join(Run, Run.id == table.run_id).where(*conditions)


def _held(table: type[Run | DeletedRun], owner: str | None, project: str) -> ColumnElement[bool]:
    """Return the condition that a run is of an owner, if one is given, and of a project."""
    return within(table, project) if owner is None else and_(table.owner == owner, within(table, project))


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


def links_of(run_id: str | BindParameter[str]) -> Subquery:
    """Return the digests of the products that a run links to, each once."""
    return union(*(select(column).where(table.run_id == run_id) for table, column in PRODUCT_LINKS)).subquery()


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
    return list(
        connection.scalars(
            select(Product.digest)
            .join(Evaluation, Evaluation.prediction == Product.digest)
            .where(Evaluation.run_id == run_id, Evaluation.function_index == function_index, *_AWAITED)
            .distinct()
        )
    )


def awaited_count(connection: Connection, run_id: str) -> int:
    """Return the number of predictions of a run that can be uploaded now."""
    statement = (
        select(func.count(Product.digest.distinct()))
        .join(Evaluation, Evaluation.prediction == Product.digest)
        .where(Evaluation.run_id == run_id, *_AWAITED)
    )
    return connection.scalar(statement) or 0


_AWAITED: Final = (Product.state == ProductState.READY, Product.route == UPLOADED_ROUTE)


def rejections(connection: Connection, run_id: str) -> dict[str, int]:
    """Return the number of rejected variants by reason."""
    rows = connection.execute(
        select(Variant.rejection, func.count())
        .where(Variant.run_id == run_id, Variant.rejection.is_not(None))
        .group_by(Variant.rejection)
    )
    return {str(reason): int(count) for reason, count in rows}


def variants_page(
    connection: Connection, run_id: str, *, after: int, limit: int, rejected: bool | None = None
) -> list[VariantRow]:
    """Return variants with an index above ``after``, ascending.

    Args:
        connection: to read with.
        run_id: of an existing run.
        after: index of the last variant read.
        limit: largest number of variants.
        rejected: only the rejected variants, or only the others; None: both.
    """
    query = (
        select(*columns_of(VariantRow, Variant))
        .where(Variant.run_id == run_id, Variant.index > after)
        .order_by(Variant.index)
        .limit(limit)
    )
    if rejected is not None:
        query = query.where(Variant.rejection.is_not(None) if rejected else Variant.rejection.is_(None))
    return read_all(connection, query, VariantRow)


def assignments(connection: Connection, run_id: str, variants: Set[int]) -> dict[int, Assignment]:
    """Read the assignment of each of ``variants`` (indexes) of a run."""
    if not variants:
        return {}
    rows = connection.execute(
        select(Variant.index, Variant.assignment).where(
            Variant.run_id == run_id, Variant.index.between(min(variants), max(variants)), Variant.rejection.is_(None)
        )
    )
    # By position: `index` is a method of every row.
    return {index: assignment for index, assignment in rows if index in variants}
