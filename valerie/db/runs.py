"""Every query about runs: their rows, blocks, variants, frames and links, and how far they are."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Connection, Row, case, delete, func, insert, literal, or_, select, union, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import aliased

from valerie.db.links import same_frame
from valerie.db.models import Block, Evaluation, Frame, FrameAnnotation, Product, Run, Variant
from valerie.errors import Conflict, NotFound
from valerie.runs.states import UPLOADED_ROUTE

ACTIVE = ("submitted", "running", "paused", "finishing")


def now_utc() -> datetime:
    return datetime.now(UTC)


def create(connection: Connection, values: dict[str, Any]) -> str:
    """Insert a run and return its id; with a known idempotency key, the id of the run that has it.

    Raises:
        Conflict: the idempotency key belongs to a run with another spec.
    """
    known = _of_key(connection, values)
    if known is not None:
        return known
    try:
        with connection.begin_nested():
            connection.execute(insert(Run).values(**values))
    except IntegrityError as error:
        # On Postgres another request with the same key may have been faster between the question and the insert.
        known = _of_key(connection, values)
        if known is not None:
            return known
        raise Conflict(f"the run could not be stored: {error.orig}") from error
    return str(values["id"])


def _of_key(connection: Connection, values: dict[str, Any]) -> str | None:
    """Id of the run that has the idempotency key already."""
    key = values.get("idempotency_key")
    if key is None:
        return None
    known = connection.execute(select(Run.id, Run.spec_digest).where(Run.idempotency_key == key)).first()
    if known is None:
        return None
    if known.spec_digest != values["spec_digest"]:
        raise Conflict(f"the idempotency key {key!r} was used for another spec (run {known.id})")
    return str(known.id)


def get(connection: Connection, run_id: str) -> Row[Any]:
    """The whole row of a run.

    Raises:
        NotFound: no such run.
    """
    row = connection.execute(select(*Run.__table__.columns).where(Run.id == run_id)).first()
    if row is None:
        raise NotFound("run", run_id)
    return row


def page(
    connection: Connection, *, limit: int, before: tuple[datetime, str] | None = None, state: str | None = None
) -> list[Row[Any]]:
    """Runs, newest first; ``before`` is the (created_at, id) of the last one seen."""
    query = select(*Run.__table__.columns).order_by(Run.created_at.desc(), Run.id.desc()).limit(limit)
    if before is not None:
        created, run_id = before
        query = query.where(or_(Run.created_at < created, (Run.created_at == created) & (Run.id < run_id)))
    if state is not None:
        query = query.where(Run.state == state)
    return list(connection.execute(query))


def in_states(connection: Connection, states: Sequence[str]) -> list[Row[Any]]:
    """All runs in one of ``states``, oldest first."""
    return list(
        connection.execute(select(*Run.__table__.columns).where(Run.state.in_(states)).order_by(Run.created_at, Run.id))
    )


def count_by_state(connection: Connection) -> list[tuple[str, int]]:
    """(state, number of runs)."""
    rows = connection.execute(select(Run.state, func.count()).group_by(Run.state))
    return [(state, int(count)) for state, count in rows]


def change_state(
    connection: Connection,
    run_id: str,
    *,
    expected: Sequence[str],
    state: str,
    reason: str | None = None,
    **values: Any,
) -> bool:
    """Move a run from one of ``expected`` to ``state``; False when it was in none of them (someone else was faster)."""
    changed = connection.execute(
        update(Run).where(Run.id == run_id, Run.state.in_(expected)).values(state=state, reason=reason, **values)
    )
    return changed.rowcount == 1


def set_values(connection: Connection, run_id: str, **values: Any) -> None:
    """Set columns of a run."""
    connection.execute(update(Run).where(Run.id == run_id).values(**values))


def remove(connection: Connection, run_id: str) -> None:
    """Delete a run with its variants, frames and links; products stay until `gc` finds nobody linking them."""
    for table in (Evaluation, FrameAnnotation, Frame, Variant, Block):
        connection.execute(delete(table).where(table.run_id == run_id))
    connection.execute(delete(Run).where(Run.id == run_id))


def linked_digests(connection: Connection, run_id: str, states: Sequence[str]) -> list[str]:
    """Digests of the run's products in one of ``states``."""
    links = union(
        select(Frame.background).where(Frame.run_id == run_id),
        select(Frame.layer).where(Frame.run_id == run_id),
        select(Frame.truth).where(Frame.run_id == run_id),
        select(FrameAnnotation.product).where(FrameAnnotation.run_id == run_id),
        select(Evaluation.prediction).where(Evaluation.run_id == run_id),
        select(Evaluation.scores).where(Evaluation.run_id == run_id),
    ).subquery()
    return list(
        connection.scalars(
            select(Product.digest).join(links, links.c[0] == Product.digest).where(Product.state.in_(states))
        )
    )


def open_block(connection: Connection, run_id: str, first: int, last: int) -> None:
    """Add the block of the variants ``first`` … ``last``, which were just written."""
    number = select(func.coalesce(func.max(Block.number) + 1, 0)).where(Block.run_id == run_id).scalar_subquery()
    connection.execute(
        insert(Block).values(run_id=run_id, number=number, first=first, last=last, closed=False, counts={})
    )


def open_blocks(connection: Connection, run_id: str) -> list[Row[Any]]:
    """Blocks that are not finished yet."""
    return list(
        connection.execute(
            select(Block.number, Block.first, Block.last, Block.counts)
            .where(Block.run_id == run_id, Block.closed.is_(False))
            .order_by(Block.number)
        )
    )


def closed_counts(connection: Connection, run_id: str) -> list[tuple[int, dict[str, int]]]:
    """(number, counts) of the finished blocks."""
    rows = connection.execute(select(Block.number, Block.counts).where(Block.run_id == run_id, Block.closed.is_(True)))
    return [(row.number, row.counts) for row in rows]


def close_block(connection: Connection, run_id: str, number: int, counts: dict[str, int]) -> None:
    """A block is finished; its counts are final until a retry opens it again."""
    connection.execute(
        update(Block).where(Block.run_id == run_id, Block.number == number).values(closed=True, counts=counts)
    )


def reopen_blocks(connection: Connection, run_id: str) -> None:
    """Count every block again (after a retry)."""
    connection.execute(update(Block).where(Block.run_id == run_id).values(closed=False))


def count_block(connection: Connection, run_id: str, first: int, last: int) -> dict[str, int]:
    """How far the variants ``first`` … ``last`` are.

    Returns:
        frames, rendered, render_failed; evaluations, inferred, infer_failed, evaluated, eval_failed. A frame is rendered when
        its background, layer, truth and annotations are done; a failure counts at the stage where it happened and at those after
        it.
    """
    background, layer, truth = aliased(Product), aliased(Product), aliased(Product)
    states = (background.state, layer.state, truth.state)
    done = (states[0] == "done") & (states[1] == "done") & (states[2] == "done")
    failed = (states[0] == "failed") | (states[1] == "failed") | (states[2] == "failed")
    annotation = (
        select(literal(1))
        .select_from(FrameAnnotation)
        .join(Product, Product.digest == FrameAnnotation.product)
        .where(same_frame(FrameAnnotation))
        .correlate(Frame)
    )
    done &= ~annotation.where(Product.state != "done").exists()
    failed |= annotation.where(Product.state == "failed").exists()
    frames = connection.execute(
        select(func.count(), func.sum(case((done, 1), else_=0)), func.sum(case((failed, 1), else_=0)))
        .select_from(Frame)
        .join(background, background.digest == Frame.background)
        .join(layer, layer.digest == Frame.layer)
        .join(truth, truth.digest == Frame.truth)
        .where(Frame.run_id == run_id, Frame.variant_index.between(first, last))
    ).one()
    prediction, scores = aliased(Product), aliased(Product)

    def total(condition: Any) -> Any:
        return func.sum(case((condition, 1), else_=0))

    evaluations = connection.execute(
        select(
            func.count(),
            total(prediction.state == "done"),
            total(prediction.state == "failed"),
            total(scores.state == "done"),
            total(scores.state == "failed"),
        )
        .select_from(Evaluation)
        .join(prediction, prediction.digest == Evaluation.prediction)
        .join(scores, scores.digest == Evaluation.scores)
        .where(Evaluation.run_id == run_id, Evaluation.variant_index.between(first, last))
    ).one()
    names = (
        "frames",
        "rendered",
        "render_failed",
        "evaluations",
        "inferred",
        "infer_failed",
        "evaluated",
        "eval_failed",
    )
    return dict(zip(names, (int(value or 0) for value in (*frames, *evaluations)), strict=True))


def awaited(connection: Connection, run_id: str, function_index: int) -> list[str]:
    """Return the digests of a function's predictions that can be uploaded: their frames are rendered."""
    return list(
        connection.scalars(
            select(Product.digest)
            .join(Evaluation, Evaluation.prediction == Product.digest)
            .where(Evaluation.run_id == run_id, Evaluation.function_index == function_index, *_AWAITED)
            .distinct()
        )
    )


def awaited_count(connection: Connection, run_id: str) -> int:
    """Return how many predictions of a run are still to be uploaded."""
    statement = (
        select(func.count(Product.digest.distinct()))
        .join(Evaluation, Evaluation.prediction == Product.digest)
        .where(Evaluation.run_id == run_id, *_AWAITED)
    )
    return connection.scalar(statement) or 0


_AWAITED = (Product.state == "ready", Product.route == UPLOADED_ROUTE)


def rejections(connection: Connection, run_id: str) -> dict[str, int]:
    """Rejected variants by reason."""
    rows = connection.execute(
        select(Variant.rejection, func.count())
        .where(Variant.run_id == run_id, Variant.rejection.is_not(None))
        .group_by(Variant.rejection)
    )
    return {str(reason): int(count) for reason, count in rows}


def variants_page(
    connection: Connection, run_id: str, *, after: int, limit: int, rejected: bool | None = None
) -> list[Row[Any]]:
    """Variants with an index above ``after``, ascending."""
    query = (
        select(Variant.index, Variant.block, Variant.assignment, Variant.rejection)
        .where(Variant.run_id == run_id, Variant.index > after)
        .order_by(Variant.index)
        .limit(limit)
    )
    if rejected is not None:
        query = query.where(Variant.rejection.is_not(None) if rejected else Variant.rejection.is_(None))
    return list(connection.execute(query))
