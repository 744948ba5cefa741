"""Queries about the long table of a run: one row per person in an evaluation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeVar

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
    Double,
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
from sqlalchemy.orm import InstrumentedAttribute

from valerie.db.links import LIGHT_OF_FRAME, LIGHT_OF_PERSON, VARIANT_OF_FRAME, same_frame
from valerie.db.models import (
    Assignment,
    Base,
    Evaluation,
    Frame,
    FrameAnnotation,
    PersonLight,
    PersonScore,
    PersonView,
    Picture,
    Score,
    Variant,
)
from valerie.db.rows import read_all
from valerie.errors import InvalidInput, UnknownName
from valerie.measures import Cell, Measures, Source, measures_from
from valerie.runs.products.frame_keys import FrameKey

#: The table that holds the measures from each source.
_TABLES: Final[dict[Source, type[Base]]] = {
    Source.PLACE: PersonView,
    Source.PIXELS: PersonView,
    Source.LIGHT: PersonLight,
    Source.PICTURE: Picture,
    Source.PERSON_SCORE: PersonScore,
    Source.FRAME_SCORE: Score,
}
#: Columns of the long table that can be filtered and sorted by, with their columns in the database.
COLUMNS: Final[Mapping[str, InstrumentedAttribute[Any]]] = {
    "variant_index": Evaluation.variant_index,
    "camera_index": Evaluation.camera_index,
    "time_index": Evaluation.time_index,
    "sensor_index": Evaluation.sensor_index,
    "function_index": Evaluation.function_index,
    "instance_id": PersonView.instance_id,
    **{measure.name: getattr(_TABLES[measure.source], measure.name) for measure in measures_from(*_TABLES)},
}


def measure_columns() -> tuple[Column[Any], ...]:
    """Return the columns of the database that hold measures."""
    tables = Base.metadata.tables
    return tuple(
        tables[_TABLES[measure.source].__tablename__].columns[measure.name] for measure in measures_from(*_TABLES)
    )


#: Columns that identify a row in one run's long table.
KEY: Final = ("variant_index", "camera_index", "time_index", "sensor_index", "function_index", "instance_id")
#: Rows read at a time.
_PIECE: Final = 10_000
_MEASURES: Final = tuple(name for name in COLUMNS if name not in KEY)
_COMPARISONS: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
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


R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class _Row:
    """A frame as seen by a function through a sensor setting.

    Attributes:
        frame: the frame.
        sensor_index, function_index: indexes in the run's spec.
        measures: name to value, from all stored sources.
        assignment: parameter path to value, of the variant.
    """

    frame: FrameKey
    sensor_index: int
    function_index: int
    measures: Measures
    assignment: Assignment


@dataclass(frozen=True, slots=True)
class LostRow(_Row):
    """A row that the long table lacks because its evaluation has no scores.

    ``instance_id`` is None if the truth is not stored either: then it is unknown which persons are visible.
    """

    instance_id: int | None


@dataclass(frozen=True, slots=True)
class LongRow(_Row):
    """A row of the long table: one person. ``instance_id`` is label id × 1000 + n; 0: a scene without persons."""

    instance_id: int

    def position(self, sort: str) -> tuple[Cell, ...]:
        """Return the row's position in the order of `page`: its value in a column of `COLUMNS`, then its key."""
        frame = self.frame
        place = (frame.variant, frame.camera, frame.time, self.sensor_index, self.function_index, self.instance_id)
        return (place[KEY.index(sort)] if sort in KEY else self.measures[sort], *place)


def _select(run_id: str, *, filters: Sequence[Filter] = (), lost: bool = False) -> Select[Any]:
    """Return the SELECT of `COLUMNS` and the assignment, for the evaluated or the lost rows of a run."""
    if lost:
        person = and_(PersonView.truth == Frame.truth, Evaluation.distorted.is_(False))
    else:
        person = PersonView.truth == case((Evaluation.distorted, Evaluation.scores), else_=Frame.truth)
    query = (
        select(*COLUMNS.values(), Variant.assignment)
        .select_from(Evaluation)
        .join(Frame, same_frame(Evaluation))
        .join(Variant, VARIANT_OF_FRAME)
        .join(Score, Score.digest == Evaluation.scores, isouter=lost)
        .join(PersonView, person, isouter=lost)
        .outerjoin(Picture, Picture.prediction == Evaluation.prediction)
        .outerjoin(FrameAnnotation, LIGHT_OF_FRAME)
        .outerjoin(PersonLight, LIGHT_OF_PERSON)
        .outerjoin(
            PersonScore,
            and_(PersonScore.digest == Evaluation.scores, PersonScore.instance_id == PersonView.instance_id),
        )
        .where(Evaluation.run_id == run_id)
    )
    if lost:
        query = query.where(Score.digest.is_(None))
    for condition in filters:
        query = query.where(_condition(condition))
    return query


def rows(connection: Connection, run_id: str, *, filters: Sequence[Filter] = ()) -> Iterator[LongRow]:
    """Read the long table as a stream, in the order of the variants.

    Raises:
        UnknownName: a filter names no column or comparison.
    """
    query = _select(run_id, filters=filters).order_by(*(COLUMNS[name] for name in KEY))
    yield from _read(LongRow, connection.execution_options(yield_per=5_000), run_id, query)


class Piece(NamedTuple):
    """Consecutive rows of the long table, as columns."""

    variants: tuple[int, ...]
    cameras: tuple[int, ...]
    times: tuple[int, ...]
    sensors: tuple[int, ...]
    functions: tuple[int, ...]
    instances: tuple[int, ...]
    measures: dict[str, tuple[Cell, ...]]


def pieces(connection: Connection, run_id: str) -> Iterator[Piece]:
    """Read the long table in pieces, in the order of the variants."""
    query = _select(run_id).with_only_columns(*COLUMNS.values(), maintain_column_froms=True)
    query = query.order_by(*(COLUMNS[name] for name in KEY))
    for partition in connection.execution_options(yield_per=_PIECE).execute(query).partitions():
        variants, cameras, times, sensors, functions, instances, *values = zip(*partition, strict=True)
        measures = dict(zip(_MEASURES, values, strict=True))
        yield Piece(variants, cameras, times, sensors, functions, instances, measures)


def _read(form: Callable[..., R], connection: Connection, run_id: str, query: Select[Any]) -> Iterator[R]:
    for variant, camera, time, sensor, function, instance, *values, assignment in connection.execute(query):
        measures = dict(zip(_MEASURES, values, strict=True))
        yield form(FrameKey(run_id, variant, camera, time), sensor, function, measures, assignment, instance)


def lost_rows(connection: Connection, run_id: str) -> Iterator[LostRow]:
    """Read the rows of evaluations without scores, in the order of the variants.

    There is one row per person if the truth is stored, else one row without values of a person.
    """
    query = _select(run_id, lost=True).order_by(*(COLUMNS[name] for name in KEY))
    yield from _read(LostRow, connection.execution_options(yield_per=5_000), run_id, query)


def page(
    connection: Connection,
    run_id: str,
    *,
    filters: Sequence[Filter],
    sort: str,
    descending: bool,
    limit: int,
    after: Sequence[Cell] | None = None,
) -> list[LongRow]:
    """Read rows of the long table, sorted by a column, then by the key; rows without a value come last.

    Args:
        connection: to read with.
        run_id: of an existing run.
        filters: conditions that all must hold.
        sort: a column of `COLUMNS`.
        descending: reverses the order of the column, not of the key.
        limit: largest number of rows.
        after: `LongRow.position` of the last row read; rows that a run adds meanwhile do not shift the pages.

    Raises:
        UnknownName: ``sort`` or a filter names no column.
    """
    if sort not in COLUMNS:
        raise UnknownName("column", sort, COLUMNS, field="sort")
    column = COLUMNS[sort]
    key = tuple_(*(COLUMNS[name] for name in KEY))
    query = _select(run_id, filters=filters)
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
    return list(_read(LongRow, connection, run_id, query.order_by(*order).limit(limit)))


def count(connection: Connection, run_id: str, *, filters: Sequence[Filter]) -> int:
    """Return the number of rows of the long table.

    Raises:
        UnknownName: a filter names no column.
    """
    query = _select(run_id, filters=filters).with_only_columns(func.count(), maintain_column_froms=True)
    return int(connection.scalar(query) or 0)


@dataclass(frozen=True, slots=True)
class Point:
    """A row of the long table for a scatter plot; ``x`` is None if no column was requested."""

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
        column: numeric column of `COLUMNS`; None: no ``x``.
        share: below 1, the share of the variants in an even sample, by Knuth's multiplicative hash of their index.

    Raises:
        UnknownName: no such column.
    """
    if column is not None and column not in COLUMNS:
        raise UnknownName("column", column, COLUMNS, field="column")
    selection = [COLUMNS[name] for name in (*KEY, "pacc", "undefined_reason", *(() if column is None else (column,)))]
    query = _select(run_id).with_only_columns(*selection, maintain_column_froms=True)
    if share < 1.0:
        spread = Evaluation.variant_index * literal(2_654_435_761, BigInteger) % literal(2**32, BigInteger)
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


def _literal(value: Cell) -> Any:
    # With the column's own type, Postgres would round 2.5 to an integer, or refuse 1e300 as one.
    return literal(value, String if isinstance(value, str) else Double)
