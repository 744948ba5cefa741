"""A worker's products: claimed, held by a lease, and handed back."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, NamedTuple

from sqlalchemy import ColumnElement, Connection, Executable, and_, bindparam, case, func, or_, select, update

from valerie.db.links import FRAME_COLUMNS, VARIANT_OF_FRAME, OfFrames, StoredFrame, same_frame
from valerie.db.models import Evaluation, Frame, FrameAnnotation, OwnerTurn, Product, Run, Variant
from valerie.db.statements import READY, RUNNING, UNFINISHED, UNLEASED, Values, among, in_order, insertion_into
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products.states import ProductKind, ProductState, RunState
from valerie.runs.products.turns import packet_size


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

    @classmethod
    def of(cls, row: Any) -> EvaluationLink:
        """Read the link from a row of an evaluation."""
        return cls(row.sensor_index, row.function_index, row.prediction, row.empty)


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
    """Return True if `claim_next` may find a product of a queue. Unlike it, this locks and writes nothing."""
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
            update(Product).where(Product.digest.in_(orphans)).values(state=ProductState.PARKED, **UNLEASED)
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


def _job_by(column: Any, *more: Any) -> Executable:
    """Return the query of a frame of a running run that links to a product by ``column``, with ``more`` columns."""
    links: OfFrames = column.class_
    query = select(*FRAME_COLUMNS, *more).select_from(links)
    if links is not Frame:
        query = query.join(Frame, same_frame(links))
    return (
        query.join(Run, Run.id == Frame.run_id)
        .join(Variant, VARIANT_OF_FRAME)
        .where(column == bindparam("digest"), Run.state == RunState.RUNNING)
        .limit(1)
    )


_LOOK: Final = (Evaluation.sensor_index, Evaluation.function_index, Evaluation.prediction, Evaluation.empty)
_JOB_OF_KIND: Final = {
    ProductKind.BACKGROUND: _job_by(Frame.background),
    ProductKind.LAYER: _job_by(Frame.layer),
    ProductKind.TRUTH: _job_by(Frame.truth),
    **{ProductKind(kind): _job_by(FrameAnnotation.product) for kind in AnnotationKind},
    ProductKind.PREDICTION: _job_by(Evaluation.prediction, *_LOOK),
    ProductKind.EVALUATION: _job_by(Evaluation.scores, *_LOOK),
}
_EMPTY_JOB: Final = _job_by(Evaluation.empty, *_LOOK)
#: Kinds of products whose jobs have an `EvaluationLink`.
_LOOKS: Final = frozenset({ProductKind.PREDICTION, ProductKind.EVALUATION})


def _job(connection: Connection, digest: str, kind: ProductKind, attempts: int) -> Job | None:
    row = connection.execute(_JOB_OF_KIND[kind], {"digest": digest}).first()
    if row is None and kind is ProductKind.PREDICTION:
        row = connection.execute(_EMPTY_JOB, {"digest": digest}).first()
    if row is None:
        return None
    look = EvaluationLink.of(row) if kind in _LOOKS else None
    return Job(digest, kind, attempts, StoredFrame.of(row), look)


@cache
def held(dialect: str) -> tuple[ColumnElement[bool], ...]:
    """Return the conditions that a product is among ``digests`` and leased by ``holder``, both bound when executed."""
    return among(dialect, Product.digest), Product.lease_owner == bindparam("holder"), RUNNING


def renew(connection: Connection, digests: Collection[str], *, owner: str, until: float) -> None:
    """Extend the leases that ``owner`` still holds."""
    connection.execute(_renewal(connection.dialect.name), {"digests": digests, "holder": owner, "until": until})


@cache
def _renewal(dialect: str) -> Executable:
    return update(Product).where(in_order(dialect, *held(dialect))).values(lease_until=bindparam("until"))


def hand_back(
    connection: Connection, digests: Collection[str], *, owner: str, not_before: float, count_attempt: bool = True
) -> None:
    """Return leased products after a transient fault; they rest until ``not_before``, then the sweeper sends them again."""
    attempts = Product.attempts if count_attempt else Product.attempts - 1
    ready = {"state": ProductState.READY, "sent_at": None, "not_before": not_before, "attempts": attempts}
    _let_go(connection, digests, owner, ready)


def _let_go(connection: Connection, digests: Collection[str], owner: str, values: Values) -> None:
    dialect = connection.dialect.name
    released = update(Product).where(in_order(dialect, *held(dialect))).values({**UNLEASED, **values})
    connection.execute(released, {"digests": digests, "holder": owner})


def await_inputs(connection: Connection, digests: Collection[str], *, owner: str) -> None:
    """Return leased products to waiting: their inputs have to be made again."""
    _let_go(connection, digests, owner, {"state": ProductState.WAITING})
