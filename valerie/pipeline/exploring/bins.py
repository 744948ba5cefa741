"""Bins of a column, for histograms, densities and parallel coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, log10
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput
from valerie.measures import Cell

#: A column with at most this many distinct numbers has a bin for each of them.
MAX_LEVELS: Final = 24
#: Most names of a column with bins.
_MAX_NAMES: Final = 200
#: Bins fit into a byte, with one more for undefined rows.
MAX_BINS: Final = 254
_STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)
#: Rows sampled to detect a column with few distinct values.
_LOOKED_AT: Final = 20_000


@dataclass(frozen=True, eq=False)
class Bins:
    """The bins of a column.

    Attributes:
        codes: (N,) uint8 bin 0…count−1 of each row; ``count`` where the row has no value.
        levels: value of each bin if bins are single values; otherwise empty.
        edges: the count + 1 ends of the bins if bins are ranges; otherwise empty.
    """

    codes: NDArray[np.uint8]
    levels: tuple[Cell, ...] = ()
    edges: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Number of bins, without that of the undefined rows."""
        return len(self.levels) or len(self.edges) - 1

    @cached_property
    def every(self) -> list[int]:
        """Number of rows in each bin, undefined ones last."""
        return self.counts(slice(None))

    def counts(self, rows: NDArray[np.intp] | slice) -> list[int]:
        """Return how many of some rows are in each bin, undefined ones last."""
        counted: list[int] = np.bincount(self.codes[rows], minlength=self.count + 1).tolist()
        return counted


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Equal cells along an axis.

    Attributes:
        cells: (N,) int16 cell of each row; −1 where the row has no value.
        low: start of the first cell.
        width: of a cell.
    """

    cells: NDArray[np.int16]
    low: float
    width: float


def column_grid(values: NDArray[np.float64], count: int) -> Grid:
    """Divide the range of numbers into equal cells."""
    finite = np.isfinite(values)
    if not finite.any():
        return Grid(np.full(len(values), -1, np.int16), 0.0, 1.0)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    width = ((high - low) or 1.0) / count
    place = np.minimum(np.where(finite, (values - low) / width, -1), count - 1)
    return Grid(place.astype(np.int16), low, width)


def column_bins(table: EvaluationTable, column: str, count: int) -> Bins:
    """Divide a column into bins.

    Args:
        table: the rows.
        column: a column of the table.
        count: approximate number of bins for a column with many distinct numbers, at most `MAX_BINS`.

    Raises:
        UnknownName: no such column.
        InvalidInput: it contains too many names.
    """
    if table.is_number(column):
        return _of_numbers(table.numbers(column), count)
    codes = table.codes(column)
    if len(codes.names) > _MAX_NAMES:
        raise InvalidInput("the column has too many names for a view", field=column, limit=_MAX_NAMES)
    return Bins(np.where(codes.index < 0, len(codes.names), codes.index).astype(np.uint8), levels=codes.names)


def _of_numbers(values: NDArray[np.float64], count: int) -> Bins:
    levels = np.unique(values[:: max(1, len(values) // _LOOKED_AT)])
    levels = levels[np.isfinite(levels)]
    if 0 < len(levels) <= MAX_LEVELS:
        place = np.minimum(np.searchsorted(levels, values), len(levels) - 1)
        if ((levels[place] == values) | np.isnan(values)).all():
            codes = np.where(np.isnan(values), len(levels), place).astype(np.uint8)
            return Bins(codes, levels=tuple(levels.tolist()))
    if not len(levels):
        return Bins(np.full(len(values), 1, np.uint8), edges=(0.0, 1.0))
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    step = _round_step((high - low) / min(count, MAX_BINS - 2))
    first = floor(low / step + 1e-9)
    number = max(ceil(high / step - 1e-9) - first, 1)
    # Expressions round their numbers like these edges; a value on an edge belongs to the bin above it.
    edges = np.array([float(f"{(first + k) * step:.12g}") for k in range(number + 1)])
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, number - 1)
    return Bins(np.where(np.isnan(values), number, place).astype(np.uint8), edges=tuple(edges.tolist()))


def _round_step(least: float) -> float:
    power = 10.0 ** floor(log10(least))
    return next(float(f"{step * power:.12g}") for step in _STEPS if step * power >= least * (1 - 1e-9))
