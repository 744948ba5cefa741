"""What the runs of an owner or a project use, for quotas."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Connection, Select, and_, case, delete, func, insert, select, union

from valerie.db.engine import database_time
from valerie.db.links import PRODUCT_LINKS, links_of
from valerie.db.models import DeletedRun, Product, Run
from valerie.db.runs import ACTIVE, RunRow
from valerie.db.statements import within
from valerie.runs.forecasting.costs import Cost
from valerie.runs.products.progress import Progress
from valerie.runs.products.states import ProductState


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


def unfinished(connection: Connection, *, owner: str | None = None, project: str = "", besides: str = "") -> Unfinished:
    """Return the unfinished runs of an owner or a project; paused ones count, since they may go on by themselves.

    Args:
        connection: to read with.
        owner: of the runs; None: all.
        project: of the runs; empty: all.
        besides: id of a run that is not counted.
    """
    columns = Run.variant_count, Run.forecast, Run.progress
    query = select(*columns).where(Run.state.in_(ACTIVE), Run.id != besides, _held(Run, owner, project))
    rows = connection.execute(query).all()
    ahead = Cost.total(rest(forecast, progress) for _, forecast, progress in rows)
    return Unfinished(len(rows), sum(variants for variants, _, _ in rows), ahead)


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
    return Cost.total(costs)


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
