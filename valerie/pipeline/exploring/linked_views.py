"""Content of the linked views: histograms, densities, points, links between axes, and rates with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.wording import refusal_text
from valerie.errors import InvalidInput
from valerie.measures import Cell
from valerie.pipeline.exploring.bins import Grid
from valerie.pipeline.exploring.exploration import Exploration, Selection
from valerie.statistics.intervals import Interval, Refusal, mean_interval

#: Approximate number of bins of a histogram and of an axis of parallel coordinates.
BINS: Final = 40
#: Cells of a density.
ACROSS: Final = 140
UP: Final = 80
#: Most points of a scatter plot; more become a density.
MAX_POINTS: Final = 20_000
#: Columns of the groups whose rates are compared with the rest.
_MAX_GROUPS: Final = 12


@dataclass(frozen=True, slots=True)
class Histogram:
    """Rows by bins of a column.

    Attributes:
        column: name of the column.
        levels: value of each bin if bins are single values.
        edges: ends of the bins if bins are ranges; one more than bins.
        every: number of rows in each bin, undefined ones last.
        selected: number of selected rows in each bin.
    """

    column: str
    levels: list[Cell]
    edges: list[float]
    every: list[int]
    selected: list[int]


def histogram(exploration: Exploration, column: str, selection: Selection) -> Histogram:
    """Count rows by a column.

    Raises:
        UnknownName: no such column.
        InvalidInput: it holds too many names.
    """
    exploration.require(column, field="column")
    bins = exploration.bins(column, BINS)
    selected = bins.every if selection.count == len(exploration) else bins.counts(selection.numbers)
    return Histogram(column, list(bins.levels), list(bins.edges), bins.every, selected)


@dataclass(frozen=True, slots=True)
class Links:
    """Numbers of rows between the bins of two neighbouring axes of parallel coordinates.

    Attributes:
        before, after: the columns.
        pairs: [bin of ``before``, bin of ``after``, rows]; the bin after the last one is that of undefined rows.
    """

    before: str
    after: str
    pairs: list[tuple[int, int, int]]


def links(exploration: Exploration, columns: Sequence[str], selection: Selection) -> list[Links]:
    """Count the rows between neighbouring axes; errors as in `histogram`."""
    for column in columns:
        exploration.require(column, field="column")
    bins = [exploration.bins(column, BINS) for column in columns]
    codes = [axis.codes.take(selection.numbers) for axis in bins]
    answer = []
    for k in range(len(columns) - 1):
        width = bins[k + 1].count + 1
        counts = np.bincount(codes[k].astype(np.int32) * width + codes[k + 1], minlength=1)
        occupied = np.flatnonzero(counts)
        pairs = zip((occupied // width).tolist(), (occupied % width).tolist(), counts[occupied].tolist(), strict=True)
        answer.append(Links(columns[k], columns[k + 1], list(pairs)))
    return answer


def scatter(
    exploration: Exploration, x: str, y: str, color: str, selection: Selection, *, form: Literal["auto", "cells"]
) -> pa.Table:
    """Return the selected rows over two columns, as points or, if there are many, as cells of a density.

    Args:
        exploration: the rows.
        x, y: numeric columns.
        color: any column; a cell shows the mean of its numbers or its most frequent name; empty: none.
        selection: the selected rows.
        form: ``cells`` forces cells.

    Returns:
        float32 columns ``x``, ``y`` and ``color`` (a name is its index in the sorted names; NaN: no value), and int32
        ``row`` (number of the row) of a point or ``count`` (rows) of a cell, whose x and y are its middle. Metadata:
        ``form``, ``points`` or ``cells``, with the ``width`` and ``height`` of a cell, and the number of selected rows
        that lack x or y.

    Raises:
        UnknownName: no such column.
        InvalidInput: x or y contains names.
    """
    for field, name in (("x", x), ("y", y)):
        exploration.require(name, field=field)
        if not exploration.table.is_number(name):
            raise InvalidInput("an axis needs numbers; this column holds names", field=field, value=name)
    shades = _shades(exploration, color)
    if selection.count <= MAX_POINTS and form == "auto":
        rows = selection.numbers
        a, b = (exploration.table.numbers(name).take(rows) for name in (x, y))
        shown = np.isfinite(a) & np.isfinite(b)
        points = {"x": a[shown], "y": b[shown]}
        if shades is not None:
            points["color"] = shades[rows[shown]]
        return _table(points, {"row": rows[shown]}, form="points", undefined=int((~shown).sum()))
    return _cells(
        exploration.grid(x, ACROSS), exploration.grid(y, UP), shades, selection, names=_named(exploration, color)
    )


def _cells(
    x: Grid,
    y: Grid,
    shades: NDArray[np.float64] | None,
    selection: Selection,
    *,
    names: int,
) -> pa.Table:
    column, row = x.cells.take(selection.numbers), y.cells.take(selection.numbers)
    shown = (column >= 0) & (row >= 0)
    cell = row[shown].astype(np.int32) * ACROSS + column[shown]
    counts = np.bincount(cell, minlength=ACROSS * UP)
    occupied = np.flatnonzero(counts)
    cells = {"x": x.low + (occupied % ACROSS + 0.5) * x.width, "y": y.low + (occupied // ACROSS + 0.5) * y.width}
    if shades is not None:
        shade = shades.take(selection.numbers[shown])
        known = np.isfinite(shade)
        if names:
            of = np.bincount(cell[known] * names + shade[known].astype(np.int32), minlength=ACROSS * UP * names)
            frequent = of.reshape(-1, names)[occupied]
            cells["color"] = np.where(frequent.any(axis=1), frequent.argmax(axis=1), np.nan)
        else:
            total = np.bincount(cell[known], shade[known], ACROSS * UP)[occupied]
            number = np.bincount(cell[known], minlength=ACROSS * UP)[occupied]
            cells["color"] = np.where(number > 0, total / np.maximum(number, 1), np.nan)
    undefined = selection.count - int(counts.sum())
    return _table(cells, {"count": counts[occupied]}, form="cells", width=x.width, height=y.width, undefined=undefined)


def _shades(exploration: Exploration, color: str) -> NDArray[np.float64] | None:
    if not color:
        return None
    exploration.require(color, field="color")
    if exploration.table.is_number(color):
        return exploration.table.numbers(color)
    bins = exploration.bins(color, BINS)
    return np.where(bins.codes == bins.count, np.nan, bins.codes)


def _named(exploration: Exploration, color: str) -> int:
    """Return the number of names of a column; 0 for numbers."""
    if not color or exploration.table.is_number(color):
        return 0
    return exploration.bins(color, BINS).count


def _table(
    numbers: Mapping[str, NDArray[np.floating]], counts: Mapping[str, NDArray[np.integer]], **metadata: object
) -> pa.Table:
    arrays = {name: pa.array(values.astype(np.float32)) for name, values in numbers.items()}
    arrays |= {name: pa.array(values.astype(np.int32)) for name, values in counts.items()}
    return pa.table(arrays).replace_schema_metadata({key: str(value) for key, value in metadata.items()})


@dataclass(frozen=True, slots=True)
class Rates:
    """Rates of a set of rows.

    Attributes:
        persons: number of rows with a pACC.
        undefined: reason to number of rows without.
        pacc: interval of the mean pACC, or the reason why there is none.
        detected: likewise of the share of persons with pACC ≥ the threshold.
        why: the reason why there is no interval, in words; empty if there is one.
    """

    persons: int
    undefined: dict[str, int]
    pacc: Interval | Refusal
    detected: Interval | Refusal
    why: str


@dataclass(frozen=True, slots=True)
class GroupRates:
    """Rates of the selected rows of a group, and of those to compare with.

    Attributes:
        run, function, sensor: names of the group.
        selected, beside: rates of both.
    """

    run: str
    function: str
    sensor: str
    selected: Rates
    beside: Rates


def rates(
    exploration: Exploration, selected: NDArray[np.bool_], beside: NDArray[np.bool_], threshold: float
) -> list[GroupRates]:
    """Return the rates of two sets of rows, by run, function and sensor; each run has the units of its own design.

    Args:
        exploration: the rows.
        selected, beside: (N,) bool; a row may be in both.
        threshold: t of the detection rate.
    """
    table = exploration.table
    names = [table.codes(name) for name in ("run_id", "function", "sensor")]
    answer = []
    key = (names[0].index * len(names[1].names) + names[1].index) * len(names[2].names) + names[2].index
    for group in np.unique(key)[:_MAX_GROUPS].tolist():
        of = key == group
        run, rest = divmod(group, len(names[1].names) * len(names[2].names))
        function, sensor = divmod(rest, len(names[2].names))
        answer.append(
            GroupRates(
                names[0].names[run],
                names[1].names[function],
                names[2].names[sensor],
                _rates(table, names[0].names[run], of & selected, threshold),
                _rates(table, names[0].names[run], of & beside, threshold),
            )
        )
    return answer


def _rates(table: EvaluationTable, run: str, rows: NDArray[np.bool_], threshold: float) -> Rates:
    pacc = table.numbers("pacc")
    known = rows & np.isfinite(pacc)
    reasons = table.codes("undefined_reason")
    lacking = np.bincount(reasons.index[rows & ~known] + 1, minlength=len(reasons.names) + 1)[1:]
    units = table.units_in_run(run, known)
    mean = mean_interval(pacc[known], units)
    return Rates(
        int(np.count_nonzero(known)),
        {name: int(n) for name, n in zip(reasons.names, lacking, strict=True) if n},
        mean,
        mean_interval(pacc[known] >= threshold, units),
        refusal_text(mean) if isinstance(mean, Refusal) else "",
    )
