"""Copy the rows of a run from one database into another, of either kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Final, NamedTuple, TypeVar

from sqlalchemy import ColumnElement, Connection, Subquery, insert, select, union
from sqlalchemy.orm import InstrumentedAttribute

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
from valerie.db.runs import links_of
from valerie.db.statements import Values, among, insert_ignoring
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
_PARTS: Final = (FedBlock, Variant, Frame, Evaluation, FrameAnnotation, Note, MarkTag)


class StoredProduct(NamedTuple):
    """A product whose result is stored."""

    digest: str
    kind: ProductKind


class _CopiedProduct(NamedTuple):
    digest: str
    done: bool
    values: Values


def stored_products(connection: Connection, run_id: str) -> list[StoredProduct]:
    """Return the products of a run that are done, and those that they are stored over."""
    query = select(Product.digest, Product.kind).where(_needed(run_id), Product.state == ProductState.DONE)
    return [StoredProduct(digest, kind) for digest, kind in connection.execute(query)]


def copy_rows(source: Connection, target: Connection, run_id: str) -> None:
    """Copy a run with its products, its results and its marks. Products that the target has are kept.

    Raises:
        Conflict: the target has a run of this id, or has not finished or made a product that the source has.
    """
    if target.scalar(select(Run.id).where(Run.id == run_id)):
        raise Conflict(f"run {run_id} is in that deployment already")
    (run,) = _rows(source, Run, Run.id == run_id)
    parent = target.scalar(select(Run.id).where(Run.id == run["parent_run"]))
    target.execute(insert(Run), [{**run, "parent_run": parent, "idempotency_key": None}])
    for products in _chunks(_products(source, run_id)):
        _copy_products(source, target, products)
    for table in _PARTS:
        for rows in _chunks(_rows(source, table, table.run_id == run_id)):
            target.execute(insert(table), [*rows])


def _copy_products(source: Connection, target: Connection, products: list[_CopiedProduct]) -> None:
    done = {product.digest for product in products if product.done}
    condition = among(target, Product.digest, [product.digest for product in products])
    there = dict(target.execute(select(Product.digest, Product.state).where(condition)).all())
    if unfinished := [digest for digest, state in there.items() if digest in done and state is not ProductState.DONE]:
        raise Conflict(
            f"{len(unfinished):,} products of the run are {there[unfinished[0]]} in that deployment (first "
            f"{unfinished[0]}): copy it when the runs there that need them have ended, or retry these"
        )
    new = [product for product in products if product.digest not in there]
    insert_ignoring(target, Product, [product.values for product in new])
    for table, column in _CONTENTS.items():
        condition = among(source, column, [product.digest for product in new])
        for rows in _chunks(_rows(source, table, condition)):
            target.execute(insert(table), [*rows])


def _products(connection: Connection, run_id: str) -> Iterator[_CopiedProduct]:
    """Yield the rows of a run's products and of their inputs, without leases: in a copy nobody works on them."""
    for row in _rows(connection, Product, _needed(run_id), Product.digest):
        state = row["state"] if row["state"] in (ProductState.DONE, ProductState.FAILED) else ProductState.PARKED
        values = {**row, "state": state, "lease_owner": None, "lease_until": None, "sent_at": None, "not_before": None}
        yield _CopiedProduct(str(row["digest"]), state is ProductState.DONE, values)


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
