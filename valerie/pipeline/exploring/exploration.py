"""Filter, count, sort and match the rows of one or several runs in memory, for interactive use.

DuckDB computes filters, orders and matches, in a connection that sees only these rows: no file, network or other database.
Conditions come from the grammar of `valerie.runs.resolving.where` with their values bound. Counts per bin are sums over the
rows that a filter selects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from threading import Lock, RLock, Timer
from typing import Final, TypeVar

import duckdb
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from cachetools import LRUCache
from numpy.typing import NDArray

from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput, UnknownName
from valerie.measures import BY_NAME, MEASURES, OF_FUNCTION, Cell, ColumnType, Source, names_from
from valerie.parameters.constraints import Sql, compile_constraint
from valerie.parameters.definitions import ParameterType
from valerie.parameters.paths import short_name
from valerie.pipeline.exploring.bins import Bins, Grid, column_bins, column_grid
from valerie.runs.resolving.where import Column

#: Most rows of an exploration.
MAX_ROWS: Final = 5_000_000
#: Time limit of a query, seconds.
MAX_SECONDS: Final = 20.0
_MEMORY: Final = "1GB"
_THREADS: Final = 2
#: Number of cached selections, one byte per row each.
_KEPT: Final = 12
#: Number of cached orders of rows, eight bytes per row each.
_KEPT_ORDERS: Final = 4
#: Rows of an order that are looked through at once.
_LOOKED_AT: Final = 16_384
#: Column of row numbers; expressions cannot name it.
ROW: Final = "row number"
K = TypeVar("K")
V = TypeVar("V")
_SCORES: Final = frozenset(names_from(*OF_FUNCTION)) - {"function"}


@dataclass(frozen=True, slots=True)
class ExploredColumn:
    """A column to explore.

    Attributes:
        name: name of the column, or path of a varied parameter.
        title, description: texts to display.
        unit: unit of displayed numbers, which are multiplied by ``scale``.
        digits: decimals of a displayed number; None: as many as it has.
        group: ``row``, ``person``, ``conditions``, ``score`` or ``varied``.
        numeric: True if it contains numbers rather than names.
        low, high: range of its numbers; None without any.
        names: names that occur, sorted.
        undefined: number of rows without a value.
    """

    name: str
    title: str
    description: str
    unit: str
    scale: float
    digits: int | None
    group: str
    numeric: bool
    low: float | None
    high: float | None
    names: tuple[str, ...]
    undefined: int


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The rows that an expression selects.

    Attributes:
        where: the expression; empty: all rows.
        rows: (N,) bool.
        numbers: (count,) their numbers, ascending.
        sql: the expression in SQL.
        scored: True if it depends on a function's scores.
    """

    where: str
    rows: NDArray[np.bool_]
    numbers: NDArray[np.intp]
    sql: Sql
    scored: bool

    @property
    def count(self) -> int:
        """Number of selected rows."""
        return len(self.numbers)


class Exploration:
    """Rows to explore; immutable and thread-safe.

    Args:
        table: the rows.
        units: unit of each varied parameter, by path.
        read_at: time of reading.
    """

    def __init__(
        self, table: EvaluationTable, *, units: Mapping[str, str] | None = None, read_at: datetime | None = None
    ) -> None:
        if len(table) > MAX_ROWS:
            raise InvalidInput("too many rows to explore at once", field="run", value=len(table), limit=MAX_ROWS)
        self.table, self.read_at, self._units = table, read_at, dict(units or {})
        limits: dict[str, str | bool | int | float | list[str]] = {
            "threads": _THREADS,
            "memory_limit": _MEMORY,
            "temp_directory": "",
        }
        self._connection = duckdb.connect(":memory:", config=limits)
        # A quotient by zero is NULL, as in `valerie.parameters.constraints`.
        for setting in ("ieee_floating_point_ops", "error_on_division_by_zero", "enable_external_access"):
            self._connection.execute(f"SET {setting} = false")
        self._numbered = table.arrow.append_column(ROW, pa.array(np.arange(len(table), dtype=np.int32)))
        self._connection.register("rows", self._numbered)
        self._connection.execute("SET lock_configuration = true")
        self._lock, self._caching = Lock(), RLock()
        self._selections: LRUCache[str, Selection] = LRUCache(_KEPT)
        self._bins: dict[tuple[str, int], Bins] = {}
        self._orders: LRUCache[tuple[str, bool], NDArray[np.intp]] = LRUCache(_KEPT_ORDERS)
        self._grids: LRUCache[tuple[str, int], Grid] = LRUCache(_KEPT)

    def __len__(self) -> int:
        return len(self.table)

    @cached_property
    def columns(self) -> tuple[ExploredColumn, ...]:
        """All columns except the ids of frames and columns without a value."""
        groups = {
            Source.FRAME: "row", Source.PLACE: "person", Source.PIXELS: "person", Source.LIGHT: "person",
            Source.CONDITIONS: "conditions", Source.PICTURE: "conditions", Source.FUNCTION: "row",
        }  # fmt: skip
        described = [
            self._described(m.name, m.title, m.description, m.unit, m.scale, m.digits, groups.get(m.source, "score"))
            for m in MEASURES
            if m.type is not ColumnType.TEXT
        ]
        described += [
            self._described(path, short_name(path), f"the varied parameter {path}", self._units.get(path, ""),
                            1.0, None, "varied")
            for path in self.table.parameters
        ]  # fmt: skip
        return tuple(column for column in described if column.undefined < len(self) or not len(self))

    def select(self, where: str = "", *, field: str = "where") -> Selection:
        """Return the rows that an expression selects; all of them if it is empty. ``field`` names it in errors.

        Raises:
            InvalidInput: it violates the grammar, compares different types or takes too long.
            UnknownName: it names an unknown column, or an unknown name of one.
        """
        return self._once(self._selections, where, lambda: self._selected(where, field))

    def _selected(self, where: str, field: str) -> Selection:
        sql, scored, rows = Sql("TRUE"), False, np.ones(len(self), np.bool_)
        if where.strip():
            constraint = compile_constraint(where, self._operands, field=field, word="column")
            sql, scored = constraint.sql, not constraint.paths.isdisjoint(_SCORES)
            answer = self.query(Sql(f"SELECT coalesce({sql.text}, false) AS selected FROM rows", sql.values))
            rows = answer["selected"].to_numpy()
        return Selection(where, rows, np.flatnonzero(rows), sql, scored)

    def bins(self, column: str, count: int) -> Bins:
        """Return the bins of a column; errors as in `column_bins`."""
        return self._once(self._bins, (column, count), lambda: column_bins(self.table, column, count))

    def grid(self, column: str, count: int) -> Grid:
        """Return the cells of a column of numbers along an axis of a density."""
        return self._once(self._grids, (column, count), lambda: column_grid(self.table.numbers(column), count))

    def page(self, selection: Selection, *, sort: str = "", limit: int, offset: int = 0) -> pa.Table:
        """Return selected rows sorted by a column, undefined values last, ties in the order of the runs.

        Args:
            selection: the rows.
            sort: a column; a leading minus sorts in descending order; empty: the order of the runs.
            limit, offset: numbers of rows to return and to skip.

        Raises:
            UnknownName: no such column.
        """
        numbers = selection.numbers
        if name := sort.removeprefix("-"):
            self.require(name, field="sort")
            order = self._order(name, descending=sort.startswith("-"))
            numbers = _first_selected(order, selection.rows, offset + limit)
        # `take` joins the chunks of whole columns first.
        rows = [self._numbered.slice(number, 1) for number in numbers[offset : offset + limit].tolist()]
        return pa.concat_tables(rows).combine_chunks() if rows else self._numbered.slice(0, 0)

    def _order(self, column: str, *, descending: bool) -> NDArray[np.intp]:
        """Return the numbers of all rows in the order of a column, undefined values last."""

        def order() -> NDArray[np.intp]:
            values = self._sortable(column)
            return np.argsort(-values if descending else values, kind="stable")

        return self._once(self._orders, (column, descending), order)

    def _once(self, kept: MutableMapping[K, V], key: K, make: Callable[[], V]) -> V:
        """Return what is kept, or make it. The views of a page ask for the same at once; one of them computes it."""
        with self._caching:
            if key not in kept:
                kept[key] = make()
            return kept[key]

    def _sortable(self, column: str) -> NDArray[np.float64]:
        if self.table.is_number(column):
            return self.table.numbers(column)
        index = self.table.codes(column).index
        return np.where(index < 0, np.nan, index)

    def rows(self, selection: Selection) -> pa.Table:
        """Return all selected rows with the columns of the long table."""
        return self.table.arrow.filter(pa.array(selection.rows))

    def at(self, numbers: Sequence[int]) -> list[dict[str, Cell]]:
        """Return rows by number, in the given order, as mappings."""
        rows: list[dict[str, Cell]] = self.table.arrow.take(pa.array(numbers, pa.int64())).to_pylist()
        return rows

    def query(self, sql: Sql) -> pa.Table:
        """Run a query over the table ``rows``.

        Raises:
            InvalidInput: it takes too long or too much memory, or a number overflows.
        """
        with self._lock:
            timer = Timer(MAX_SECONDS, self._connection.interrupt)
            timer.start()
            try:
                return self._connection.sql(sql.text, params=list(sql.values)).to_arrow_table()
            except duckdb.InterruptException:
                raise InvalidInput("the query takes too long", field="where", limit=f"{MAX_SECONDS:g} s") from None
            except duckdb.OutOfMemoryException:
                raise InvalidInput("the query takes too much memory", field="where", limit=_MEMORY) from None
            except (duckdb.OutOfRangeException, duckdb.ConversionException) as error:
                raise InvalidInput(f"the query fails: {error}", field="where") from None
            finally:
                timer.cancel()

    def require(self, column: str, *, field: str) -> None:
        """Check that a column exists.

        Raises:
            UnknownName: it does not.
        """
        if column not in self.table.arrow.column_names:
            raise UnknownName("column", column, self.table.arrow.column_names, field=field)

    @cached_property
    def _operands(self) -> dict[str, Column]:
        operands = {}
        for name in self.table.arrow.column_names:
            kind = self.table.arrow[name].type
            choices: tuple[str, ...] = ()
            if pa.types.is_boolean(kind):
                of = ParameterType.BOOL
            elif self.table.is_number(name):
                of = ParameterType.FLOAT
            else:
                of = ParameterType.CATEGORICAL
                choices = () if pa.types.is_string(kind) else self.table.codes(name).names
            share = name in BY_NAME and BY_NAME[name].unit == "%"
            operands[name] = operands[short_name(name)] = Column(name, of, choices, share=share)
        return operands

    def _described(
        self, name: str, title: str, description: str, unit: str, scale: float, digits: int | None, group: str
    ) -> ExploredColumn:
        column = self.table.arrow[name]
        numeric = self.table.is_number(name)
        ends: dict[str, float | None] = pc.min_max(column).as_py() if numeric else {"min": None, "max": None}
        names = () if numeric else self.table.codes(name).names
        return ExploredColumn(
            name, title, description, unit, scale, digits, group, numeric, ends["min"], ends["max"], names,
            column.null_count,
        )  # fmt: skip


def _first_selected(order: NDArray[np.intp], selected: NDArray[np.bool_], wanted: int) -> NDArray[np.intp]:
    """Return the first selected rows of an order, at least ``wanted`` if there are so many."""
    found: list[NDArray[np.intp]] = []
    for start in range(0, len(order), _LOOKED_AT):
        part = order[start : start + _LOOKED_AT]
        found.append(part[selected[part]])
        wanted -= len(found[-1])
        if wanted <= 0:
            break
    return np.concatenate(found) if found else order
