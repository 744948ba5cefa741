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
