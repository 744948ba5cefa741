"""The life cycle of a product: wanted, claimed, published or failed.

States: *waiting* (inputs are missing) → *ready* (a message may be under way) → *running* (leased) → *done* or *failed*;
*parked* products have no link at present. All changes are compare-and-set: messages may be lost or arrive twice.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import Final, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Connection,
    Executable,
    Row,
    and_,
    bindparam,
    case,
    func,
    or_,
    select,
    text,
    union,
    update,
)
from sqlalchemy.orm import InstrumentedAttribute

from valerie.db.links import FRAME_COLUMNS, VARIANT_OF_FRAME, StoredFrame, same_frame
from valerie.db.measured import FrameScore, MeasuredPerson, SeenPerson
from valerie.db.models import (
    Evaluation,
    Frame,
    FrameAnnotation,
    OwnerTurn,
    PersonLight,
    PersonScore,
    PersonView,
    Picture,
    Product,
    Run,
    Score,
    Variant,
)
from valerie.db.statements import (
    READY,
    RUNNING,
    UNFINISHED,
    WAITING,
    Values,
    among,
    in_order,
    insert_ignoring,
    insert_rows,
    insertion_into,
    lock,
)
from valerie.measures import Measures
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products.ready import FailedInput, ProductError, Ready
from valerie.runs.products.states import UPLOADED_ROUTE, ProductKind, ProductState, RunState
from valerie.runs.products.turns import Turns, packet_size

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
        .values(
            state=ProductState.WAITING,
            attempts=0,
            error=None,
            lease_owner=None,
            lease_until=None,
            sent_at=None,
            not_before=None,
        )
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


@dataclass(frozen=True, slots=True)
class EvaluationLink:
    """One function's evaluation of a frame through one sensor.

    Attributes:
        sensor, function: indexes in the run's spec.
        prediction: digest of the prediction for the frame.
        empty: digest of the prediction for its background without movables, if any.
    """

    sensor: int
    function: int
    prediction: str
    empty: str | None = None


@dataclass(frozen=True, slots=True)
class Job:
    """A claimed product.

    Attributes:
        digest, kind: of the product.
        attempts: number of attempts so far, including this one.
        frame: one of the frames that link to the product.
        look: only for predictions and evaluations.
    """

    digest: str
    kind: ProductKind
    attempts: int
    frame: StoredFrame
    look: EvaluationLink | None = None


class _Line(NamedTuple):
    """The ready products of an owner in a queue; ``turn`` is the owner's, counted in products that the queue gave it."""

    owner: str
    turn: float


_READY: Final = (UNFINISHED, READY, Product.route == bindparam("route"))
_DUE: Final = (*_READY, or_(Product.not_before.is_(None), Product.not_before <= bindparam("now")))
_ANY: Final = select(Product.digest).where(*_DUE).limit(1)
_OF_LINE: Final = Product.owner == bindparam("line")
_NEXT: Final = (
    select(Product.digest, Product.kind, Product.cache_group, Product.turn, Product.attempts)
    .where(*_DUE, _OF_LINE)
    .order_by(Product.turn)
    .limit(1)
    .with_for_update(skip_locked=True)
)
_PACKET: Final = (
    select(Product.digest)
    .where(*_DUE, _OF_LINE, Product.turn == bindparam("turn"), Product.kind == bindparam("kind"), Product.attempts == 0)
    .where(Product.cache_group == bindparam("group"))
    .limit(bindparam("most"))
    .with_for_update(skip_locked=True)
)


def any_due(connection: Connection, route: str, *, now: float) -> bool:
    """Return whether `claim_next` may find a product of a queue; unlike it, this locks and writes nothing."""
    return connection.execute(_ANY, {"route": route, "now": now}).first() is not None


def claim_next(connection: Connection, route: str, *, owner: str, now: float, lease_seconds: float) -> list[Job]:
    """Lease the ready products of a queue whose turn it is: one packet, or nothing where none is ready.

    The owner comes first that the queue has given the fewest products. An owner whose line was empty begins with the one that
    was served last, so it claims no time that passed.

    A product that was tried before comes alone: one that ends its process again and again must not use up the attempts of its
    neighbours. On Postgres, workers that claim at the same time pass over each other's rows; on SQLite nobody else writes.
    """
    lines = _lines(connection, route)
    for line in lines:
        asked = {"route": route, "now": now, "line": line.owner}
        while (row := connection.execute(_NEXT, asked).first()) is not None:
            digests: Sequence[str] = [row.digest]
            if row.attempts == 0:
                packet = {"turn": row.turn, "kind": row.kind, "group": row.cache_group, "most": packet_size(row.kind)}
                digests = connection.scalars(_PACKET, asked | packet).all()
            jobs = claim(connection, digests, owner=owner, now=now, lease_seconds=lease_seconds)
            if jobs:
                if len(lines) > 1:
                    _advance(connection, route, line, len(jobs))
                return jobs
    return []


def _owners_of_queue() -> Executable:
    # One step in the index per owner; DISTINCT would read all ready products.
    found = select(func.min(Product.owner).label("owner")).where(*_READY).cte("found", recursive=True)
    following = select(func.min(Product.owner)).where(*_READY, Product.owner > found.c.owner)
    found = found.union_all(select(following.correlate(found).scalar_subquery()).where(found.c.owner.is_not(None)))
    latest = select(func.max(OwnerTurn.start)).where(OwnerTurn.route == bindparam("route")).scalar_subquery()
    return (
        select(found.c.owner, OwnerTurn.turn, latest)
        .outerjoin(OwnerTurn, and_(OwnerTurn.route == bindparam("route"), OwnerTurn.owner == found.c.owner))
        .where(found.c.owner.is_not(None))
    )


_OWNERS: Final = _owners_of_queue()


def _lines(connection: Connection, route: str) -> list[_Line]:
    """Return the lines of a queue, the one to be served first."""
    rows = connection.execute(_OWNERS, {"route": route})
    lines = [_Line(owner, max(turn or 0.0, start or 0.0)) for owner, turn, start in rows]
    return sorted(lines, key=lambda line: (line.turn, line.owner))


def _advance(connection: Connection, route: str, line: _Line, count: int) -> None:
    # The last statement of the transaction: where several owners wait, workers of one wait for each other's commit here.
    start = case((OwnerTurn.turn > line.turn, OwnerTurn.turn), else_=line.turn)
    values = {"route": route, "owner": line.owner, "start": line.turn, "turn": line.turn + count}
    advanced = {"start": start, "turn": start + count}
    insertion = insertion_into(connection.dialect.name, OwnerTurn).values(values)
    connection.execute(insertion.on_conflict_do_update(index_elements=["route", "owner"], set_=advanced))


def claim(connection: Connection, digests: Sequence[str], *, owner: str, now: float, lease_seconds: float) -> list[Job]:
    """Lease the ready products among ``digests``; return them in the order of ``digests``.

    A product without a link from a running run is parked instead.
    """
    lease = {"digests": digests, "holder": owner, "until": now + lease_seconds}
    claimed = {row.digest: row for row in connection.execute(_claim(connection.dialect.name), lease)}
    jobs: list[Job] = []
    orphans: list[str] = []
    for digest in digests:  # the message's order suits the warm cache
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
            .values(state=ProductState.PARKED, lease_owner=None, lease_until=None)
        )
    return jobs


@cache
def _claim(dialect: str) -> Executable:
    return (
        update(Product)
        .where(in_order(dialect, among(dialect, Product.digest), READY))
        .values(
            state=ProductState.RUNNING,
            lease_owner=bindparam("holder"),
            lease_until=bindparam("until"),
            not_before=None,
            attempts=Product.attempts + 1,
        )
        .returning(Product.digest, Product.kind, Product.attempts)
    )


def _frame_job(column: InstrumentedAttribute[str]) -> Executable:
    return (
        select(*FRAME_COLUMNS)
        .join(Run, Run.id == Frame.run_id)
        .join(Variant, VARIANT_OF_FRAME)
        .where(column == bindparam("digest"), Run.state == RunState.RUNNING)
        .limit(1)
    )


def _annotation_job() -> Executable:
    return (
        select(*FRAME_COLUMNS)
        .select_from(FrameAnnotation)
        .join(Frame, same_frame(FrameAnnotation))
        .join(Run, Run.id == Frame.run_id)
        .join(Variant, VARIANT_OF_FRAME)
        .where(FrameAnnotation.product == bindparam("digest"), Run.state == RunState.RUNNING)
        .limit(1)
    )


def _evaluation_job(column: InstrumentedAttribute[str] | InstrumentedAttribute[str | None]) -> Executable:
    return (
        select(
            *FRAME_COLUMNS,
            Evaluation.sensor_index,
            Evaluation.function_index,
            Evaluation.prediction,
            Evaluation.empty,
        )
        .join(Frame, same_frame(Evaluation))
        .join(Run, Run.id == Frame.run_id)
        .join(Variant, VARIANT_OF_FRAME)
        .where(column == bindparam("digest"), Run.state == RunState.RUNNING)
        .limit(1)
    )


_JOB_OF_KIND: Final = {
    ProductKind.BACKGROUND: _frame_job(Frame.background),
    ProductKind.LAYER: _frame_job(Frame.layer),
    ProductKind.TRUTH: _frame_job(Frame.truth),
    **{ProductKind(kind): _annotation_job() for kind in AnnotationKind},
    ProductKind.PREDICTION: _evaluation_job(Evaluation.prediction),
    ProductKind.EVALUATION: _evaluation_job(Evaluation.scores),
}
_EMPTY_JOB: Final = _evaluation_job(Evaluation.empty)
#: Kinds of products whose jobs have an `EvaluationLink`.
_LOOKS: Final = frozenset({ProductKind.PREDICTION, ProductKind.EVALUATION})


def _job(connection: Connection, digest: str, kind: ProductKind, attempts: int) -> Job | None:
    row = connection.execute(_JOB_OF_KIND[kind], {"digest": digest}).first()
    if row is None and kind is ProductKind.PREDICTION:
        row = connection.execute(_EMPTY_JOB, {"digest": digest}).first()
    if row is None:
        return None
    look = EvaluationLink(row.sensor_index, row.function_index, row.prediction, row.empty) if kind in _LOOKS else None
    return Job(digest, kind, attempts, StoredFrame.of(row), look)


@cache
def _held(dialect: str) -> tuple[ColumnElement[bool], ...]:
    held = Product.lease_owner == bindparam("holder"), RUNNING
    return among(dialect, Product.digest), *held


def renew(connection: Connection, digests: Collection[str], *, owner: str, until: float) -> None:
    """Extend the leases that ``owner`` still holds."""
    connection.execute(_renewal(connection.dialect.name), {"digests": digests, "holder": owner, "until": until})


@cache
def _renewal(dialect: str) -> Executable:
    return update(Product).where(in_order(dialect, *_held(dialect))).values(lease_until=bindparam("until"))


@dataclass(frozen=True, slots=True)
class Finished:
    """A product whose artifact is stored, with the rows that describe its content.

    Attributes:
        digest: the product.
        bytes, pixels: size of the object, and of the image.
        cpu_seconds: CPU time of making it.
        person_views, person_lights, picture, score, person_scores: rows of the tables of these names.
        part: the statics that a truth is stored over.
    """

    digest: str
    bytes: int
    pixels: int
    cpu_seconds: float
    person_views: tuple[SeenPerson, ...] = ()
    person_lights: tuple[MeasuredPerson, ...] = ()
    picture: Measures | None = None
    score: FrameScore | None = None
    person_scores: tuple[MeasuredPerson, ...] = ()
    part: SharedStatics | None = None


@dataclass(frozen=True, slots=True)
class SharedStatics:
    """The statics that several truths are stored over; its row keeps it from being freed while one of them exists.

    Attributes:
        digest: digest of the content.
        bytes, pixels: size of the object, and of the image.
    """

    digest: str
    bytes: int
    pixels: int


_DONE: Final = (
    update(Product.__table__)  # type: ignore[arg-type]
    .where(Product.__table__.c.digest == bindparam("product"))
    .values(
        state=ProductState.DONE,
        lease_owner=None,
        lease_until=None,
        error=None,
        bytes=bindparam("size"),
        pixels=bindparam("area"),
        cpu_seconds=bindparam("cpu"),
        finished_at=bindparam("now"),
    )
)


def publish(connection: Connection, finished: Sequence[Finished], *, owner: str, now: float) -> list[str]:
    """Mark products done and write their rows.

    Only products that ``owner`` still holds are published. The leases of the others ended: other workers make them, with
    equal bytes, or nothing links to them any more and they may have been freed.

    Returns:
        The digests that were published.
    """
    digests = [product.digest for product in finished]
    lock(connection, digests)  # a product keeps its holder until its rows are written
    query = select(Product.digest).where(*_held(connection.dialect.name))
    held = set(connection.scalars(query, {"digests": digests, "holder": owner}))
    published = [product for product in finished if product.digest in held]
    if not published:
        return []
    connection.execute(
        _DONE,
        [{"product": p.digest, "size": p.bytes, "area": p.pixels, "cpu": p.cpu_seconds, "now": now} for p in published],
    )
    _publish_parts(connection, published, now)
    views = [{"truth": p.digest, **person.columns} for p in published for person in p.person_views]
    insert_ignoring(connection, PersonView, views)
    lights = [{"product": p.digest, **person.columns} for p in published for person in p.person_lights]
    insert_ignoring(connection, PersonLight, lights)
    pictures = [{"prediction": p.digest, **p.picture} for p in published if p.picture is not None]
    insert_ignoring(connection, Picture, pictures)
    scores = [{"digest": p.digest, **p.score.columns} for p in published if p.score is not None]
    insert_ignoring(connection, Score, scores)
    persons = [{"digest": p.digest, **person.columns} for p in published for person in p.person_scores]
    insert_ignoring(connection, PersonScore, persons)
    return [product.digest for product in published]


def _publish_parts(connection: Connection, published: Sequence[Finished], now: float) -> None:
    """Make each part an input of its product. No worker makes a part separately: the product's maker stores it again."""
    parts = {product.digest: product.part for product in published if product.part is not None}
    if not parts:
        return
    row = {
        "kind": ProductKind.STATICS,
        "state": ProductState.DONE,
        "route": "",
        "cache_group": "",
        "turn": 0.0,
        "attempts": 1,
        "cpu_seconds": 0.0,
        "finished_at": now,
    }
    # Sorted: two workers that insert the same ones wait for each other in any other order.
    distinct = sorted({part.digest: part for part in parts.values()}.values(), key=attrgetter("digest"))
    rows = [{**row, "digest": part.digest, "bytes": part.bytes, "pixels": part.pixels} for part in distinct]
    insert_ignoring(connection, Product, rows)
    table = Product.__table__
    connection.execute(
        update(table).where(table.c.digest == bindparam("product")).values(input_a=bindparam("part")),  # type: ignore[arg-type]
        [{"product": digest, "part": part.digest} for digest, part in parts.items()],
    )


def hand_back(
    connection: Connection, digests: Collection[str], *, owner: str, not_before: float, count_attempt: bool = True
) -> None:
    """Return leased products after a transient fault; they rest until ``not_before``, then the sweeper sends them again."""
    attempts = Product.attempts if count_attempt else Product.attempts - 1
    ready = {"state": ProductState.READY, "sent_at": None, "not_before": not_before, "attempts": attempts}
    _let_go(connection, digests, owner, ready)


def _let_go(connection: Connection, digests: Collection[str], owner: str, values: Values) -> None:
    dialect = connection.dialect.name
    released = {"lease_owner": None, "lease_until": None, **values}
    connection.execute(
        update(Product).where(in_order(dialect, *_held(dialect))).values(released),
        {"digests": digests, "holder": owner},
    )


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
        .values(state=ProductState.FAILED, error=error, lease_owner=None, lease_until=None, finished_at=now)
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


def await_inputs(connection: Connection, digests: Collection[str], *, owner: str) -> None:
    """Return leased products to waiting: their inputs have to be made again."""
    _let_go(connection, digests, owner, {"state": ProductState.WAITING})
