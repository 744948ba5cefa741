"""Queries about the variants of a run."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

from sqlalchemy import Connection, func, select

from valerie.db.models import Assignment, Variant
from valerie.db.rows import columns_of, read_all


@dataclass(frozen=True, slots=True)
class VariantRow:
    """A variant; see `valerie.db.models.Variant`."""

    index: int
    block: int
    assignment: Assignment
    rejection: str | None


def rejections(connection: Connection, run_id: str) -> dict[str, int]:
    """Return the number of rejected variants by reason."""
    rows = connection.execute(
        select(Variant.rejection, func.count())
        .where(Variant.run_id == run_id, Variant.rejection.is_not(None))
        .group_by(Variant.rejection)
    )
    return {str(reason): int(count) for reason, count in rows}


def page(
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


def assignments(connection: Connection, run_id: str, among: Set[int] | None = None) -> dict[int, Assignment]:
    """Read index and assignment of the variants of a run that have frames; None: of all, else of those ``among`` some."""
    query = select(Variant.index, Variant.assignment).where(Variant.run_id == run_id, Variant.rejection.is_(None))
    if among is not None:
        query = query.where(Variant.index.between(min(among, default=0), max(among, default=-1)))
    # By position: `index` is a method of every row.
    return {index: assignment for index, assignment in connection.execute(query) if among is None or index in among}
