"""Queries about saved selections."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import datetime

from sqlalchemy import Connection, delete, select

from valerie.db.models import SavedSelection
from valerie.db.rows import columns_of, read_all
from valerie.db.statements import insert_ignoring
from valerie.errors import Conflict, NotFound


@dataclass(frozen=True, slots=True)
class SelectionRow:
    """A saved selection; see `valerie.db.models.SavedSelection`."""

    name: str
    runs: tuple[str, ...]
    expression: str
    view: str
    created_at: datetime


def save(connection: Connection, selection: SelectionRow) -> None:
    """Save a selection.

    Raises:
        Conflict: the name is taken.
    """
    if not insert_ignoring(connection, SavedSelection, [asdict(selection)]):
        raise Conflict(f"there is a selection {selection.name!r} already; delete it or choose another name")


def listed(connection: Connection) -> list[SelectionRow]:
    """Return all selections, newest first."""
    query = select(*columns_of(SelectionRow, SavedSelection)).order_by(
        SavedSelection.created_at.desc(), SavedSelection.name
    )
    return read_all(connection, query, SelectionRow)


def remove(connection: Connection, name: str) -> None:
    """Delete a selection.

    Raises:
        NotFound: no such selection.
    """
    if not connection.execute(delete(SavedSelection).where(SavedSelection.name == name)).rowcount:
        raise NotFound("selection", name)
