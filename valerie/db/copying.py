"""Copy the rows of a run from one database into another, of either kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Final, NamedTuple, TypeVar

from sqlalchemy import ColumnElement, Connection, Subquery, delete, insert, select, union
from sqlalchemy.orm import InstrumentedAttribute

from valerie.db.links import links_of
from valerie.db.models import (
    Base,
    Evaluation,
    FedBlock,
    Frame,
    FrameAnnotation,
    MarkTag,
    Note,
    PersonLight,
    PersonScore,
    PersonView,
    Picture,
    Product,
    Run,
    Score,
    Variant,
)
from valerie.db.statements import UNLEASED, Values, among, insert_ignoring
from valerie.errors import Conflict
from valerie.runs.products.states import ProductKind, ProductState

R = TypeVar("R")

#: Rows per statement.
_CHUNK: Final = 1_000
#: The tables that describe the content of products, each with the product's column.
_CONTENTS: Final[Mapping[type[Base], InstrumentedAttribute[str]]] = {
    PersonView: PersonView.truth,
    PersonLight: PersonLight.product,
    Picture: Picture.prediction,
    Score: Score.digest,
    PersonScore: PersonScore.digest,
}
#: The rows of a run, tables that others refer to first.
PARTS: Final = (FedBlock, Variant, Frame, Evaluation, FrameAnnotation)
_MARKS: Final = (Note, MarkTag)
_UNFINISHED: Final = (ProductState.WAITING, ProductState.READY, ProductState.RUNNING)
_PARKED: Final = {"state": ProductState.PARKED, "sent_at": None, "not_before": None, **UNLEASED}
#: All tables of `copy_contents`.
TABLES: Final[tuple[type[Base], ...]] = (*PARTS, Product, *_CONTENTS)


class NeededProduct(NamedTuple):
    """A product of a run, or an input of one."""

    digest: str
    kind: ProductKind
    state: ProductState


class _CopiedProduct(NamedTuple):
    digest: str
    done: bool
    values: Values


def stored_products(connection: Connection, run_id: str) -> list[NeededProduct]:
    """Return the products of a run that are done, and those that they are stored over."""
    return [product for product in needed_products(connection, run_id) if product.state is ProductState.DONE]


def needed_products(connection: Connection, run_id: str) -> list[NeededProduct]:
    """Return the products of a run, and those that they are stored over."""
    query = select(Product.digest, Product.kind, Product.state).where(_needed(run_id))
    return [NeededProduct(*row) for row in connection.execute(query)]


def copy_rows(source: Connection, target: Connection, run_id: str) -> None:
    """Copy a run with its products, its results and its marks. Products that the target has are kept.

    Raises:
        Conflict: the target has a run of this id, or has not finished or made a product that the source has.
    """
    if target.scalar(select(Run.id).where(Run.id == run_id)):
        raise Conflict(f"run {run_id} is in that deployment already")
    (run,) = _rows(source, Run, Run.id == run_id)
    parent = target.scalar(select(Run.id).where(Run.id == run["parent_run"]))
    target.execute(insert(Run), [{**run, "parent_run": parent, "idempotency_key": None, "archive": None}])
    copy_contents(source, target, run_id)
    _copy_marks(source, target, run_id)


def copy_head(source: Connection, target: Connection, run_id: str) -> None:
    """Copy a run's own row, as it is, and its marks."""
    target.execute(insert(Run), [*_rows(source, Run, Run.id == run_id)])
    _copy_marks(source, target, run_id)


def copy_contents(
    source: Connection, target: Connection, run_id: str, *, after_chunk: Callable[[], None] = lambda: None
) -> None:
    """Copy all rows of a run but its own and its marks. Rows that the target has are kept.

    Links come before products, which `gc` would remove without them.

    Args:
        source, target: from and to.
        run_id: id of the run.
        after_chunk: called after a few thousand rows.

    Raises:
        Conflict: the target has not finished or made a product that the source has.
    """
    for table in PARTS:
        for rows in _chunks(_rows(source, table, table.run_id == run_id)):
            insert_ignoring(target, table, rows)
            after_chunk()
    for products in _chunks(_products(source, run_id)):
        _copy_products(source, target, products)
        after_chunk()


def _copy_marks(source: Connection, target: Connection, run_id: str) -> None:
    for table in _MARKS:
        for rows in _chunks(_rows(source, table, table.run_id == run_id)):
            target.execute(insert(table), [*rows])


def _copy_products(source: Connection, target: Connection, products: list[_CopiedProduct]) -> None:
    done = {product.digest for product in products if product.done}
    # What nobody there needed was given up, and may be replaced.
    target.execute(
        delete(Product).where(among(target.dialect.name, Product.digest, done), Product.state == ProductState.PARKED)
    )
    condition = among(target.dialect.name, Product.digest, [product.digest for product in products])
    there = dict(target.execute(select(Product.digest, Product.state).where(condition)).all())
    if unfinished := [digest for digest, state in there.items() if digest in done and state is not ProductState.DONE]:
        raise Conflict(
            f"{len(unfinished):,} products of the run are {there[unfinished[0]]} where its rows would go (first "
            f"{unfinished[0]}): wait until the runs there that need them have ended, or retry these"
        )
    new = [product for product in products if product.digest not in there]
    insert_ignoring(target, Product, [product.values for product in new])
    for table, column in _CONTENTS.items():
        condition = among(source.dialect.name, column, [product.digest for product in new])
        for rows in _chunks(_rows(source, table, condition)):
            target.execute(insert(table), [*rows])


def _products(connection: Connection, run_id: str) -> Iterator[_CopiedProduct]:
    """Yield the rows of a run's products and of their inputs; unfinished ones parked, since in a copy nobody works on them."""
    for row in _rows(connection, Product, _needed(run_id), Product.digest):
        if row["state"] in _UNFINISHED:
            yield _CopiedProduct(str(row["digest"]), done=False, values={**row, **_PARKED})
        else:
            yield _CopiedProduct(str(row["digest"]), row["state"] is ProductState.DONE, row)


def _needed(run_id: str) -> ColumnElement[bool]:
    """Return the condition that a product is one of a run, or an input of one."""
    links = links_of(run_id)
    inputs = (
        select(column).join(links, links.c[0] == Product.digest).where(column.is_not(None))
        for column in (Product.input_a, Product.input_b, Product.input_c)
    )
    needed: Subquery = union(select(links.c[0]), *inputs).subquery()
    return Product.digest.in_(select(needed.c[0]))


def _rows(
    connection: Connection, table: type[Base], condition: ColumnElement[bool], *order: InstrumentedAttribute[str]
) -> Iterator[Values]:
    query = select(*table.__table__.columns).where(condition).order_by(*order)
    for row in connection.execution_options(yield_per=_CHUNK).execute(query).mappings():
        yield {str(column): value for column, value in row.items()}


def _chunks(rows: Iterator[R]) -> Iterator[list[R]]:
    while chunk := list(islice(rows, _CHUNK)):
        yield chunk
