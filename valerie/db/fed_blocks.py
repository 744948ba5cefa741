"""Queries about blocks: ranges of variants that are counted together."""

from __future__ import annotations

from typing import Final, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Connection,
    Executable,
    and_,
    bindparam,
    case,
    func,
    insert,
    literal,
    or_,
    select,
    update,
)
from sqlalchemy.orm import aliased

from valerie.db.links import BACKGROUND, LAYER, TRUTH, same_frame, with_products
from valerie.db.models import Evaluation, FedBlock, Frame, FrameAnnotation, Product
from valerie.runs.products.progress import BlockCounts
from valerie.runs.products.states import ProductState


class OpenBlock(NamedTuple):
    """An unfinished block: its number, and its first and last variant."""

    number: int
    first: int
    last: int


def open_block(connection: Connection, run_id: str, first: int, last: int) -> None:
    """Add the block of the variants ``first`` … ``last``."""
    number = select(func.coalesce(func.max(FedBlock.number) + 1, 0)).where(FedBlock.run_id == run_id).scalar_subquery()
    connection.execute(insert(FedBlock).values(run_id=run_id, number=number, first=first, last=last))


def open_blocks(connection: Connection, run_id: str) -> list[OpenBlock]:
    """Return the unfinished blocks."""
    return [OpenBlock(*row) for row in connection.execute(_OPEN, {"run": run_id})]


def closed_counts(connection: Connection, run_id: str) -> dict[int, BlockCounts]:
    """Return the counts of the finished blocks by number."""
    rows = connection.execute(select(FedBlock.number, FedBlock.counts).where(FedBlock.run_id == run_id))
    return {number: counts for number, counts in rows if counts is not None}


def close_block(connection: Connection, run_id: str, number: int, counts: BlockCounts) -> None:
    """Finish a block: its counts are final until `reopen_blocks`."""
    connection.execute(
        update(FedBlock).where(FedBlock.run_id == run_id, FedBlock.number == number).values(counts=counts)
    )


def reopen_blocks(connection: Connection, run_id: str) -> None:
    """Mark every block as unfinished, so that it is counted again."""
    connection.execute(update(FedBlock).where(FedBlock.run_id == run_id).values(counts=None))


def count_block(connection: Connection, run_id: str, first: int, last: int) -> BlockCounts:
    """Count frames and evaluations of the variants ``first`` … ``last``."""
    block: dict[str, str | int] = {"run": run_id, "first": first, "last": last}
    frames, rendered, render_failed = _counts(connection, _FRAMES, block)
    evaluations, inferred, infer_failed, evaluated, eval_failed = _counts(connection, _EVALUATIONS, block)
    return BlockCounts(
        frames=frames,
        rendered=rendered,
        render_failed=render_failed,
        evaluations=evaluations,
        inferred=inferred,
        infer_failed=infer_failed,
        evaluated=evaluated,
        eval_failed=eval_failed,
    )


def _number(condition: ColumnElement[bool]) -> ColumnElement[int]:
    """Return the number of rows that meet a condition; NULL if there are no rows."""
    return func.sum(case((condition, 1), else_=0))


def _in_block(table: type[Frame | Evaluation]) -> ColumnElement[bool]:
    return and_(table.run_id == bindparam("run"), table.variant_index.between(bindparam("first"), bindparam("last")))


def _count_frames() -> Executable:
    states = (BACKGROUND.state, LAYER.state, TRUTH.state)
    annotation = (
        select(literal(1))
        .select_from(FrameAnnotation)
        .join(Product, Product.digest == FrameAnnotation.product)
        .where(same_frame(FrameAnnotation))
        .correlate(Frame)
    )
    unfinished = annotation.where(Product.state != ProductState.DONE).exists()
    broken = annotation.where(Product.state == ProductState.FAILED).exists()
    counts = select(
        func.count(),
        _number(and_(*(state == ProductState.DONE for state in states), ~unfinished)),
        _number(or_(*(state == ProductState.FAILED for state in states), broken)),
    )
    return with_products(counts.select_from(Frame)).where(_in_block(Frame))


def _count_evaluations() -> Executable:
    prediction, scores = aliased(Product), aliased(Product)
    return (
        select(
            func.count(),
            _number(prediction.state == ProductState.DONE),
            _number(prediction.state == ProductState.FAILED),
            _number(scores.state == ProductState.DONE),
            _number(scores.state == ProductState.FAILED),
        )
        .select_from(Evaluation)
        .join(prediction, prediction.digest == Evaluation.prediction)
        .join(scores, scores.digest == Evaluation.scores)
        .where(_in_block(Evaluation))
    )


# Built once: building them costs several times as much as executing them on a block.
_FRAMES: Final = _count_frames()
_EVALUATIONS: Final = _count_evaluations()
_OPEN: Final = (
    select(FedBlock.number, FedBlock.first, FedBlock.last)
    .where(FedBlock.run_id == bindparam("run"), FedBlock.counts.is_(None))
    .order_by(FedBlock.number)
)


def _counts(connection: Connection, statement: Executable, block: dict[str, str | int]) -> list[int]:
    return [int(count or 0) for count in connection.execute(statement, block).one()]
