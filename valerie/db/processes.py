"""Every query about processes: the workers that are alive, what they offer, and who holds a role."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, Row, delete, select, update

from valerie.db.models import Lease, Worker
from valerie.db.products import insert_ignoring

#: A worker that was not seen for this long is taken for dead.
ALIVE_SECONDS = 20.0


def register_worker(connection: Connection, values: dict[str, Any]) -> None:
    """Write a worker's row, replacing one of the same id; rows of the long dead go."""
    connection.execute(delete(Worker).where((Worker.id == values["id"]) | (Worker.seen_at < values["seen_at"] - 3600)))
    insert_ignoring(connection, Worker, [values])


def worker_seen(connection: Connection, worker_id: str, now: float) -> bool:
    """Heartbeat; False when the row is gone and has to be registered again."""
    return connection.execute(update(Worker).where(Worker.id == worker_id).values(seen_at=now)).rowcount == 1


def remove_worker(connection: Connection, worker_id: str) -> None:
    """A worker says goodbye."""
    connection.execute(delete(Worker).where(Worker.id == worker_id))


def workers(connection: Connection, *, now: float) -> list[Row[Any]]:
    """Workers that are alive, longest-serving first."""
    return list(
        connection.execute(
            select(*Worker.__table__.columns).where(Worker.seen_at > now - ALIVE_SECONDS).order_by(Worker.started_at)
        )
    )


def offers(connection: Connection, *, now: float) -> list[dict[str, Any]]:
    """What the living workers can make, without repetition."""
    unique: dict[str, dict[str, Any]] = {}
    for worker in workers(connection, now=now):
        for offer in worker.offers:
            unique.setdefault(f"{offer['route']}/{offer['name']}", dict(offer))
    return list(unique.values())


def hold_lease(connection: Connection, name: str, *, owner: str, now: float, seconds: float) -> bool:
    """Take or prolong a role; False when another process holds it."""
    insert_ignoring(connection, Lease, [{"name": name, "owner": owner, "until": 0.0}])
    changed = connection.execute(
        update(Lease)
        .where(Lease.name == name, (Lease.owner == owner) | (Lease.until < now))
        .values(owner=owner, until=now + seconds)
    )
    return changed.rowcount == 1


def release_lease(connection: Connection, name: str, *, owner: str) -> None:
    """Give a role up, so that another process may take it at once."""
    connection.execute(update(Lease).where(Lease.name == name, Lease.owner == owner).values(until=0.0))
