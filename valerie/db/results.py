"""Every query about results: the long table (one row per person in an evaluation), frames, failures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Any, Final, cast

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
from sqlalchemy.orm import InstrumentedAttribute, aliased

from valerie.db.links import velocity_of_frame
from valerie.db.models import (
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
from valerie.db.rows import columns_of, read_all
from valerie.errors import InvalidInput, NotFound, UnknownName
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products import ProductError
from valerie.runs.states import ProductKind, ProductState

_OF_FRAME = and_(
    Evaluation.run_id == Frame.run_id,
    Evaluation.variant_index == Frame.variant_index,
    Evaluation.camera_index == Frame.camera_index,
    Evaluation.time_index == Frame.time_index,
)
#: The light of a frame, where its run asked for it.
_LIGHT_OF_FRAME = and_(
    FrameAnnotation.run_id == Frame.run_id,
    FrameAnnotation.variant_index == Frame.variant_index,
    FrameAnnotation.camera_index == Frame.camera_index,
    FrameAnnotation.time_index == Frame.time_index,
    FrameAnnotation.kind == AnnotationKind.LIGHT.value,
)
_LIGHT_OF_PERSON = and_(
    PersonLight.product == FrameAnnotation.product, PersonLight.instance_id == PersonView.instance_id
)
_OF_VARIANT = and_(Variant.run_id == Frame.run_id, Variant.index == Frame.variant_index)

#: Columns of the long table that can be filtered and sorted by, and what they are in the database.
COLUMNS: Final[dict[str, Any]] = {
    "variant_index": Frame.variant_index,
    "camera_index": Frame.camera_index,
    "time_index": Frame.time_index,
    "sensor_index": Evaluation.sensor_index,
    "function_index": Evaluation.function_index,
    "instance_id": PersonView.instance_id,
    "pixel_area": PersonView.pixel_area,
    "pixel_area_percent": PersonView.pixel_area_percent,
    "pixel_area_amodal": PersonView.pixel_area_amodal,
    "occlusion_rate": PersonView.occlusion_rate,
    "truncation_rate": PersonView.truncation_rate,
    "distance_m": PersonView.distance_m,
    "depth_m": PersonView.depth_m,
    "bearing_deg": PersonView.bearing_deg,
    "aspect_deg": PersonView.aspect_deg,
    "irradiance": PersonLight.irradiance,
    "shadow_share": PersonLight.shadow_share,
    "contrast": PersonLight.contrast,
    "undefined_reason": PersonView.undefined_reason,
    "tp": PersonScore.tp,
    "fn": PersonScore.fn,
    "pacc": PersonScore.pacc,
    "frame_tp": Score.tp,
    "frame_fp": Score.fp,
    "frame_fn": Score.fn,
    "frame_tn": Score.tn,
    "frame_pacc": Score.pacc,
    "precision": Score.precision,
    "iou": Score.iou,
    "pixel_accuracy": Score.pixel_accuracy,
    "miou": Score.miou,
    "fwiou": Score.fwiou,
    "macc": Score.macc,
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
    """SELECT of the evaluated part of a run: one row per (frame, sensor, function, person), with the assignment.

    Raises:
        UnknownName: a filter names no column or comparison.
    """
    query = (
        select(*(column.label(name) for name, column in COLUMNS.items()), Variant.assignment)
        .select_from(Evaluation)
        .join(Frame, _OF_FRAME)
        .join(Variant, _OF_VARIANT)
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
    """The long table, streamed, in the order of the variants.

    Raises:
        UnknownName: a filter names no column or comparison.
    """
    query = long_table(run_id, filters=filters).order_by(*(COLUMNS[name] for name in KEY))
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
    """Rows of the long table in the order of a column, then of the key; rows without a value come last.

    Args:
        connection: to read with.
        run_id: of an existing run.
        filters: all must hold.
        sort: a column of `COLUMNS`.
        descending: turns the order of the column, not of the key.
        limit: most rows.
        after: `position` of the last row seen; rows that a running run adds meanwhile move nothing.

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
    """Where a row of `page` stands in its order."""
    values = row._mapping  # noqa: SLF001  # public in SQLAlchemy
    return (values[sort], *(values[name] for name in KEY))


def count(connection: Connection, run_id: str, *, filters: Sequence[Filter]) -> int:
    """Rows of the long table.

    Raises:
        UnknownName: a filter names no column.
    """
    query = long_table(run_id, filters=filters).with_only_columns(func.count(), maintain_column_froms=True)
    return int(connection.scalar(query) or 0)


def points(connection: Connection, run_id: str, column: str | None, *, share: float = 1.0) -> list[Row[Any]]:
    """What a scatter plot needs: the key, ``x`` (the column), ``pacc``, ``undefined_reason``.

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
    wanted = [COLUMNS[name].label(name) for name in (*KEY, "pacc", "undefined_reason")]
    if column is not None:
        wanted.append(COLUMNS[column].label("x"))
    query = long_table(run_id).with_only_columns(*wanted, maintain_column_froms=True)
    if share < 1.0:
        spread = Frame.variant_index * literal(2_654_435_761, BigInteger) % literal(2**32, BigInteger)
        query = query.where(spread < literal(int(share * 2**32), BigInteger))
    return list(connection.execute(query.order_by(*(COLUMNS[name] for name in KEY))))


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


def assignments(connection: Connection, run_id: str, variants: Set[int]) -> dict[int, dict[str, Any]]:
    """Assignment of each of ``variants`` (indexes) of a run."""
    if not variants:
        return {}
    rows = connection.execute(
        select(Variant.index, Variant.assignment).where(
            Variant.run_id == run_id, Variant.index.between(min(variants), max(variants)), Variant.rejection.is_(None)
        )
    )
    # By position: `index` is a method of every row.
    return {index: assignment for index, assignment in rows if index in variants}


def frame(connection: Connection, run_id: str, variant: int, camera: int, time: int = 0) -> Row[Any]:
    """Links of one frame with its variant's assignment.

    Raises:
        NotFound: no such frame.
    """
    row = connection.execute(
        select(*Frame.__table__.columns, Variant.assignment)
        .join(Variant, _OF_VARIANT)
        .where(
            Frame.run_id == run_id,
            Frame.variant_index == variant,
            Frame.camera_index == camera,
            Frame.time_index == time,
        )
    ).first()
    if row is None:
        raise NotFound("frame", f"{run_id}/{variant}/{camera}/{time}")
    return cast("Row[Any]", row)


def frames_page(connection: Connection, run_id: str, *, after: tuple[int, int, int], limit: int) -> list[Row[Any]]:
    """Frames after a (variant, camera, time), in order, with the assignment and the states of their products."""
    background, layer, truth = aliased(Product), aliased(Product), aliased(Product)
    variant, camera, time = after
    return list(
        connection.execute(
            select(
                Frame.variant_index,
                Frame.camera_index,
                Frame.time_index,
                Frame.background,
                Frame.layer,
                Frame.truth,
                background.state.label("background_state"),
                layer.state.label("layer_state"),
                truth.state.label("truth_state"),
                Variant.assignment,
            )
            .join(Variant, _OF_VARIANT)
            .join(background, background.digest == Frame.background)
            .join(layer, layer.digest == Frame.layer)
            .join(truth, truth.digest == Frame.truth)
            .where(
                Frame.run_id == run_id,
                or_(
                    Frame.variant_index > variant,
                    and_(Frame.variant_index == variant, Frame.camera_index > camera),
                    and_(Frame.variant_index == variant, Frame.camera_index == camera, Frame.time_index > time),
                ),
            )
            .order_by(Frame.variant_index, Frame.camera_index, Frame.time_index)
            .limit(limit)
        )
    )


def finished_frames(connection: Connection, run_id: str) -> Iterator[Row[Any]]:
    """Frames whose image and truth are there, one row per person (`PersonView`), in order, with the assignment.

    A frame without any person has one row with instance 0.
    """
    background, layer, truth = aliased(Product), aliased(Product), aliased(Product)
    query: Select[Any] = (
        select(
            *Frame.__table__.columns,
            *PersonView.__table__.columns,
            PersonLight.irradiance,
            PersonLight.shadow_share,
            PersonLight.contrast,
            Variant.assignment,
            velocity_of_frame(),
        )
        .join(Variant, _OF_VARIANT)
        .join(background, background.digest == Frame.background)
        .join(layer, layer.digest == Frame.layer)
        .join(truth, truth.digest == Frame.truth)
        .join(PersonView, PersonView.truth == Frame.truth)
        .outerjoin(FrameAnnotation, _LIGHT_OF_FRAME)
        .outerjoin(PersonLight, _LIGHT_OF_PERSON)
        .where(Frame.run_id == run_id, background.state == "done", layer.state == "done", truth.state == "done")
        .order_by(Frame.variant_index, Frame.camera_index, Frame.time_index, PersonView.instance_id)
    )
    yield from connection.execution_options(yield_per=5_000).execute(query)


def predictions(
    connection: Connection, run_id: str, sensor: int, function: int
) -> dict[tuple[int, int, int], tuple[str, bytes]]:
    """(variant, camera, time) to the digest of the prediction and the packed confusion matrix, of what is evaluated."""
    rows = connection.execute(
        select(
            Evaluation.variant_index,
            Evaluation.camera_index,
            Evaluation.time_index,
            Evaluation.prediction,
            Score.confusion,
        )
        .join(Score, Score.digest == Evaluation.scores)
        .where(Evaluation.run_id == run_id, Evaluation.sensor_index == sensor, Evaluation.function_index == function)
    )
    return {(row[0], row[1], row[2]): (row[3], row[4]) for row in rows}


def confusions(connection: Connection, run_id: str) -> Iterator[tuple[int, int, bytes, float | None]]:
    """(sensor, function, packed confusion matrix, mean IoU) of everything that is evaluated."""
    query = (
        select(Evaluation.sensor_index, Evaluation.function_index, Score.confusion, Score.miou)
        .join(Score, Score.digest == Evaluation.scores)
        .where(Evaluation.run_id == run_id)
    )
    for row in connection.execution_options(yield_per=5_000).execute(query):
        yield row[0], row[1], row[2], row[3]


def neighbours(
    connection: Connection, run_id: str, variant: int, camera: int, time: int = 0
) -> tuple[tuple[int, int, int] | None, tuple[int, int, int] | None]:
    """(variant, camera, time) of the frames before and after one, in the order of `frames_page`; None at the ends."""
    columns = (Frame.variant_index, Frame.camera_index, Frame.time_index)
    here = tuple_(*(literal(part, BigInteger) for part in (variant, camera, time)))
    found = []
    for condition, order in (
        (tuple_(*columns) < here, [column.desc() for column in columns]),
        (tuple_(*columns) > here, [column.asc() for column in columns]),
    ):
        row = connection.execute(
            select(*columns).where(Frame.run_id == run_id, condition).order_by(*order).limit(1)
        ).first()
        found.append(None if row is None else (row[0], row[1], row[2]))
    return found[0], found[1]


def person_scores(connection: Connection, scores: Sequence[str]) -> dict[str, list[Row[Any]]]:
    """tp, fn and pacc of each person, by the digest of the scores product."""
    rows = connection.execute(
        select(*PersonScore.__table__.columns)
        .where(PersonScore.digest.in_(scores))
        .order_by(PersonScore.digest, PersonScore.instance_id)
    )
    found: dict[str, list[Row[Any]]] = {digest: [] for digest in scores}
    for row in rows:
        found[row.digest].append(row)
    return found


def frame_evaluations(connection: Connection, run_id: str, variant: int, camera: int, time: int = 0) -> list[Row[Any]]:
    """Evaluations of one frame: links, states and scores."""
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
            .where(
                Evaluation.run_id == run_id,
                Evaluation.variant_index == variant,
                Evaluation.camera_index == camera,
                Evaluation.time_index == time,
            )
            .order_by(Evaluation.sensor_index, Evaluation.function_index)
        )
    )


def person_views(connection: Connection, truth: str) -> list[Row[Any]]:
    """Visibility of the persons in one truth product."""
    return list(
        connection.execute(
            select(*PersonView.__table__.columns).where(PersonView.truth == truth).order_by(PersonView.instance_id)
        )
    )


def frame_annotations(
    connection: Connection, run_id: str, variant: int, camera: int, time: int = 0
) -> dict[str, Row[Any]]:
    """Kind to ``product`` and ``state`` of the annotations of one frame."""
    rows = connection.execute(
        select(FrameAnnotation.kind, FrameAnnotation.product, Product.state)
        .join(Product, Product.digest == FrameAnnotation.product)
        .where(
            FrameAnnotation.run_id == run_id,
            FrameAnnotation.variant_index == variant,
            FrameAnnotation.camera_index == camera,
            FrameAnnotation.time_index == time,
        )
        .order_by(FrameAnnotation.kind)
    )
    return {row.kind: cast("Row[Any]", row) for row in rows}


def person_lights(connection: Connection, product: str) -> list[Row[Any]]:
    """Light on the persons in one product of kind ``light``."""
    return list(
        connection.execute(
            select(*PersonLight.__table__.columns)
            .where(PersonLight.product == product)
            .order_by(PersonLight.instance_id)
        )
    )


def product(connection: Connection, digest: str) -> Row[Any]:
    """The row of one product.

    Raises:
        NotFound: no such product.
    """
    row = connection.execute(select(*Product.__table__.columns).where(Product.digest == digest)).first()
    if row is None:
        raise NotFound("product", digest)
    return row


@dataclass(frozen=True, slots=True)
class LinkedFailure:
    """A product that failed for good, and a frame that it belongs to."""

    variant_index: int
    camera_index: int
    time_index: int
    digest: str
    kind: ProductKind
    error: ProductError


def failures(connection: Connection, run_id: str, *, limit: int = 1000) -> list[LinkedFailure]:
    """Return what failed for good in a run, at most ``limit``: one entry for each link to a failed product."""
    links: list[tuple[type[Frame | FrameAnnotation | Evaluation], InstrumentedAttribute[str]]] = [
        (Frame, Frame.background),
        (Frame, Frame.layer),
        (Frame, Frame.truth),
        (FrameAnnotation, FrameAnnotation.product),
        (Evaluation, Evaluation.prediction),
        (Evaluation, Evaluation.scores),
    ]
    linked: list[LinkedFailure] = []
    for table, column in links:
        query = (
            select(*columns_of(LinkedFailure, table, Product))
            .join(Product, Product.digest == column)
            .where(table.run_id == run_id, Product.state == ProductState.FAILED)
            .order_by(table.variant_index, table.camera_index, table.time_index)
            .limit(limit - len(linked))
        )
        linked += read_all(connection, query, LinkedFailure)
        if len(linked) >= limit:
            break
    return linked
