"""Numbers about products: the backlog, totals and costs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final, NamedTuple

from sqlalchemy import BigInteger, ColumnElement, Connection, cast, func, literal, select

from valerie.db.archives import stored_in_archives
from valerie.db.models import Product
from valerie.db.statements import ENDED, RUNNING, UNFINISHED, among
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import UPLOADED_ROUTE, ProductKind, ProductState

#: Cache group of the evaluations of uploaded predictions.
UPLOADED_GROUP: Final = "uploaded"
_BACKLOG: Final = (
    select(Product.route, Product.state, func.count())
    .where(UNFINISHED, Product.route != UPLOADED_ROUTE)
    .group_by(Product.route, Product.state)
)


class Backlog(NamedTuple):
    """Unfinished products of one route in one state."""

    route: str
    state: ProductState
    products: int


class KindTotal(NamedTuple):
    """All products of one kind: numbers of done and failed ones, and CPU seconds of the done ones."""

    kind: ProductKind
    done: int
    failed: int
    cpu_seconds: float


class HeldProducts(NamedTuple):
    """Products of one kind that one process makes now."""

    owner: str
    kind: ProductKind
    products: int


class CostBin(NamedTuple):
    """The cost of the products of one kind that were finished in one span of time.

    Attributes:
        kind: of the products.
        number: of the span, from 0.
        products: that were done.
        cpu_seconds: of all of them.
    """

    kind: ProductKind
    number: int
    products: int
    cpu_seconds: float


class FailureReason(NamedTuple):
    """Products of one kind that failed for good with one type of error.

    Attributes:
        kind: of the products.
        type: name of the error's class.
        products: how many.
        message: of the latest.
        latest: when it failed, Unix seconds.
    """

    kind: ProductKind
    type: str
    products: int
    message: str
    latest: float


class NewestCosts(NamedTuple):
    """CPU seconds of the newest finished products of one kind."""

    kind: ProductKind
    cpu_seconds: list[float]


@dataclass(frozen=True, slots=True)
class RecordedCost:
    """Means over ``count`` finished products of one kind, route and size.

    Attributes:
        kind, route: of the products.
        group: cache group of predictions, one per function; empty for other kinds, whose groups do not last.
        pixels: size of their images.
        count: number of products.
        cpu_seconds: mean without the costliest product, unless it is the only one: a worker's first product includes
            loading.
        bytes: mean size of an object.
    """

    kind: ProductKind
    route: str
    group: str
    pixels: int
    count: int
    cpu_seconds: float
    bytes: float


def unfinished_count(connection: Connection) -> int:
    """Return the number of waiting, ready and running products, which the feeding window limits.

    Uploaded predictions and their evaluations are left out: otherwise the frames of a large run would not all be rendered
    before the first label maps arrived.
    """
    uploaded = (Product.route == UPLOADED_ROUTE) | (Product.cache_group == UPLOADED_GROUP)
    return connection.scalar(select(func.count()).select_from(Product).where(UNFINISHED, ~uploaded)) or 0


def backlog(connection: Connection) -> list[Backlog]:
    """Return the number of unfinished products by route and state, without predictions to be uploaded, which no worker makes."""
    return [Backlog(*row) for row in connection.execute(_BACKLOG)]


def totals(connection: Connection) -> list[KindTotal]:
    """Return the totals of every kind, read from an index."""
    rows = connection.execute(
        select(Product.kind, Product.state, func.count(), func.sum(Product.cpu_seconds))
        .where(ENDED)
        .group_by(Product.kind, Product.state)
    )
    ended = {(kind, state): (count, float(seconds or 0.0)) for kind, state, count, seconds in rows}

    def total(kind: ProductKind) -> KindTotal:
        done, seconds = ended.get((kind, ProductState.DONE), (0, 0.0))
        failed, _ = ended.get((kind, ProductState.FAILED), (0, 0.0))
        return KindTotal(kind, done, failed, seconds)

    return [total(kind) for kind in sorted(ProductKind)]


def held(connection: Connection) -> list[HeldProducts]:
    """Return the products that each process makes now, by the names in leases (see `valerie.pipeline.base.context.Context`)."""
    rows = connection.execute(
        select(Product.lease_owner, Product.kind, func.count())
        .where(UNFINISHED, RUNNING, Product.lease_owner.is_not(None))
        .group_by(Product.lease_owner, Product.kind)
    )
    return [HeldProducts(owner, kind, count) for owner, kind, count in rows if owner is not None]


def done_since(connection: Connection, since: float) -> dict[str, int]:
    """Return how many products of each route were done after a moment, Unix seconds."""
    rows = connection.execute(select(Product.route, func.count()).where(*_done_after(since)).group_by(Product.route))
    return {route: int(count) for route, count in rows}


def costs_since(connection: Connection, since: int, width: int) -> list[CostBin]:
    """Return the cost of products by kind and span of time.

    Args:
        connection: to read with.
        since: beginning of the first span, Unix seconds.
        width: of a span, seconds.
    """
    number = (cast(Product.finished_at, BigInteger) - since) // width
    rows = connection.execute(
        select(Product.kind, number, func.count(), func.sum(Product.cpu_seconds))
        .where(*_done_after(float(since)), Product.cpu_seconds.is_not(None))
        .group_by(Product.kind, number)
        .order_by(Product.kind, number)
    )
    return [CostBin(kind, int(span), count, float(seconds or 0.0)) for kind, span, count, seconds in rows]


def newest_costs(connection: Connection, *, newest: int) -> list[NewestCosts]:
    """Return the CPU seconds of the ``newest`` finished products of each kind that has any, read from an index."""
    costs = []
    for kind in ProductKind:
        query = (
            select(Product.cpu_seconds)
            .where(ENDED, Product.kind == kind, Product.state == ProductState.DONE, Product.cpu_seconds.is_not(None))
            .order_by(Product.finished_at.desc())
            .limit(newest)
        )
        if seconds := [float(value) for value in connection.scalars(query) if value is not None]:
            costs.append(NewestCosts(kind, seconds))
    return costs


def _done_after(since: float) -> tuple[ColumnElement[bool], ...]:
    # All kinds by name: the index begins with the kind.
    return (
        ENDED,
        Product.kind.in_(list(ProductKind)),
        Product.state == ProductState.DONE,
        Product.finished_at >= since,
    )


def failure_reasons(connection: Connection, *, newest: int = 5_000) -> list[FailureReason]:
    """Return the reasons of the ``newest`` products that failed for good, the most frequent first.

    Products that failed with an input are not counted.
    """
    rows = connection.execute(
        select(Product.kind, Product.error, Product.finished_at)
        .where(ENDED, Product.kind.in_(list(ProductKind)), Product.state == ProductState.FAILED)
        .order_by(Product.finished_at.desc())
        .limit(newest)
    )
    reasons: dict[tuple[ProductKind, str], FailureReason] = {}
    for kind, error, finished_at in rows:
        if isinstance(error, Fault):
            latest = FailureReason(kind, error.type, 0, error.message, finished_at or 0.0)
            earlier = reasons.get((kind, error.type), latest)
            reasons[kind, error.type] = earlier._replace(products=earlier.products + 1)
    return sorted(reasons.values(), key=lambda reason: -reason.products)


def done_digests(connection: Connection, digests: Collection[str]) -> set[str]:
    """Return the ``digests`` whose products are done."""
    condition = among(connection.dialect.name, Product.digest, digests)
    return set(connection.scalars(select(Product.digest).where(condition, Product.state == ProductState.DONE)))


def wanted_digests(connection: Connection, digests: Collection[str]) -> set[str]:
    """Return the ``digests`` of products that are done, failed or to be made: not parked, or stored for an archived run."""
    condition = among(connection.dialect.name, Product.digest, digests)
    rows = set(connection.scalars(select(Product.digest).where(condition, Product.state != ProductState.PARKED)))
    # Second: a run's rows leave the database after it is archived.
    return rows | stored_in_archives(connection, digests)


def recorded_costs(connection: Connection, *, sample: int = 400) -> list[RecordedCost]:
    """Return the costs of the newest ``sample`` finished products of each kind."""
    costs: list[RecordedCost] = []
    for kind in ProductKind:
        if kind is ProductKind.STATICS:  # made with a truth, at no cost of its own
            continue
        group = Product.cache_group if kind is ProductKind.PREDICTION else literal("")
        newest = (
            select(Product.route, group.label("grouped"), Product.cpu_seconds, Product.bytes, Product.pixels)
            .where(ENDED, Product.kind == kind, Product.state == ProductState.DONE, Product.cpu_seconds.is_not(None))
            .order_by(Product.finished_at.desc())
            .limit(sample)
            .subquery()
        )
        keys = (newest.c.route, newest.c.grouped, newest.c.pixels)
        seconds = newest.c.cpu_seconds
        rows = connection.execute(
            select(*keys, func.count(), func.sum(seconds), func.max(seconds), func.avg(newest.c.bytes)).group_by(*keys)
        )
        for route, grouped, pixels, count, total, dearest, size in rows:
            mean = total if count == 1 else (total - dearest) / (count - 1)
            costs.append(RecordedCost(kind, route, grouped, int(pixels), count, float(mean), float(size)))
    return costs
