"""Every query about products: what is ready, who makes it, what became of it.

States: *waiting* (inputs are missing) → *ready* (a message may be under way) → *running* (leased) → *done* or *failed*;
*parked* is what nobody links at present. All changes are compare-and-set, so every message may be lost or doubled.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import orjson
from sqlalchemy import (
    ARRAY,
    Connection,
    String,
    any_,
    bindparam,
    func,
    literal,
    literal_column,
    select,
    text,
    union,
    update,
)
from sqlalchemy import delete as sql_delete
from sqlalchemy.dialects import postgresql, sqlite

from valerie.db.bulk import insert_rows
from valerie.db.links import FRAME_COLUMNS, VARIANT_OF_FRAME, StoredFrame, same_frame
from valerie.db.models import (
    Evaluation,
    Frame,
    FrameAnnotation,
    PersonLight,
    PersonScore,
    PersonView,
    Product,
    Run,
    Score,
    Variant,
)
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.states import UPLOADED_ROUTE, ProductKind

#: Cache group of the evaluations of uploaded predictions.
UPLOADED_GROUP: Final = "uploaded"
#: (digest, kind, route, cache group): what the broker needs to ring for a product.
Ready = tuple[str, str, str, str]

_READY_COLUMNS = (Product.digest, Product.kind, Product.route, Product.cache_group)
_INPUTS = (Product.input_a, Product.input_b, Product.input_c)
#: Spelled out and not bound: SQLite uses a partial index only for a condition that it can read in the statement. Whatever looks
#: for unfinished, waiting or ended products without their digests needs these, or it reads the whole table.
_UNFINISHED = Product.state.in_([literal_column(f"'{state}'") for state in ("waiting", "ready", "running")])
_WAITING = Product.state == literal_column("'waiting'")
_ENDED = Product.state.in_([literal_column(f"'{state}'") for state in ("done", "failed")])

#: What a product that is to be tried again begins with.
_TRY_AGAIN: dict[str, Any] = {
    "state": "waiting",
    "attempts": 0,
    "error": None,
    "lease_owner": None,
    "lease_until": None,
    "sent_at": None,
}
_INPUTS_DONE = text(
    "NOT EXISTS (SELECT 1 FROM products AS i"
    " WHERE i.digest IN (products.input_a, products.input_b, products.input_c) AND i.state <> 'done')"
)


#: (digest, kind, route, cache group, inputs a, b and c) of a product that a run links to.
Wanted = tuple[str, str, str, str, str | None, str | None, str | None]
_digest_of = operator.itemgetter(0)
_WANTED_COLUMNS = ("digest", "kind", "route", "cache_group", "input_a", "input_b", "input_c")


def want(connection: Connection, rows: Iterable[Wanted], now: float) -> list[Ready]:
    """Insert products that a run links to, ready where all inputs are done; returns what became ready.

    What is there already stays as it is, but what failed for good or was parked is tried again.
    """
    wanted = list(rows)
    asked: set[str] = set()
    for digest, _, _, _, *inputs in wanted:
        asked.add(digest)
        asked.update(filter(None, inputs))
    # Locked until the commit (SQLite: nobody else writes): a worker must not park what this transaction is about to link.
    known = select(Product.digest, Product.state).where(_among(connection, Product.digest, asked)).with_for_update()
    states: dict[str, str] = {row[0]: row[1] for row in connection.execute(known)}
    done: set[str | None] = {None, *(digest for digest, state in states.items() if state == "done")}
    inserted: list[tuple[Any, ...]] = []
    ready: list[Ready] = []
    for row in wanted:
        digest, kind, route, group, a, b, c = row
        if digest in states and states[digest] not in ("failed", "parked"):
            continue
        if a in done and b in done and c in done:
            inserted.append((*row, "ready", 0, now))
            if route != UPLOADED_ROUTE:
                ready.append((digest, kind, route, group))
        else:
            inserted.append((*row, "waiting", 0, None))
    inserted.sort(key=_digest_of)  # neighbours on the pages of the primary key, one after the other
    insert_rows(
        connection,
        Product,
        (*_WANTED_COLUMNS, "state", "attempts", "sent_at"),
        inserted,
        on_conflict=(
            "(digest) DO UPDATE SET state = excluded.state, attempts = 0, error = NULL, lease_owner = NULL,"
            " lease_until = NULL, sent_at = excluded.sent_at WHERE products.state IN ('failed', 'parked')"
        ),
    )
    return ready


def insert_ignoring(connection: Connection, model: type[Any], rows: Sequence[Mapping[str, Any]]) -> int:
    """Insert rows; those whose primary key is there already are left as they are. Returns how many were inserted."""
    if not rows:
        return 0
    insertion = _insert_of(connection)(model.__table__).on_conflict_do_nothing()
    return connection.execute(insertion, list(rows), execution_options={"preserve_rowcount": True}).rowcount


def revive(connection: Connection, digests: Iterable[str]) -> None:
    """Let what failed for good or was parked be tried again (a retry asks for it)."""
    among = _among(connection, Product.digest, digests)
    connection.execute(update(Product).where(among, Product.state.in_(("failed", "parked"))).values(**_TRY_AGAIN))


def promote(connection: Connection, digests: Iterable[str], now: float) -> list[Ready]:
    """Those of ``digests`` that wait for nothing more become ready; returns them."""
    return _promote(connection, _among(connection, Product.digest, digests), now)


def promote_dependents(connection: Connection, inputs: Iterable[str], now: float) -> list[Ready]:
    """What waited for ``inputs`` and now has all it needs becomes ready; returns it.

    Call it in a transaction of its own, after the one that finished the inputs: of two workers that finish the two inputs of
    one product at the same time, the later then sees both.
    """
    done = list(inputs)
    # One SELECT per column: SQLite reads no partial index for the parts of an OR.
    waiting = [select(Product.digest).where(_WAITING, _among(connection, column, done)) for column in _INPUTS]
    return _promote(connection, Product.digest.in_(union(*waiting)), now)


def promote_all(connection: Connection, now: float) -> list[Ready]:
    """Sweep: whatever waits although all its inputs are done becomes ready."""
    return _promote(connection, _UNFINISHED, now)


def _promote(connection: Connection, condition: Any, now: float) -> list[Ready]:
    statement = (
        update(Product)
        .where(Product.state == "waiting", condition, _INPUTS_DONE)
        .values(state="ready", sent_at=now)
        .returning(*_READY_COLUMNS)
    )
    return _to_ring_for(connection.execute(statement))


@dataclass(frozen=True, slots=True)
class Look:
    """One function's look at a frame through one sensor.

    Attributes:
        sensor: index in the sensors of the run's spec.
        function: index in its functions.
        prediction: digest of what the function saw.
    """

    sensor: int
    function: int
    prediction: str


@dataclass(frozen=True, slots=True)
class Job:
    """A claimed product.

    Attributes:
        digest, kind: of the product.
        attempts: how many there were, this one included.
        frame: one of the frames that link to the product.
        look: for predictions and evaluations, which one of the frame.
    """

    digest: str
    kind: str
    attempts: int
    frame: StoredFrame
    look: Look | None = None


def claim(connection: Connection, digests: Sequence[str], *, owner: str, now: float, lease_seconds: float) -> list[Job]:
    """Lease those of ``digests`` that are ready; the rest is leased, finished or gone and is passed over.

    A product that no active run links to is parked instead.
    """
    statement = (
        update(Product)
        .where(Product.digest.in_(digests), Product.state == "ready")
        .values(
            state="running",
            lease_owner=owner,
            lease_until=now + lease_seconds,
            attempts=Product.attempts + 1,
        )
        .returning(Product.digest, Product.kind, Product.attempts)
    )
    claimed = {row.digest: row for row in connection.execute(statement)}
    jobs: list[Job] = []
    orphans: list[str] = []
    for digest in digests:  # the order of the message is the order of the warm cache
        row = claimed.pop(digest, None)
        if row is None:
            continue
        job = _job(connection, digest, row.kind, row.attempts)
        if job is None:
            orphans.append(digest)
        else:
            jobs.append(job)
    if orphans:
        connection.execute(
            update(Product)
            .where(Product.digest.in_(orphans))
            .values(state="parked", lease_owner=None, lease_until=None)
        )
    return jobs


def _frame_job(column: Any) -> Any:
    return (
        select(*FRAME_COLUMNS)
        .join(Run, Run.id == Frame.run_id)
        .join(Variant, VARIANT_OF_FRAME)
        .where(column == bindparam("digest"), Run.state == "running")
        .limit(1)
    )


def _annotation_job() -> Any:
    return (
        select(*FRAME_COLUMNS)
        .select_from(FrameAnnotation)
        .join(Frame, same_frame(FrameAnnotation))
        .join(Run, Run.id == Frame.run_id)
        .join(Variant, VARIANT_OF_FRAME)
        .where(FrameAnnotation.product == bindparam("digest"), Run.state == "running")
        .limit(1)
    )


def _evaluation_job(column: Any) -> Any:
    return (
        select(*FRAME_COLUMNS, Evaluation.sensor_index, Evaluation.function_index, Evaluation.prediction)
        .join(Frame, same_frame(Evaluation))
        .join(Run, Run.id == Frame.run_id)
        .join(Variant, VARIANT_OF_FRAME)
        .where(column == bindparam("digest"), Run.state == "running")
        .limit(1)
    )


_JOB_OF_KIND = {
    "background": _frame_job(Frame.background),
    "layer": _frame_job(Frame.layer),
    "truth": _frame_job(Frame.truth),
    **{kind.value: _annotation_job() for kind in AnnotationKind},
    "prediction": _evaluation_job(Evaluation.prediction),
    "evaluation": _evaluation_job(Evaluation.scores),
}

#: Kinds of products whose jobs have a `Look`.
_LOOKS: Final = frozenset({"prediction", "evaluation"})


def _job(connection: Connection, digest: str, kind: str, attempts: int) -> Job | None:
    row = connection.execute(_JOB_OF_KIND[kind], {"digest": digest}).first()
    if row is None:
        return None
    look = Look(row.sensor_index, row.function_index, row.prediction) if kind in _LOOKS else None
    return Job(digest, kind, attempts, StoredFrame.of(row), look)


def renew(connection: Connection, digests: Sequence[str], *, owner: str, until: float) -> None:
    """Heartbeat: prolong the leases that ``owner`` still holds."""
    connection.execute(
        update(Product)
        .where(Product.digest.in_(digests), Product.lease_owner == owner, Product.state == "running")
        .values(lease_until=until)
    )


@dataclass(frozen=True, slots=True)
class Finished:
    """A product whose artifact is stored, with the rows that say what it holds.

    ``part``: what it shares with others of its kind and is stored apart (the statics of a truth).
    """

    digest: str
    bytes: int
    pixels: int
    cpu_seconds: float
    person_views: tuple[dict[str, Any], ...] = ()
    person_lights: tuple[dict[str, Any], ...] = ()
    score: dict[str, Any] | None = None
    person_scores: tuple[dict[str, Any], ...] = ()
    part: Part | None = None


@dataclass(frozen=True, slots=True)
class Part:
    """An object that several products of a kind are stored over; its row keeps it from being freed while one of them lives.

    Attributes:
        digest: of its content.
        kind: ``statics``.
        bytes, pixels: of the object and of the image.
    """

    digest: str
    kind: str
    bytes: int
    pixels: int


def publish(connection: Connection, finished: Sequence[Finished], *, owner: str, now: float) -> None:
    """Mark products done and write their rows; what ``owner`` no longer holds was done by someone else, with equal bytes."""
    connection.execute(
        update(Product.__table__)  # type: ignore[arg-type]
        .where(
            Product.__table__.c.digest == bindparam("product"),
            Product.__table__.c.state == "running",
            Product.__table__.c.lease_owner == owner,
        )
        .values(
            state="done",
            lease_owner=None,
            lease_until=None,
            error=None,
            bytes=bindparam("size"),
            pixels=bindparam("area"),
            cpu_seconds=bindparam("cpu"),
            finished_at=now,
        ),
        [{"product": f.digest, "size": f.bytes, "area": f.pixels, "cpu": f.cpu_seconds} for f in finished],
    )
    _publish_parts(connection, finished, now)
    insert_ignoring(connection, PersonView, [row for f in finished for row in f.person_views])
    insert_ignoring(connection, PersonLight, [row for f in finished for row in f.person_lights])
    insert_ignoring(connection, Score, [f.score for f in finished if f.score is not None])
    insert_ignoring(connection, PersonScore, [row for f in finished for row in f.person_scores])


def _publish_parts(connection: Connection, finished: Sequence[Finished], now: float) -> None:
    """Name the part as the product's input. Nobody makes it by itself: who makes the product stores it again if it is gone."""
    over = [(f.digest, f.part) for f in finished if f.part is not None]
    if not over:
        return
    made = {"state": "done", "route": "", "cache_group": "", "attempts": 1, "cpu_seconds": 0.0, "finished_at": now}
    parts = {part.digest: part for _, part in over}
    rows = [
        {"digest": one.digest, "kind": one.kind, "bytes": one.bytes, "pixels": one.pixels} for one in parts.values()
    ]
    insert_ignoring(connection, Product, [made | row for row in rows])
    table = Product.__table__
    connection.execute(
        update(table).where(table.c.digest == bindparam("product")).values(input_a=bindparam("part")),  # type: ignore[arg-type]
        [{"product": digest, "part": part.digest} for digest, part in over],
    )


def hand_back(
    connection: Connection, digests: Sequence[str], *, owner: str, not_before: float, count_attempt: bool = True
) -> None:
    """Give leased products back after a transient fault; the sweeper rings for them when ``not_before`` has passed."""
    attempts = Product.attempts if count_attempt else Product.attempts - 1
    connection.execute(
        update(Product)
        .where(Product.digest.in_(digests), Product.lease_owner == owner, Product.state == "running")
        .values(state="ready", lease_owner=None, lease_until=None, sent_at=not_before, attempts=attempts)
    )


def fail(connection: Connection, digest: str, *, owner: str | None, error: Mapping[str, Any], now: float) -> None:
    """Record that a product failed for good, and with it all that waits for it."""
    condition = [Product.digest == digest]
    if owner is not None:
        condition.append(Product.lease_owner == owner)
    changed = connection.execute(
        update(Product)
        .where(*condition, _UNFINISHED)
        .values(state="failed", error=dict(error), lease_owner=None, lease_until=None, finished_at=now)
    )
    if changed.rowcount:
        fail_dependents(connection, [digest], now)


def fail_dependents(connection: Connection, failed: Sequence[str], now: float) -> None:
    """What waits for a failed product fails with it, naming the cause."""
    causes = list(failed)
    while causes:
        cause = causes.pop()
        waiting = [select(Product.digest).where(_WAITING, column == cause) for column in _INPUTS]
        rows = connection.execute(
            update(Product)
            .where(Product.state == "waiting", Product.digest.in_(union(*waiting)))
            .values(state="failed", error={"cause": cause}, finished_at=now)
            .returning(Product.digest)
        )
        causes += [row.digest for row in rows]


def forget(connection: Connection, digests: Sequence[str]) -> None:
    """A finished product's object is gone or damaged: it has to be made again."""
    connection.execute(
        update(Product)
        .where(Product.digest.in_(digests), Product.state == "done")
        .values(state="waiting", sent_at=None)
    )


def await_inputs(connection: Connection, digests: Sequence[str], *, owner: str) -> None:
    """Give leased products back to wait for inputs that have to be made again."""
    connection.execute(
        update(Product)
        .where(Product.digest.in_(digests), Product.lease_owner == owner, Product.state == "running")
        .values(state="waiting", lease_owner=None, lease_until=None)
    )


def take_back_expired(connection: Connection, *, now: float, max_attempts: int) -> list[Ready]:
    """Sweep: what a dead worker held becomes ready again, or fails when that happened ``max_attempts`` times."""
    hopeless = connection.execute(
        select(Product.digest, Product.kind, Product.attempts).where(
            _UNFINISHED, Product.state == "running", Product.lease_until < now, Product.attempts >= max_attempts
        )
    ).all()
    for row in hopeless:
        error = {
            "stage": row.kind,
            "type": "WorkerLost",
            "message": f"the worker process died or hung in each of {row.attempts} attempts",
            "attempts": row.attempts,
        }
        fail(connection, row.digest, owner=None, error=error, now=now)
    rows = connection.execute(
        update(Product)
        .where(_UNFINISHED, Product.state == "running", Product.lease_until < now)
        .values(state="ready", lease_owner=None, lease_until=None, sent_at=now)
        .returning(*_READY_COLUMNS)
    )
    return _to_ring_for(rows)


def stale_ready(connection: Connection, *, before: float, limit: int) -> list[Ready]:
    """Sweep: ready products for which nobody rang since ``before`` (a lost message, or a pause after a fault)."""
    rows = connection.execute(
        select(*_READY_COLUMNS)
        .where(_UNFINISHED, Product.state == "ready", Product.sent_at < before, Product.route != UPLOADED_ROUTE)
        .limit(limit)
    )
    return _to_ring_for(rows)


def mark_sent(connection: Connection, digests: Iterable[str], now: float) -> None:
    """Remember when products were rung for."""
    among = _among(connection, Product.digest, digests)
    connection.execute(update(Product).where(among, Product.state == "ready").values(sent_at=now))


def fail_orphaned_dependents(connection: Connection, now: float) -> None:
    """Sweep: whatever waits for a failed input fails too."""
    failed = connection.execute(
        text(
            "SELECT DISTINCT i.digest FROM products AS w JOIN products AS i ON i.digest IN (w.input_a, w.input_b, w.input_c) "
            "WHERE w.state IN ('waiting','ready','running') AND w.state = 'waiting' AND i.state = 'failed'"
        )
    ).scalars()
    fail_dependents(connection, list(failed), now)


def unfinished_count(connection: Connection) -> int:
    """Products that wait, are ready or run: what the feeding window bounds.

    Uploaded predictions, and what is counted from them, are left out: nobody could see all frames of a large run
    before the first label maps came.
    """
    uploaded = (Product.route == UPLOADED_ROUTE) | (Product.cache_group == UPLOADED_GROUP)
    return connection.scalar(select(func.count()).select_from(Product).where(_UNFINISHED, ~uploaded)) or 0


def unfinished_by_route(connection: Connection) -> list[tuple[str, str, int]]:
    """(route, state, count) of all unfinished products."""
    rows = connection.execute(
        select(Product.route, Product.state, func.count()).where(_UNFINISHED).group_by(Product.route, Product.state)
    )
    return [(row[0], row[1], row[2]) for row in rows]


def totals(connection: Connection) -> list[tuple[str, int, int, float]]:
    """(kind, done, failed, CPU seconds of what is done) of every kind, over all products; read from an index alone."""
    rows = connection.execute(
        select(Product.kind, Product.state, func.count(), func.sum(Product.cpu_seconds))
        .where(_ENDED)
        .group_by(Product.kind, Product.state)
    )
    ended = {(kind, state): (int(count), float(seconds or 0.0)) for kind, state, count, seconds in rows}
    nothing = (0, 0.0)
    return [
        (kind, ended.get((kind, "done"), nothing)[0], ended.get((kind, "failed"), nothing)[0],
         ended.get((kind, "done"), nothing)[1])
        for kind in sorted(ProductKind)
    ]  # fmt: skip


def done_digests(connection: Connection, digests: Iterable[str]) -> set[str]:
    """Those of ``digests`` that are there already."""
    among = _among(connection, Product.digest, digests)
    return set(connection.scalars(select(Product.digest).where(among, Product.state == "done")))


def known_digests(connection: Connection, digests: Iterable[str]) -> set[str]:
    """Those of ``digests`` that have a row, in whatever state."""
    return set(connection.scalars(select(Product.digest).where(_among(connection, Product.digest, digests))))


@dataclass(frozen=True, slots=True)
class RecordedCost:
    """Means over ``count`` finished products of one kind, route and size.

    ``group`` tells functions apart; it is empty for products that are grouped by something passing. The dearest product is
    left out of the mean of seconds, unless it is the only one: a worker's first one pays for what is loaded then.
    """

    kind: str
    route: str
    group: str
    pixels: int
    count: int
    cpu_seconds: float
    bytes: float


def recorded_costs(connection: Connection, *, sample: int = 400) -> list[RecordedCost]:
    """What the newest ``sample`` finished products of each kind cost."""
    found: list[RecordedCost] = []
    for kind in _JOB_OF_KIND:
        group = Product.cache_group if kind == "prediction" else literal("")
        newest = (
            select(Product.route, group.label("grouped"), Product.cpu_seconds, Product.bytes, Product.pixels)
            .where(_ENDED, Product.kind == kind, Product.state == "done", Product.cpu_seconds.is_not(None))
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
            found.append(RecordedCost(kind, route, grouped, int(pixels), count, float(mean), float(size)))
    return found


def unlinked(connection: Connection, *, limit: int) -> list[tuple[str, str]]:
    """(digest, kind) of products that nothing links to (frame, annotation, evaluation, a product over it), and nobody makes now.

    Until the transaction ends nobody else writes products, so that none of them is linked meanwhile (on SQLite no two
    transactions write at the same time anyway).
    """
    if connection.dialect.name == "postgresql":
        connection.execute(text("LOCK TABLE products IN SHARE ROW EXCLUSIVE MODE"))
    rows = connection.execute(
        text(
            "SELECT digest, kind FROM products AS p WHERE p.state <> 'running'"
            " AND NOT EXISTS (SELECT 1 FROM frames WHERE background = p.digest)"
            " AND NOT EXISTS (SELECT 1 FROM frames WHERE layer = p.digest)"
            " AND NOT EXISTS (SELECT 1 FROM frames WHERE truth = p.digest)"
            " AND NOT EXISTS (SELECT 1 FROM frame_annotations WHERE product = p.digest)"
            " AND NOT EXISTS (SELECT 1 FROM evaluations WHERE prediction = p.digest)"
            " AND NOT EXISTS (SELECT 1 FROM evaluations WHERE scores = p.digest)"
            " AND (p.kind <> 'statics' OR NOT EXISTS (SELECT 1 FROM products AS o WHERE o.input_a = p.digest)) LIMIT :limit"
        ),
        {"limit": limit},
    )
    return [(row[0], row[1]) for row in rows]


def delete(connection: Connection, digests: Iterable[str]) -> None:
    """Remove product rows; what hangs on them goes with them."""
    connection.execute(sql_delete(Product).where(_among(connection, Product.digest, digests)))


def _to_ring_for(rows: Iterable[Any]) -> list[Ready]:
    """Return rows as messages need them, without uploaded predictions: no worker waits for them."""
    return [(row.digest, row.kind, row.route, row.cache_group) for row in rows if row.route != UPLOADED_ROUTE]


def _insert_of(connection: Connection) -> Any:
    """The dialect's INSERT, which knows ON CONFLICT."""
    return postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert


def _among(connection: Connection, column: Any, digests: Iterable[str]) -> Any:
    """``column`` is one of ``digests``: one bound value however many they are, so that the statement is compiled once."""
    values = list(digests)
    if connection.dialect.name == "postgresql":
        return column == any_(literal(values, ARRAY(String)))
    each = func.json_each(orjson.dumps(values).decode()).table_valued("value")
    return column.in_(select(each.c.value))
