"""The life cycle of a product: wanted, claimed, published or failed.

States: *waiting* (inputs are missing) → *ready* (a message may be under way) → *running* (leased) → *done* or *failed*;
*parked* products have no link at present. All changes are compare-and-set: messages may be lost or arrive twice.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from functools import cache
from operator import attrgetter
from typing import Final, NamedTuple

from sqlalchemy import ColumnElement, Connection, Executable, Row, bindparam, func, select, text, union, update

from valerie.db.models import Product
from valerie.db.statements import RUNNING, UNFINISHED, UNLEASED, WAITING, among, in_order, insert_rows, lock
from valerie.runs.products.ready import FailedInput, ProductError, Ready
from valerie.runs.products.states import UPLOADED_ROUTE, ProductKind, ProductState
from valerie.runs.products.turns import Turns

READY_COLUMNS: Final = (Product.digest, Product.kind, Product.route, Product.cache_group, Product.turn)
_INPUTS: Final = (Product.input_a, Product.input_b, Product.input_c)
_INPUTS_DONE: Final = text(
    "NOT EXISTS (SELECT 1 FROM products AS i"
    " WHERE i.digest IN (products.input_a, products.input_b, products.input_c) AND i.state <> 'done')"
)
#: States from which a product is tried again when a run wants it.
_TRIED_AGAIN: Final = (ProductState.FAILED, ProductState.PARKED)


class Wanted(NamedTuple):
    """A product that a run links to; the inputs are digests of products that must be done first."""

    digest: str
    kind: ProductKind
    route: str
    cache_group: str
    input_a: str | None = None
    input_b: str | None = None
    input_c: str | None = None


class _NewProduct(NamedTuple):
    """The columns of a product that is inserted."""

    digest: str
    kind: str
    route: str
    cache_group: str
    input_a: str | None
    input_b: str | None
    input_c: str | None
    state: str
    owner: str
    turn: float
    sent_at: float | None
    attempts: int = 0


def want(connection: Connection, wanted: Collection[Wanted], now: float, turns: Turns) -> list[Ready]:
    """Insert products that a run links to; return those to announce: they became ready, or are ready and have an earlier turn.

    A product is ready once all its inputs are done. Existing products stay as they are, except that failed and parked ones
    are tried again, and an unfinished one gets the sooner turn of the runs that want it.

    Args:
        connection: to write with.
        wanted: the products, in the order in which they are to be made.
        now: Unix seconds.
        turns: gives the unfinished ones their turns.
    """
    links = (link for product in wanted for link in (product.digest, product.input_a, product.input_b, product.input_c))
    digests = {digest for digest in links if digest is not None}
    # A worker must not park what this transaction is about to link.
    lock(connection, digests)
    columns = Product.digest, Product.state, Product.owner, Product.turn
    present = connection.execute(select(*columns).where(among(connection.dialect.name, Product.digest, digests)))
    states = {digest: (state, owner, turn) for digest, state, owner, turn in present}
    done: set[str | None] = {None, *(digest for digest, (state, *_) in states.items() if state is ProductState.DONE)}
    rows: list[_NewProduct] = []
    ready: list[Ready] = []
    sooner: list[dict[str, str | float]] = []
    for product in wanted:
        digest, kind, route, group, a, b, c = product
        state, present_owner, present_turn = states.get(digest, (None, "", 0.0))
        if state is ProductState.DONE:
            continue
        # No worker takes a prediction that is to be uploaded.
        turn = 0.0 if route == UPLOADED_ROUTE else turns.take(route, kind, group)
        if state is not None and state not in _TRIED_AGAIN:
            if route != UPLOADED_ROUTE and turns.is_sooner(turn, present_turn, present_owner):
                sooner.append({"product": digest, "sooner": turn})
                if state is ProductState.READY:
                    ready.append(Ready(digest, kind, route, group, turn))
            continue
        state, sent_at = (ProductState.READY, now) if done.issuperset((a, b, c)) else (ProductState.WAITING, None)
        rows.append(_NewProduct(digest, str(kind), route, group, a, b, c, str(state), turns.owner, turn, sent_at))
        if sent_at is not None and route != UPLOADED_ROUTE:
            ready.append(Ready(digest, kind, route, group, turn))
    rows.sort(key=attrgetter("digest"))  # neighbours in the primary key's pages, one after the other
    insert_rows(
        connection,
        Product,
        _NewProduct,
        rows,
        on_conflict=(
            "(digest) DO UPDATE SET state = excluded.state, owner = excluded.owner, turn = excluded.turn, attempts = 0,"
            " error = NULL, lease_owner = NULL, lease_until = NULL, sent_at = excluded.sent_at, not_before = NULL"
            " WHERE products.state IN ('failed', 'parked')"
        ),
    )
    if sooner:
        table = Product.__table__
        moved = {"owner": turns.owner, "turn": bindparam("sooner")}
        connection.execute(update(table).where(table.c.digest == bindparam("product")).values(moved), sooner)  # type: ignore[arg-type]
    return ready


def present_turns(connection: Connection) -> dict[str, float]:
    """Return owner to the earliest turn of the line that a worker serves, or the earliest of all while none does.

    A run that begins or continues starts at this turn. Owners without unfinished products are left out.
    """
    # Predictions to be uploaded have no turn.
    unfinished = UNFINISHED, Product.route != UPLOADED_ROUTE
    earliest = select(Product.owner, func.min(Product.turn)).where(*unfinished).group_by(Product.owner)
    every = {owner: turn for owner, turn in connection.execute(earliest)}  # noqa: C416  # mypy reads the types of rows
    served = connection.execute(earliest.where(RUNNING))
    return every | {owner: turn for owner, turn in served}  # noqa: C416


def revive(connection: Connection, digests: Collection[str]) -> None:
    """Reset the failed and parked products among ``digests`` to waiting, as if never tried."""
    dialect = connection.dialect.name
    connection.execute(
        update(Product)
        .where(in_order(dialect, among(dialect, Product.digest, digests), Product.state.in_(_TRIED_AGAIN)))
        .values(state=ProductState.WAITING, attempts=0, error=None, sent_at=None, not_before=None, **UNLEASED)
    )


def promote(connection: Connection, digests: Collection[str], now: float) -> list[Ready]:
    """Make the waiting products among ``digests`` ready whose inputs are all done; return them."""
    return _promote(connection, _among_them, now, digests)


def promote_dependents(connection: Connection, inputs: Collection[str], now: float) -> list[Ready]:
    """Make products ready whose last missing inputs were ``inputs``; return them.

    Call it in its own transaction, after the one that finished the inputs: if two workers finish the two inputs of one
    product at the same time, the later one then sees both.
    """
    return _promote(connection, _dependent, now, inputs)


def promote_all(connection: Connection, now: float) -> list[Ready]:
    """Make every waiting product ready whose inputs are done; return them."""
    return _promote(connection, _unfinished, now, ())


def _among_them(dialect: str) -> ColumnElement[bool]:
    return among(dialect, Product.digest)


def _dependent(dialect: str) -> ColumnElement[bool]:
    # One SELECT per column: SQLite reads no partial index for the parts of an OR.
    return Product.digest.in_(union(*(select(Product.digest).where(WAITING, among(dialect, x)) for x in _INPUTS)))


def _unfinished(_: str) -> ColumnElement[bool]:
    return UNFINISHED


def _promote(
    connection: Connection, condition: Callable[[str], ColumnElement[bool]], now: float, digests: Collection[str]
) -> list[Ready]:
    statement = _promotion(connection.dialect.name, condition)
    return to_send(connection.execute(statement, {"digests": digests, "now": now}))


# Building a statement costs several times as much as executing it on a few products.
@cache
def _promotion(dialect: str, condition: Callable[[str], ColumnElement[bool]]) -> Executable:
    return (
        update(Product)
        .where(in_order(dialect, WAITING, condition(dialect), _INPUTS_DONE))
        .values(state=ProductState.READY, sent_at=bindparam("now"))
        .returning(*READY_COLUMNS)
    )


def to_send(rows: Iterable[Row[str, ProductKind, str, str, float]]) -> list[Ready]:
    """Return rows of `READY_COLUMNS` without uploaded predictions, which no worker makes."""
    return [ready for row in rows if (ready := Ready(*row)).route != UPLOADED_ROUTE]


def fail(connection: Connection, digest: str, *, owner: str | None, error: ProductError, now: float) -> None:
    """Record the final failure of an unfinished product and of every product that waits for it.

    Args:
        connection: to write with.
        digest: the product.
        owner: required holder; None: any.
        error: the cause.
        now: Unix seconds.
    """
    lock_with_dependents(connection, [digest])
    condition = [Product.digest == digest]
    if owner is not None:
        condition.append(Product.lease_owner == owner)
    changed = connection.execute(
        update(Product)
        .where(*condition, UNFINISHED)
        .values(state=ProductState.FAILED, error=error, finished_at=now, **UNLEASED)
    )
    if changed.rowcount:
        fail_dependents(connection, [digest], now)


def fail_dependents(connection: Connection, failed: Iterable[str], now: float) -> None:
    """Fail every product that waits for one of ``failed``, directly or not; each names its failed input."""
    causes = list(failed)
    while causes:
        cause = causes.pop()
        waiting = [select(Product.digest).where(WAITING, column == cause) for column in _INPUTS]
        causes += connection.scalars(
            update(Product)
            .where(WAITING, Product.digest.in_(union(*waiting)))
            .values(state=ProductState.FAILED, error=FailedInput(cause=cause), finished_at=now)
            .returning(Product.digest)
        )


def lock_with_dependents(connection: Connection, digests: Iterable[str]) -> None:
    """Lock products, and all that wait for one of them, directly or not, until the commit."""
    if connection.dialect.name != "postgresql":
        return
    family, generation = set[str](), set(digests)
    while generation:
        family |= generation
        waiting = select(Product.digest).where(_dependent(connection.dialect.name))
        generation = set(connection.scalars(waiting, {"digests": generation})) - family
    lock(connection, family)


def forget(connection: Connection, digests: Collection[str]) -> None:
    """Have finished products made again, whose objects are missing or damaged."""
    connection.execute(
        update(Product)
        .where(in_order(connection.dialect.name, Product.digest.in_(digests), Product.state == ProductState.DONE))
        .values(state=ProductState.WAITING, sent_at=None)
    )
