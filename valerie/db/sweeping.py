"""The sweeper's queries: products of dead workers, lost messages, products without a link."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final, NamedTuple

from sqlalchemy import Connection, bindparam, delete, exists, or_, select, text, update
from sqlalchemy.orm import aliased

from valerie.db.links import PRODUCT_LINKS
from valerie.db.models import Product, Run
from valerie.db.products import READY_COLUMNS, fail, fail_dependents, lock_with_dependents, to_send
from valerie.db.statements import READY, RUNNING, UNFINISHED, UNLEASED, among, in_order
from valerie.runs.products.ready import Fault, Ready
from valerie.runs.products.states import UPLOADED_ROUTE, ProductKind, ProductState, RunState

#: No product rests longer than this, seconds; see `valerie.pipeline.work.stages`.
_LONGEST_PAUSE: Final = 60.0

# Built once: building a statement costs more than executing it, and nearly every sweep finds nothing.
_LATE: Final = (
    select(Product.digest)
    .where(
        UNFINISHED,
        or_(
            RUNNING & (Product.lease_until > bindparam("longest")),
            READY & (Product.not_before > bindparam("pause")),
            READY & (Product.sent_at > bindparam("now")),
        ),
    )
    .limit(1)
)
_EXPIRED: Final = select(Product.digest).where(UNFINISHED, RUNNING, Product.lease_until < bindparam("now"))
_STALE: Final = (
    select(*READY_COLUMNS)
    .where(
        UNFINISHED,
        READY,
        or_(
            Product.sent_at < bindparam("sent"),
            Product.sent_at.is_(None) & (Product.not_before <= bindparam("now")),
        ),
        Product.route != UPLOADED_ROUTE,
    )
    .limit(bindparam("most"))
)


class Unlinked(NamedTuple):
    """A product that nothing links to."""

    digest: str
    kind: ProductKind


def bound_times(connection: Connection, *, now: float, lease_seconds: float) -> None:
    """Shorten leases and pauses that end impossibly late: the clock was set back, or the worker's is ahead."""
    longest = now + lease_seconds
    bounds = {"longest": longest, "pause": now + _LONGEST_PAUSE, "now": now}
    if connection.scalar(_LATE, bounds) is None:
        return
    held = in_order(connection.dialect.name, UNFINISHED, RUNNING, Product.lease_until > longest)
    connection.execute(update(Product).where(held).values(lease_until=longest))
    resting = in_order(connection.dialect.name, UNFINISHED, READY, Product.not_before > now + _LONGEST_PAUSE)
    connection.execute(update(Product).where(resting).values(not_before=now))
    sent = in_order(connection.dialect.name, UNFINISHED, READY, Product.sent_at > now)
    connection.execute(update(Product).where(sent).values(sent_at=now))


def take_back_expired(connection: Connection, *, now: float, max_attempts: int) -> list[Ready]:
    """Make products ready whose lease ended; return them. After ``max_attempts`` attempts they fail instead."""
    expired = (UNFINISHED, RUNNING, Product.lease_until < now)
    digests = connection.scalars(_EXPIRED, {"now": now}).all()
    if not digests:
        return []
    lock_with_dependents(connection, digests)
    hopeless = connection.execute(
        select(Product.digest, Product.kind, Product.attempts).where(*expired, Product.attempts >= max_attempts)
    ).all()
    for digest, kind, attempts in hopeless:
        message = f"the worker process died or hung in each of {attempts} attempts"
        error = Fault(stage=kind, type="WorkerLost", message=message, attempts=attempts)
        fail(connection, digest, owner=None, error=error, now=now)
    rows = connection.execute(
        update(Product)
        .where(*expired)
        .values(state=ProductState.READY, sent_at=now, **UNLEASED)
        .returning(*READY_COLUMNS)
    )
    return to_send(rows)


def stale_ready(connection: Connection, *, now: float, resend_seconds: float, limit: int) -> list[Ready]:
    """Return ready products whose last message is older than that (it was lost), or whose pause after a fault is over."""
    return to_send(connection.execute(_STALE, {"sent": now - resend_seconds, "now": now, "most": limit}))


def mark_sent(connection: Connection, digests: Collection[str], now: float) -> None:
    """Record when products were sent."""
    dialect = connection.dialect.name
    ready = in_order(dialect, among(dialect, Product.digest, digests), READY)
    connection.execute(update(Product).where(ready).values(sent_at=now))


def fail_orphaned_dependents(connection: Connection, now: float) -> None:
    """Fail every product that waits for a failed input."""
    failed = connection.scalars(
        text(
            "SELECT DISTINCT i.digest FROM products AS w JOIN products AS i ON i.digest IN (w.input_a, w.input_b, w.input_c) "
            "WHERE w.state IN ('waiting','ready','running') AND w.state = 'waiting' AND i.state = 'failed'"
        )
    ).all()
    lock_with_dependents(connection, failed)
    fail_dependents(connection, failed, now)


def park_unneeded(connection: Connection) -> None:
    """Park the products that wait or are ready and that no running run links to; those at work stay with their workers.

    Otherwise those of cancelled and paused runs would fill the feeding window, and call for workers. Predictions to be
    uploaded do neither.
    """
    keep_from_being_linked(connection)
    needed = (
        exists().where(column == Product.digest, table.run_id == Run.id, Run.state == RunState.RUNNING)
        for table, column in PRODUCT_LINKS
    )
    idle = Product.state.in_([ProductState.WAITING, ProductState.READY])
    connection.execute(
        update(Product)
        .where(UNFINISHED, idle, Product.route != UPLOADED_ROUTE, *(~link for link in needed))
        .values(state=ProductState.PARKED)
    )


def keep_from_being_linked(connection: Connection) -> None:
    """Let no other transaction write or lock products until this one ends. On SQLite, no two transactions write at a time."""
    if connection.dialect.name == "postgresql":
        # Not SHARE ROW EXCLUSIVE, which a transaction that has locked rows may pass, only to wait for this one later.
        connection.execute(text("LOCK TABLE products IN EXCLUSIVE MODE"))


def unlinked(connection: Connection, *, limit: int, digests: Collection[str] | None = None) -> list[Unlinked]:
    """Return products that nothing links to (frame, annotation, evaluation, a product stored over it) and no worker holds.

    Args:
        connection: of a transaction that writes.
        limit: most products.
        digests: of the products to look at; None: all.
    """
    keep_from_being_linked(connection)
    above = aliased(Product)
    links = [exists().where(column == Product.digest) for _, column in PRODUCT_LINKS]
    query = select(Product.digest, Product.kind).where(
        ~RUNNING,
        *(~link for link in links),
        (Product.kind != ProductKind.STATICS) | ~exists().where(above.input_a == Product.digest),
    )
    if digests is not None:
        query = query.where(among(connection.dialect.name, Product.digest, digests))
    return [Unlinked(*row) for row in connection.execute(query.limit(limit))]


def free(connection: Connection, digests: Collection[str]) -> None:
    """Delete product rows, and with them the rows that describe their content."""
    connection.execute(delete(Product).where(among(connection.dialect.name, Product.digest, digests)))
