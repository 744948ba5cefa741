"""Queries of the end of a run that does not keep all its pictures."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import astuple
from typing import Any, Final

from sqlalchemy import ColumnElement, Connection, bindparam, literal, or_, select, union, update

from valerie.db.archives import stored_in_archives
from valerie.db.links import PICTURE_LINKS, OfFrames, frame_order, key_of, same_frame
from valerie.db.long_table import COLUMNS
from valerie.db.models import Evaluation, Frame, PersonScore, Product
from valerie.db.statements import among
from valerie.db.sweeping import Unlinked, keep_from_being_linked
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.states import UPLOADED_ROUTE, ProductKind, ProductState

#: Parameters that name a frame; those of `names_frame` have names of columns, which an update reserves.
_PLACE: Final = ("of_run", "of_variant", "of_camera", "of_time")
#: Kinds of products that are numbers only, or have no links of their own.
_STAYING: Final = (ProductKind.EVALUATION, ProductKind.LIGHT, ProductKind.STATICS)


def kept_frames(connection: Connection, run_id: str, first: int, last: int) -> set[FrameKey]:
    """Return the frames of the variants ``first`` … ``last`` that the run keeps at present."""
    of_variants = Frame.run_id == run_id, Frame.variant_index.between(first, last)
    rows = connection.execute(select(*frame_order(Frame)).where(*of_variants, Frame.removed.is_(None)))
    return {key_of(run_id, row) for row in rows}


def failing_frames(connection: Connection, run_id: str, first: int, last: int, *, threshold: float) -> set[FrameKey]:
    """Return the frames of these variants that lack scores, or have a person with a pACC below ``threshold``."""
    rows = connection.execute(
        select(*frame_order(Evaluation))
        .distinct()
        .join(Product, Product.digest == Evaluation.scores)
        .outerjoin(PersonScore, PersonScore.digest == Evaluation.scores)
        .where(Evaluation.run_id == run_id, Evaluation.variant_index.between(first, last))
        .where(or_(Product.state != ProductState.DONE, COLUMNS["pacc"] < threshold))
    )
    return {key_of(run_id, row) for row in rows}


def mark_removed(connection: Connection, frames: Collection[FrameKey], reason: str) -> None:
    """Record why a run no longer keeps the pictures of some of its frames."""
    if frames:
        columns = (Frame.run_id, *frame_order(Frame))
        named = (column == bindparam(place) for column, place in zip(columns, _PLACE, strict=True))
        values = [dict(zip(_PLACE, astuple(key), strict=True)) for key in frames]
        connection.execute(update(Frame).where(*named).values(removed=reason), values)


def keep_all(connection: Connection, run_id: str) -> None:
    """Take back `mark_removed` for all frames of a run, which makes them again."""
    connection.execute(update(Frame).where(Frame.run_id == run_id, Frame.removed.is_not(None)).values(removed=None))


def park_unkept(connection: Connection, run_id: str, first: int, last: int) -> list[Unlinked]:
    """Park the stored products of these variants that no frame of any run keeps, as if never made; return them.

    Their numbers stay. No other transaction links or publishes products until this one ends.
    """
    of_variants = (
        select(column).where(table.run_id == run_id, table.variant_index.between(first, last))
        for table, column in PICTURE_LINKS
    )
    return _park(connection, Product.digest.in_(union(*of_variants)))


def park_still_unkept(connection: Connection, digests: Collection[str]) -> list[Unlinked]:
    """Park those of some products that are `unkept` now, as `park_unkept` does."""
    return _park(connection, among(connection.dialect.name, Product.digest, digests))


def unkept(connection: Connection, *conditions: ColumnElement[bool]) -> list[Unlinked]:
    """Return stored products, which meet the conditions, that no frame links to which its run keeps, and no archived run."""
    rows = connection.execute(
        select(Product.digest, Product.kind).where(
            Product.state == ProductState.DONE,
            Product.kind.not_in(_STAYING),
            Product.route != UPLOADED_ROUTE,  # nobody could make it again
            *conditions,
            *(~_kept_by(table, column) for table, column in PICTURE_LINKS),
        )
    )
    products = [Unlinked(*row) for row in rows]
    archived = stored_in_archives(connection, [product.digest for product in products])
    return [product for product in products if product.digest not in archived]


def _park(connection: Connection, condition: ColumnElement[bool]) -> list[Unlinked]:
    keep_from_being_linked(connection)
    products = unkept(connection, condition)
    parked = among(connection.dialect.name, Product.digest, [product.digest for product in products])
    connection.execute(update(Product).where(parked).values(state=ProductState.PARKED))
    return products


def _kept_by(table: OfFrames, column: Any) -> ColumnElement[bool]:
    """Return the condition that a frame of any run links to a product and keeps it."""
    link = select(literal(1)).where(column == Product.digest, Frame.removed.is_(None))
    return (link if table is Frame else link.where(same_frame(table))).correlate(Product).exists()
