"""Every query about registered functions under test: names, their versions by digest, who needs them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Row, delete, func, select

from valerie.db.models import Function, Run
from valerie.db.products import insert_ignoring
from valerie.db.runs import ACTIVE
from valerie.errors import Conflict

_COLUMNS = tuple(Function.__table__.columns)


def register(
    connection: Connection,
    *,
    name: str,
    digest: str,
    document: Mapping[str, Any],
    payload: str | None,
    now: datetime,
) -> bool:
    """Write the next version of a name; False when this name has this digest already.

    Raises:
        Conflict: others registered versions of this name at the same time, again and again.
    """
    for _ in range(5):
        if get(connection, name, digest) is not None:
            return False
        newest = connection.scalar(select(func.max(Function.version)).where(Function.name == name)) or 0
        row = {"name": name, "digest": digest, "version": newest + 1}
        row |= {"document": dict(document), "payload": payload, "created_at": now}
        if insert_ignoring(connection, Function, [row]):
            return True
        # On Postgres somebody else took the number, or wrote this very version, between the question and the insert.
    raise Conflict(f"the function {name} could not be registered: others register it at the same time")


def get(connection: Connection, name: str, digest: str) -> Row[Any] | None:
    """One version by its whole digest."""
    return connection.execute(select(*_COLUMNS).where(Function.name == name, Function.digest == digest)).first()


def of_digest(connection: Connection, digest: str) -> Row[Any] | None:
    """A version with this digest, whatever its name."""
    return connection.execute(select(*_COLUMNS).where(Function.digest == digest).limit(1)).first()


def versions(connection: Connection, name: str, *, prefix: str = "") -> list[Row[Any]]:
    """Versions of a name whose digest begins with ``prefix``, newest first."""
    condition = [Function.name == name]
    if prefix:
        condition.append(Function.digest.startswith(prefix, autoescape=True))
    return list(connection.execute(select(*_COLUMNS).where(*condition).order_by(Function.version.desc())))


def every(connection: Connection) -> list[Row[Any]]:
    """All versions of all names, by name, newest first."""
    return list(connection.execute(select(*_COLUMNS).order_by(Function.name, Function.version.desc())))


def remove(connection: Connection, name: str, digest: str) -> None:
    """Delete one version."""
    connection.execute(delete(Function).where(Function.name == name, Function.digest == digest))


def known_payloads(connection: Connection, digests: Iterable[str]) -> set[str]:
    """Those SHA-256 that a version needs."""
    found = connection.scalars(select(Function.payload).where(Function.payload.in_(list(digests))))
    return {payload for payload in found if payload is not None}


def unfinished_runs(connection: Connection) -> list[Row[Any]]:
    """(id, spec, pins) of every run that has not ended."""
    return list(connection.execute(select(Run.id, Run.spec, Run.pins).where(Run.state.in_(ACTIVE)).order_by(Run.id)))
