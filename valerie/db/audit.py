"""Queries about the audit log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import datetime

from sqlalchemy import Connection, insert, select

from valerie.access import Role
from valerie.db.models import AuditEntry


@dataclass(frozen=True, slots=True)
class Entry:
    """A row of the log; see `valerie.db.models.AuditEntry`."""

    request: str
    at: datetime
    caller: str | None
    owner: str | None
    role: Role | None
    address: str
    method: str
    path: str
    status: int | None
    left_out: int = 0


def append(connection: Connection, entry: Entry) -> None:
    """Add a row."""
    connection.execute(insert(AuditEntry).values(**asdict(entry)))


def entries(connection: Connection, *, after: int = 0, limit: int | None = None) -> Iterator[tuple[int, Entry]]:
    """Yield the rows behind the number ``after``, oldest first, each with its number."""
    table = AuditEntry.__table__
    query = select(table).where(table.c.id > after).order_by(table.c.id).limit(limit)
    for row in connection.execution_options(yield_per=1_000).execute(query).mappings():
        values = dict(row)
        yield values.pop("id"), Entry(**values)
