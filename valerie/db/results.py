"""Queries about the results of functions on frames, and about failures."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from sqlalchemy import Connection, bindparam, select
from sqlalchemy.orm import aliased

from valerie.db.links import PRODUCT_LINKS, among_frames, frame_order, frame_values, key_of, names_frame
from valerie.db.long_table import COLUMNS
from valerie.db.measured import FrameScore
from valerie.db.models import Evaluation, Product, Score
from valerie.errors import NotFound
from valerie.measures import Source, names_from
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.ready import ProductError
from valerie.runs.products.states import ProductKind, ProductState

_SCORED: Final = names_from(Source.FRAME_SCORE)


class StoredPrediction(NamedTuple):
    """An evaluated prediction: the digest of its label map, and its packed confusion matrix."""

    digest: str
    confusion: bytes


def predictions(connection: Connection, run_id: str, sensor: int, function: int) -> dict[FrameKey, StoredPrediction]:
    """Read the evaluated predictions of one function through one sensor, by frame."""
    rows = connection.execute(
        select(*frame_order(Evaluation), Evaluation.prediction, Score.confusion)
        .join(Score, Score.digest == Evaluation.scores)
        .where(Evaluation.run_id == run_id, Evaluation.sensor_index == sensor, Evaluation.function_index == function)
    )
    return {key_of(run_id, row): StoredPrediction(row.prediction, row.confusion) for row in rows}


class FrameConfusion(NamedTuple):
    """An evaluation: sensor and function index, packed confusion matrix, mean IoU."""

    sensor: int
    function: int
    confusion: bytes
    miou: float | None


def confusions(connection: Connection, run_id: str) -> Iterator[FrameConfusion]:
    """Read all evaluations of a run that have scores, as a stream."""
    query = (
        select(Evaluation.sensor_index, Evaluation.function_index, Score.confusion, COLUMNS["miou"])
        .join(Score, Score.digest == Evaluation.scores)
        .where(Evaluation.run_id == run_id)
    )
    for row in connection.execution_options(yield_per=5_000).execute(query):
        yield FrameConfusion(*row)


@dataclass(frozen=True, slots=True)
class FrameEvaluation:
    """An evaluation of a frame.

    Attributes:
        sensor_index, function_index: indexes in the run's spec.
        prediction, scores, empty: digests of its products; ``empty`` is None if backgrounds are not inferred.
        prediction_state, scores_state: states of these products.
        score: None until the scores are done.
    """

    sensor_index: int
    function_index: int
    prediction: str
    scores: str
    empty: str | None
    prediction_state: ProductState
    scores_state: ProductState
    score: FrameScore | None


class PredictionLink(NamedTuple):
    """The prediction of a function for a frame through a sensor.

    Attributes:
        sensor_index, function_index: indexes in the run's spec.
        prediction: digest of the prediction.
        state: its state.
    """

    sensor_index: int
    function_index: int
    prediction: str
    state: ProductState


def prediction_links(connection: Connection, keys: Collection[FrameKey]) -> dict[FrameKey, list[PredictionLink]]:
    """Read the links of frames of one run to predictions, in the order of sensors and functions."""
    query = (
        select(
            Evaluation.run_id,
            *frame_order(Evaluation),
            Evaluation.sensor_index,
            Evaluation.function_index,
            Evaluation.prediction,
            Product.state,
        )
        .join(Product, Product.digest == Evaluation.prediction)
        .where(among_frames(Evaluation, keys))
        .order_by(Evaluation.sensor_index, Evaluation.function_index)
    )
    found: dict[FrameKey, list[PredictionLink]] = {key: [] for key in keys}
    for row in connection.execute(query):
        found[key_of(row.run_id, row)].append(PredictionLink(*row[4:]))
    return found


_prediction, _scores = aliased(Product), aliased(Product)
#: Built once: building it takes longer than running it.
_OF_FRAME: Final = (
    select(
        Evaluation.sensor_index,
        Evaluation.function_index,
        Evaluation.prediction,
        Evaluation.scores,
        Evaluation.empty,
        _prediction.state,
        _scores.state,
        Score.confusion,
        Score.tp,
        Score.fn,
        Score.tn,
        Score.pacc,
        *(COLUMNS[name] for name in _SCORED),
    )
    .join(_prediction, _prediction.digest == Evaluation.prediction)
    .join(_scores, _scores.digest == Evaluation.scores)
    .outerjoin(Score, Score.digest == Evaluation.scores)
    .where(names_frame(Evaluation))
    .order_by(Evaluation.sensor_index, Evaluation.function_index)
)


def frame_evaluations(connection: Connection, key: FrameKey) -> list[FrameEvaluation]:
    """Read the evaluations of one frame: links, states and scores."""
    evaluations: list[FrameEvaluation] = []
    for (
        sensor, function, prediction_digest, scores_digest, empty, prediction_state, scores_state,
        confusion, tp, fn, tn, pacc, *values,
    ) in connection.execute(_OF_FRAME, frame_values(key)):  # fmt: skip
        measures = dict(zip(_SCORED, values, strict=True))
        score = None if confusion is None else FrameScore(confusion, tp, fn, tn, pacc, measures)
        evaluations.append(
            FrameEvaluation(
                sensor, function, prediction_digest, scores_digest, empty, prediction_state, scores_state, score
            )
        )
    return evaluations


_STATES: Final = select(Product.digest, Product.state).where(Product.digest.in_(bindparam("digests", expanding=True)))


def product_states(connection: Connection, digests: Collection[str]) -> dict[str, ProductState]:
    """Read the states of products, in the order of the digests.

    Raises:
        NotFound: one does not exist.
    """
    states = {row.digest: row.state for row in connection.execute(_STATES, {"digests": list(digests)})}
    missing = [digest for digest in digests if digest not in states]
    if missing:
        raise NotFound("product", missing[0])
    return {digest: states[digest] for digest in digests}


class FailedLink(NamedTuple):
    """A link from one frame of a run to a product that failed for good.

    Attributes:
        frame: the frame.
        digest, kind: of the product.
        error: the cause.
    """

    frame: FrameKey
    digest: str
    kind: ProductKind
    error: ProductError


_FAILURES: Final = tuple(
    select(*frame_order(table), Product.digest, Product.kind, Product.error)
    .join(Product, Product.digest == column)
    .where(table.run_id == bindparam("run"), Product.state == ProductState.FAILED)
    .order_by(*frame_order(table))
    .limit(bindparam("most"))
    for table, column in PRODUCT_LINKS
)


def failures(connection: Connection, run_id: str, *, limit: int = 1000) -> list[FailedLink]:
    """Read the final failures of a run, one entry per link, in the order of the stages."""
    failed: list[FailedLink] = []
    for query in _FAILURES:
        rows = connection.execute(query, {"run": run_id, "most": limit - len(failed)})
        failed += [FailedLink(key_of(run_id, row), row.digest, row.kind, row.error) for row in rows]
        if len(failed) >= limit:
            break
    return failed
