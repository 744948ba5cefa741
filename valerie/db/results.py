"""Queries about results: the long table (one row per person in an evaluation), frames, failures.

A row that holds measures has one column for each measure of `valerie.measures`; the other rows are dataclasses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any, Final, NamedTuple

from sqlalchemy import (
    BigInteger,
    Connection,
    Double,
    Row,
    Select,
    String,
    and_,
    case,
    func,
    literal,
    or_,
    select,
    tuple_,
)
from sqlalchemy.orm import aliased

from valerie.db.links import (
    FRAME_COLUMNS,
    VARIANT_OF_FRAME,
    OfFrames,
    StoredFrame,
    frame_order,
    key_of,
    names_frame,
    same_frame,
)
from valerie.db.models import (
    Assignment,
    Base,
    Evaluation,
    Frame,
    FrameAnnotation,
    PersonLight,
    PersonScore,
    PersonView,
    Product,
    Score,
    Variant,
)
from valerie.db.rows import read_all
from valerie.errors import InvalidInput, NotFound, UnknownName
from valerie.measures import Source, measures_from, names_from
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.frames import FrameKey
from valerie.runs.products import ProductError
from valerie.runs.states import ProductKind, ProductState

#: The light of a frame, where its run asked for it.
_LIGHT_OF_FRAME = and_(same_frame(FrameAnnotation), FrameAnnotation.kind == AnnotationKind.LIGHT.value)
_LIGHT_OF_PERSON = and_(
    PersonLight.product == FrameAnnotation.product, PersonLight.instance_id == PersonView.instance_id
)

#: The table that holds the measures from each source.
_TABLES: Final[dict[Source, type[Base]]] = {
    Source.PLACE: PersonView,
    Source.PIXELS: PersonView,
    Source.LIGHT: PersonLight,
    Source.PERSON_SCORE: PersonScore,
    Source.FRAME_SCORE: Score,
}
#: Columns of the long table that can be filtered and sorted by, and what they are in the database.
COLUMNS: Final[dict[str, Any]] = {
    "variant_index": Frame.variant_index,
    "camera_index": Frame.camera_index,
    "time_index": Frame.time_index,
    "sensor_index": Evaluation.sensor_index,
    "function_index": Evaluation.function_index,
    "instance_id": PersonView.instance_id,
    **{measure.name: getattr(_TABLES[measure.source], measure.name) for measure in measures_from(*_TABLES)},
}

#: What tells the rows of one run's long table apart.
KEY: Final = ("variant_index", "camera_index", "time_index", "sensor_index", "function_index", "instance_id")
_COMPARISONS: Final[dict[str, Any]] = {
    "eq": lambda column, value: column == value,
    "ne": lambda column, value: column != value,
    "lt": lambda column, value: column < value,
    "le": lambda column, value: column <= value,
    "gt": lambda column, value: column > value,
    "ge": lambda column, value: column >= value,
    "null": lambda column, value: column.is_(None) if value else column.is_not(None),
}


@dataclass(frozen=True, slots=True)
class Filter:
    """One condition on the long table, e.g. ``Filter("distance_m", "gt", 25.0)``.

    ``comparison`` is one of eq, ne, lt, le, gt, ge, null (value True: is NULL).
    """

    column: str
    comparison: str
    value: float | int | str | bool


def long_table(run_id: str, *, filters: Sequence[Filter] = ()) -> Select[Any]:
    """Return the SELECT of the evaluated part of a run: one row per (frame, sensor, function, person), with the assignment.

    Raises:
        UnknownName: a filter names no column or comparison.
    """
    query = (
        select(*(column.label(name) for name, column in COLUMNS.items()), Variant.assignment)
        .select_from(Evaluation)
        .join(Frame, same_frame(Evaluation))
        .join(Variant, VARIANT_OF_FRAME)
        .join(Score, Score.digest == Evaluation.scores)
        .join(PersonView, PersonView.truth == case((Evaluation.distorted, Evaluation.scores), else_=Frame.truth))
        .outerjoin(FrameAnnotation, _LIGHT_OF_FRAME)
        .outerjoin(PersonLight, _LIGHT_OF_PERSON)
        .outerjoin(
            PersonScore,
            and_(PersonScore.digest == Evaluation.scores, PersonScore.instance_id == PersonView.instance_id),
        )
        .where(Evaluation.run_id == run_id)
    )
    for condition in filters:
        query = query.where(_condition(condition))
    return query


def rows(connection: Connection, run_id: str, *, filters: Sequence[Filter] = ()) -> Iterator[Row[Any]]:
    """Read the long table as a stream, in the order of the variants.

    Raises:
        UnknownName: a filter names no column or comparison.
    """
    query = long_table(run_id, filters=filters).order_by(*(COLUMNS[name] for name in KEY))
    yield from connection.execution_options(yield_per=5_000).execute(query)


def lost_rows(connection: Connection, run_id: str) -> Iterator[Row[Any]]:
    """Read the rows that the long table lacks: evaluations without scores, in the order of the variants.

    There is one row per person where the truth is stored, else one row without any values of a person.
    """
    query = (
        select(*(column.label(name) for name, column in COLUMNS.items()), Variant.assignment)
        .select_from(Evaluation)
        .join(Frame, same_frame(Evaluation))
        .join(Variant, VARIANT_OF_FRAME)
        .outerjoin(Score, Score.digest == Evaluation.scores)
        .outerjoin(PersonView, and_(PersonView.truth == Frame.truth, Evaluation.distorted.is_(False)))
        .outerjoin(FrameAnnotation, _LIGHT_OF_FRAME)
        .outerjoin(PersonLight, _LIGHT_OF_PERSON)
        .outerjoin(
            PersonScore,
            and_(PersonScore.digest == Evaluation.scores, PersonScore.instance_id == PersonView.instance_id),
        )
        .where(Evaluation.run_id == run_id, Score.digest.is_(None))
        .order_by(*(COLUMNS[name] for name in KEY))
    )
    yield from connection.execution_options(yield_per=5_000).execute(query)


def page(
    connection: Connection,
    run_id: str,
    *,
    filters: Sequence[Filter],
    sort: str,
    descending: bool,
    limit: int,
    after: Sequence[Any] | None = None,
) -> list[Row[Any]]:
    """Read rows of the long table in the order of a column, then of the key; rows without a value come last.

    Args:
        connection: to read with.
        run_id: of an existing run.
        filters: all must hold.
        sort: a column of `COLUMNS`.
        descending: turns the order of the column, not of the key.
        limit: most rows.
        after: `position` of the last row seen; rows that a running run adds later move nothing.

    Raises:
        UnknownName: ``sort`` or a filter names no column.
    """
    if sort not in COLUMNS:
        raise UnknownName("column", sort, COLUMNS, field="sort")
    column = COLUMNS[sort]
    key = tuple_(*(COLUMNS[name] for name in KEY))
    query = long_table(run_id, filters=filters)
    if after is not None:
        value, *place = after
        behind = key > tuple_(*(literal(part, BigInteger) for part in place))
        if value is None:
            query = query.where(column.is_(None), behind)
        else:
            bound = _literal(value)
            further = column < bound if descending else column > bound
            query = query.where(or_(further, and_(column == bound, behind), column.is_(None)))
    order = [column.is_(None), column.desc() if descending else column.asc(), *(COLUMNS[name] for name in KEY)]
    return list(connection.execute(query.order_by(*order).limit(limit)))


def position(row: Row[Any], sort: str) -> tuple[Any, ...]:
    """Return the place of a row of `page` in its order."""
    values = row._mapping  # noqa: SLF001  # public in SQLAlchemy
    return (values[sort], *(values[name] for name in KEY))


def count(connection: Connection, run_id: str, *, filters: Sequence[Filter]) -> int:
    """Return the number of rows of the long table.

    Raises:
        UnknownName: a filter names no column.
    """
    query = long_table(run_id, filters=filters).with_only_columns(func.count(), maintain_column_froms=True)
    return int(connection.scalar(query) or 0)


@dataclass(frozen=True, slots=True)
class Point:
    """A row of the long table as a scatter plot needs it; ``x`` is None where no column was asked for."""

    variant_index: int
    camera_index: int
    time_index: int
    sensor_index: int
    function_index: int
    instance_id: int
    pacc: float | None
    undefined_reason: str | None
    x: float | None = None


def points(connection: Connection, run_id: str, column: str | None, *, share: float = 1.0) -> list[Point]:
    """Read the points of a scatter plot, in the order of the variants.

    Args:
        connection: to read with.
        run_id: of an existing run.
        column: of `COLUMNS`, numeric; None: there is no ``x``.
        share: below 1, an even sample of the variants: Knuth's multiplicative hash of their index decides.

    Raises:
        UnknownName: no such column.
    """
    if column is not None and column not in COLUMNS:
        raise UnknownName("column", column, COLUMNS, field="column")
    wanted = [COLUMNS[name] for name in (*KEY, "pacc", "undefined_reason", *(() if column is None else (column,)))]
    query = long_table(run_id).with_only_columns(*wanted, maintain_column_froms=True)
    if share < 1.0:
        spread = Frame.variant_index * literal(2_654_435_761, BigInteger) % literal(2**32, BigInteger)
        query = query.where(spread < literal(int(share * 2**32), BigInteger))
    return read_all(connection, query.order_by(*(COLUMNS[name] for name in KEY)), Point)


def _condition(condition: Filter) -> Any:
    if condition.column not in COLUMNS:
        raise UnknownName("column", condition.column, COLUMNS, field="filter")
    if condition.comparison not in _COMPARISONS:
        raise UnknownName("comparison", condition.comparison, _COMPARISONS, field=f"filter.{condition.column}")
    column = COLUMNS[condition.column]
    textual = condition.column == "undefined_reason"
    if condition.comparison != "null" and isinstance(condition.value, str) is not textual:
        raise InvalidInput(
            "wrong type of value",
            field=f"filter.{condition.column}",
            value=condition.value,
            limit="text" if textual else "a number",
        )
    value = condition.value if condition.comparison == "null" else _literal(condition.value)
    return _COMPARISONS[condition.comparison](column, value)


def _literal(value: Any) -> Any:
    # With the column's own type, Postgres would round 2.5 to an integer, or refuse 1e300 as one.
    return literal(value, String if isinstance(value, str) else Double)


def assignments(connection: Connection, run_id: str, variants: Set[int]) -> dict[int, Assignment]:
    """Read the assignment of each of ``variants`` (indexes) of a run."""
    if not variants:
        return {}
    rows = connection.execute(
        select(Variant.index, Variant.assignment).where(
            Variant.run_id == run_id, Variant.index.between(min(variants), max(variants)), Variant.rejection.is_(None)
        )
    )
    # By position: `index` is a method of every row.
    return {index: assignment for index, assignment in rows if index in variants}


def frame(connection: Connection, key: FrameKey) -> StoredFrame:
    """Read one frame.

    Raises:
        NotFound: no such frame.
    """
    query = select(*FRAME_COLUMNS).select_from(Frame).join(Variant, VARIANT_OF_FRAME).where(names_frame(Frame, key))
    row = connection.execute(query).first()
    if row is None:
        raise NotFound("frame", key)
    return StoredFrame.of(row)


def frames_page(
    connection: Connection, run_id: str, *, after: FrameKey | None = None, limit: int
) -> list[tuple[StoredFrame, tuple[ProductState, ProductState, ProductState]]]:
    """Read the frames of a run after one, in order, each with the states of its background, layer and truth."""
    background, layer, truth = aliased(Product), aliased(Product), aliased(Product)
    query = (
        select(
            *FRAME_COLUMNS,
            background.state.label("background_state"),
            layer.state.label("layer_state"),
            truth.state.label("truth_state"),
        )
        .select_from(Frame)
        .join(Variant, VARIANT_OF_FRAME)
        .join(background, background.digest == Frame.background)
        .join(layer, layer.digest == Frame.layer)
        .join(truth, truth.digest == Frame.truth)
        .where(Frame.run_id == run_id)
        .order_by(*frame_order(Frame))
        .limit(limit)
    )
    if after is not None:
        query = query.where(tuple_(*frame_order(Frame)) > _place(after))
    return [
        (StoredFrame.of(row), (row.background_state, row.layer_state, row.truth_state))
        for row in connection.execute(query)
    ]


def _place(key: FrameKey) -> Any:
    """Return a frame's place in its run, to be compared with `frame_order`."""
    return tuple_(*(literal(part, BigInteger) for part in (key.variant, key.camera, key.time)))


def finished_frames(connection: Connection, run_id: str) -> Iterator[tuple[StoredFrame, list[Row[Any]]]]:
    """Read the frames whose image and truth are stored, in order, each with one row per person.

    A row has the columns of `PersonView` and the light on the person. A frame without any person has one row, with instance 0.
    """
    background, layer, truth = aliased(Product), aliased(Product), aliased(Product)
    query: Select[Any] = (
        select(
            *FRAME_COLUMNS,
            *(column for column in PersonView.__table__.columns if column.name != "truth"),
            *(COLUMNS[name] for name in names_from(Source.LIGHT)),
        )
        .select_from(Frame)
        .join(Variant, VARIANT_OF_FRAME)
        .join(background, background.digest == Frame.background)
        .join(layer, layer.digest == Frame.layer)
        .join(truth, truth.digest == Frame.truth)
        .join(PersonView, PersonView.truth == Frame.truth)
        .outerjoin(FrameAnnotation, _LIGHT_OF_FRAME)
        .outerjoin(PersonLight, _LIGHT_OF_PERSON)
        .where(
            Frame.run_id == run_id,
            background.state == ProductState.DONE,
            layer.state == ProductState.DONE,
            truth.state == ProductState.DONE,
        )
        .order_by(*frame_order(Frame), PersonView.instance_id)
    )
    rows = connection.execution_options(yield_per=5_000).execute(query)
    for _, persons in groupby(rows, partial(key_of, run_id)):
        members = list(persons)
        yield StoredFrame.of(members[0]), members


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
    """Read everything that is evaluated as a stream."""
    query = (
        select(Evaluation.sensor_index, Evaluation.function_index, Score.confusion, COLUMNS["miou"])
        .join(Score, Score.digest == Evaluation.scores)
        .where(Evaluation.run_id == run_id)
    )
    for row in connection.execution_options(yield_per=5_000).execute(query):
        yield FrameConfusion(*row)


def neighbours(connection: Connection, key: FrameKey) -> tuple[FrameKey | None, FrameKey | None]:
    """Return the frames before and after one, in the order of `frames_page`; None at the ends."""
    columns, here = frame_order(Frame), _place(key)

    def nearest(condition: Any, order: list[Any]) -> FrameKey | None:
        query = select(*columns).where(Frame.run_id == key.run_id, condition).order_by(*order).limit(1)
        row = connection.execute(query).first()
        return None if row is None else key_of(key.run_id, row)

    return (
        nearest(tuple_(*columns) < here, [column.desc() for column in columns]),
        nearest(tuple_(*columns) > here, [column.asc() for column in columns]),
    )


def person_scores(connection: Connection, scores: Sequence[str]) -> dict[str, list[Row[Any]]]:
    """Read tp, fn and pacc of each person, by the digest of the scores product."""
    rows = connection.execute(
        select(*PersonScore.__table__.columns)
        .where(PersonScore.digest.in_(scores))
        .order_by(PersonScore.digest, PersonScore.instance_id)
    )
    found: dict[str, list[Row[Any]]] = {digest: [] for digest in scores}
    for row in rows:
        found[row.digest].append(row)
    return found


def frame_evaluations(connection: Connection, key: FrameKey) -> list[Row[Any]]:
    """Read the evaluations of one frame: links, states and scores."""
    prediction, scores = aliased(Product), aliased(Product)
    return list(
        connection.execute(
            select(
                Evaluation.sensor_index,
                Evaluation.function_index,
                Evaluation.prediction,
                Evaluation.scores,
                prediction.state.label("prediction_state"),
                scores.state.label("scores_state"),
                *(column for column in Score.__table__.columns if column.name not in ("digest", "confusion")),
            )
            .join(prediction, prediction.digest == Evaluation.prediction)
            .join(scores, scores.digest == Evaluation.scores)
            .outerjoin(Score, Score.digest == Evaluation.scores)
            .where(names_frame(Evaluation, key))
            .order_by(Evaluation.sensor_index, Evaluation.function_index)
        )
    )


def person_views(connection: Connection, truth: str) -> list[Row[Any]]:
    """Read the visibility of the persons in one truth product."""
    return list(
        connection.execute(
            select(*PersonView.__table__.columns).where(PersonView.truth == truth).order_by(PersonView.instance_id)
        )
    )


class AnnotationLink(NamedTuple):
    """An annotation of a frame: its product and that product's state."""

    product: str
    state: ProductState


def frame_annotations(connection: Connection, key: FrameKey) -> dict[str, AnnotationLink]:
    """Read the annotations of one frame by kind."""
    rows = connection.execute(
        select(FrameAnnotation.kind, FrameAnnotation.product, Product.state)
        .join(Product, Product.digest == FrameAnnotation.product)
        .where(names_frame(FrameAnnotation, key))
        .order_by(FrameAnnotation.kind)
    )
    return {kind: AnnotationLink(product, state) for kind, product, state in rows}


def person_lights(connection: Connection, product: str) -> list[Row[Any]]:
    """Read the light on the persons in one product of kind ``light``."""
    return list(
        connection.execute(
            select(*PersonLight.__table__.columns)
            .where(PersonLight.product == product)
            .order_by(PersonLight.instance_id)
        )
    )


def product_state(connection: Connection, digest: str) -> ProductState:
    """Read the state of one product.

    Raises:
        NotFound: no such product.
    """
    state = connection.scalar(select(Product.state).where(Product.digest == digest))
    if state is None:
        raise NotFound("product", digest)
    return state


class FailedLink(NamedTuple):
    """A product that failed for good, as one frame of a run links to it.

    Attributes:
        frame: the frame.
        digest, kind: of the product.
        error: why.
    """

    frame: FrameKey
    digest: str
    kind: ProductKind
    error: ProductError


def failures(connection: Connection, run_id: str, *, limit: int = 1000) -> list[FailedLink]:
    """Read what failed for good in a run, one entry per link, in the order of the stages."""
    links: tuple[tuple[OfFrames, Any], ...] = (
        (Frame, Frame.background),
        (Frame, Frame.layer),
        (Frame, Frame.truth),
        (FrameAnnotation, FrameAnnotation.product),
        (Evaluation, Evaluation.prediction),
        (Evaluation, Evaluation.scores),
    )
    failed: list[FailedLink] = []
    for table, column in links:
        query = (
            select(*frame_order(table), Product.digest, Product.kind, Product.error)
            .join(Product, Product.digest == column)
            .where(table.run_id == run_id, Product.state == ProductState.FAILED)
            .order_by(*frame_order(table))
            .limit(limit - len(failed))
        )
        rows = connection.execute(query)
        failed += [FailedLink(key_of(run_id, row), row.digest, row.kind, row.error) for row in rows]
        if len(failed) >= limit:
            break
    return failed
