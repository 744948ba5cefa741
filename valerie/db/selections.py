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
    project: str = ""


def save(connection: Connection, selection: SelectionRow) -> None:
    """Save a selection.

    Raises:
        Conflict: the name is taken.
    """
    if not insert_ignoring(connection, SavedSelection, [asdict(selection)]):
        raise Conflict(f"there is a selection {selection.name!r} already; delete it or choose another name")


def listed(connection: Connection, *, project: str = "") -> list[SelectionRow]:
    """Return the selections of a project, or those of none, newest first."""
    query = select(*columns_of(SelectionRow, SavedSelection)).where(SavedSelection.project == project)
    newest = query.order_by(SavedSelection.created_at.desc(), SavedSelection.name)
    return read_all(connection, newest, SelectionRow)


def remove(connection: Connection, name: str, *, project: str = "") -> None:
    """Delete a selection of a project, or one of none.

    Raises:
        NotFound: no such selection.
    """
    its = SavedSelection.project == project, SavedSelection.name == name
    if not connection.execute(delete(SavedSelection).where(*its)).rowcount:
        raise NotFound("selection", name)
