"""Writing rows by the thousand: one prepared statement, tuples, no per-row work in Python.

SQLAlchemy's own executemany builds a dictionary and runs a type's processor for every value; for the rows of a large run that
is a third of all feeding. Values must already be what the driver takes (JSON as text).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection

from valerie.db.models import Base


def insert_rows(
    connection: Connection,
    model: type[Base],
    columns: Sequence[str],
    rows: Sequence[tuple[Any, ...]],
    *,
    on_conflict: str = "",
) -> None:
    """Insert tuples in the order of ``columns``.

    Args:
        connection: SQLite or Postgres.
        model: the table.
        columns: names of its columns.
        rows: one tuple per row; may be empty.
        on_conflict: SQL after ``ON CONFLICT``; empty: a conflict is an error.
    """
    if not rows:
        return
    mark = "%s" if connection.dialect.name == "postgresql" else "?"
    names = ", ".join(f'"{name}"' for name in columns)
    marks = ", ".join([mark] * len(columns))
    conflict = f" ON CONFLICT {on_conflict}" if on_conflict else ""
    statement = f'INSERT INTO "{model.__tablename__}" ({names}) VALUES ({marks}){conflict}'  # noqa: S608  our own names
    connection.exec_driver_sql(statement, list(rows))
