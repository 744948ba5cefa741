"""Queries about processes: live workers, their offers, and the holders of roles."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeVar

from sqlalchemy import Connection, bindparam, delete, func, select, update

from valerie.db.models import Lease, Specimen, Worker
from valerie.db.rows import columns_of, read_all
from valerie.db.statements import insert_ignoring
from valerie.runs.products.pins import AnyOffer, Offer
from valerie.runs.products.states import Stage

Offered = TypeVar("Offered", bound=Offer)

#: A worker without a heartbeat for this long counts as dead.
ALIVE_SECONDS = 20.0
#: The row of a worker without a heartbeat for this long is deleted.
_FORGOTTEN_SECONDS: Final = 3600.0


@dataclass(frozen=True)
class WorkerRow:
    """A worker process; see `valerie.db.models.Worker`."""

    id: str
    stage: Stage
    host: str
    pid: int
    offers: tuple[AnyOffer, ...]
    started_at: float
    seen_at: float
    resting: str | None = None
    clock_ahead: float | None = None


# Built once: building a statement costs more than executing it, and the control loop needs these in each round.
_LIVING: Final = Worker.seen_at.between(bindparam("first"), bindparam("last"))
_ALIVE: Final = select(*columns_of(WorkerRow, Worker)).where(_LIVING).order_by(Worker.started_at)
_COUNT: Final = select(func.count()).select_from(Worker).where(_LIVING)
_TAKE: Final = (
    update(Lease)
    .where(Lease.name == bindparam("role"), (Lease.owner == bindparam("holder")) | (Lease.until < bindparam("now")))
    .values(owner=bindparam("holder"), until=bindparam("end"))
)
_CUT: Final = (
    update(Lease).where(Lease.name == bindparam("role"), Lease.until > bindparam("end")).values(until=bindparam("end"))
)


def owner_of(worker_id: str) -> str:
    """Return a new owner of leases for a process that works for a worker."""
    return f"{worker_id}.{secrets.token_hex(2)}"


def worker_of(owner: str) -> str:
    """Return the id of the worker that an owner of leases works for."""
    return owner.rpartition(".")[0]


def register_worker(connection: Connection, worker: WorkerRow) -> None:
    """Write a worker's row, replacing one of the same id; delete the rows of workers that died long ago."""
    forgotten = worker.seen_at - _FORGOTTEN_SECONDS
    connection.execute(delete(Worker).where((Worker.id == worker.id) | (Worker.seen_at < forgotten)))
    insert_ignoring(connection, Worker, [vars(worker)])


def keep_specimens(connection: Connection, specimens: Mapping[str, bytes]) -> None:
    """Store specimens by key; those that are stored already are only read, so that workers that start together do not wait."""
    stored = stored_specimens(connection, specimens)
    new = [{"key": key, "data": data} for key, data in sorted(specimens.items()) if stored.get(key) != data]
    connection.execute(delete(Specimen).where(Specimen.key.in_([row["key"] for row in new])))
    insert_ignoring(connection, Specimen, new)


def specimen_keys(connection: Connection) -> frozenset[str]:
    """Return the keys of all stored specimens: a few per numeric class."""
    return frozenset(connection.scalars(select(Specimen.key)))


def stored_specimens(connection: Connection, keys: Iterable[str]) -> dict[str, bytes]:
    """Return those specimens of ``keys`` that are stored."""
    rows = connection.execute(select(Specimen.key, Specimen.data).where(Specimen.key.in_(list(keys))))
    return {row.key: row.data for row in rows}


def worker_seen(connection: Connection, worker_id: str, now: float, clock_ahead: float) -> bool:
    """Record a heartbeat; return False if the worker's row is gone and it must register again."""
    sign = update(Worker).where(Worker.id == worker_id).values(seen_at=now, clock_ahead=clock_ahead)
    return connection.execute(sign).rowcount == 1


def rest(connection: Connection, worker_id: str, reason: str | None) -> None:
    """Put a worker aside for a reason, or with None have it work again."""
    connection.execute(update(Worker).where(Worker.id == worker_id).values(resting=reason))


def remove_worker(connection: Connection, worker_id: str) -> None:
    """Delete the row of a worker that ends."""
    connection.execute(delete(Worker).where(Worker.id == worker_id))


def workers(connection: Connection, *, now: float) -> list[WorkerRow]:
    """Return the live workers, the longest-running first."""
    # A heartbeat from the future is of a worker that died before the clock was set back: a live one sends another.
    return read_all(connection, _ALIVE, WorkerRow, first=now - ALIVE_SECONDS, last=now + ALIVE_SECONDS)


def count_workers(connection: Connection, *, now: float) -> int:
    """Return the number of live workers."""
    return connection.scalar(_COUNT, {"first": now - ALIVE_SECONDS, "last": now + ALIVE_SECONDS}) or 0


def offers(connection: Connection, *, now: float) -> list[AnyOffer]:
    """Return the offers of the live workers that do not rest, each route and name once, in the order of `workers`."""
    return distinct(offers_by_worker(connection, now=now))


def offers_by_worker(connection: Connection, *, now: float) -> list[tuple[AnyOffer, ...]]:
    """Return the offers of each live worker that does not rest, in the order of `workers`."""
    return [worker.offers for worker in workers(connection, now=now) if worker.resting is None]


def distinct(by_worker: Iterable[Iterable[Offered]]) -> list[Offered]:
    """Return the offers of several workers, each route and name once."""
    unique: dict[tuple[str, str], Offered] = {}
    for offered in by_worker:
        for offer in offered:
            unique.setdefault((offer.route, offer.name), offer)
    return list(unique.values())


def hold_lease(connection: Connection, name: str, *, owner: str, now: float, seconds: float) -> bool:
    """Take or extend a role; return False if another process holds it.

    A lease that ends impossibly late (the clock was set back, or its holder's is ahead) is cut to ``seconds``: a live
    holder extends it, a dead one loses it.
    """
    until = now + seconds
    changed = connection.execute(_TAKE, {"role": name, "holder": owner, "now": now, "end": until})
    if changed.rowcount or insert_ignoring(connection, Lease, [{"name": name, "owner": owner, "until": until}]):
        return True
    connection.execute(_CUT, {"role": name, "end": until})
    return False


def renew_lease(connection: Connection, name: str, *, owner: str, until: float) -> None:
    """Extend a role that ``owner`` still holds; unlike `hold_lease` it never takes one."""
    connection.execute(update(Lease).where(Lease.name == name, Lease.owner == owner).values(until=until))


def holds_lease(connection: Connection, name: str, *, owner: str) -> bool:
    """Return True if ``owner`` still holds a role; nobody else takes it before the commit."""
    query = select(Lease.name).where(Lease.name == name, Lease.owner == owner).with_for_update()
    return connection.scalar(query) is not None


def drop_lease(connection: Connection, name: str, *, owner: str) -> None:
    """Release a role that ``owner`` holds and that is not needed again."""
    connection.execute(delete(Lease).where(Lease.name == name, Lease.owner == owner))


def release_lease(connection: Connection, name: str, *, owner: str) -> None:
    """Release a role, so that another process may take it at once."""
    connection.execute(update(Lease).where(Lease.name == name, Lease.owner == owner).values(until=0.0))
