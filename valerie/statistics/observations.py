"""Scores with the place and the factor levels of each row: the input of every comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput

#: Most levels of a factor; bin its values first where it has more (`bin_codes`).
MAX_LEVELS: Final = 32


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Rows with a value.

    Attributes:
        values: (N,) float64, finite.
        place: (N,) int64, 0…places − 1: the place of each row.
        places: number of places.
        factors: name to (N,) int64 codes 0…L − 1.
        levels: name to the (L,) codes that the caller gave, ascending.
        rows: (N,) int64, index of each row in the caller's arrays.
        undefined: rows of the caller that had no value and were left out.
        positions: (places, D) coordinates of the places, metres, where they are listed on one site, so that neighbours may be
            alike (`valerie.statistics.neighbours`); None where they are drawn.
    """

    values: NDArray[np.float64]
    place: NDArray[np.int64]
    places: int
    factors: Mapping[str, NDArray[np.int64]]
    levels: Mapping[str, NDArray[np.int64]]
    rows: NDArray[np.int64]
    undefined: int = 0
    positions: NDArray[np.float64] | None = None

    def of_places(self, chosen: NDArray[np.bool_]) -> Observations:
        """Return the rows of some places.

        Args:
            chosen: (places,) bool.
        """
        rows = np.flatnonzero(chosen[self.place])
        factors, levels = {}, {}
        for name, codes in self.factors.items():
            factors[name], occurring = dense(codes[rows])
            levels[name] = self.levels[name][occurring]
        place, occupied = dense(self.place[rows])
        positions = None if self.positions is None else self.positions[occupied]
        return Observations(
            self.values[rows], place, len(occupied), factors, levels, self.rows[rows], positions=positions
        )


def observe(
    values: ArrayLike,
    places: ArrayLike,
    factors: Mapping[str, ArrayLike],
    positions: NDArray[np.float64] | None = None,
) -> Observations:
    """Collect the rows that have a value.

    Args:
        values: (N,) scores; NaN where a row has none.
        places: (N,) whole numbers, the place (or other independent unit) of each row.
        factors: name to (N,) whole numbers, the level of each row.
        positions: (N, D) coordinates, equal within a place, as of `Observations`.

    Raises:
        InvalidInput: the lengths differ, or a factor has more than `MAX_LEVELS` levels.
    """
    scores = np.asarray(values, np.float64)
    columns = {"places": np.asarray(places), **{name: np.asarray(codes) for name, codes in factors.items()}}
    for name, column in columns.items():
        if column.shape != scores.shape:
            raise InvalidInput("needs one code per value", field=name, value=column.shape, limit=scores.shape)
        if column.dtype.kind not in "iub":
            raise InvalidInput("needs whole numbers", field=name, value=str(column.dtype))
    rows = np.flatnonzero(np.isfinite(scores))
    codes, levels = {}, {}
    for name in factors:
        codes[name], levels[name] = dense(columns[name][rows])
        if len(levels[name]) > MAX_LEVELS:
            raise InvalidInput("has too many levels", field=name, value=len(levels[name]), limit=MAX_LEVELS)
    place, occupied = dense(columns["places"][rows])
    where = None if positions is None else coordinates(positions[rows], place, len(occupied))
    return Observations(scores[rows], place, len(occupied), codes, levels, rows, len(scores) - len(rows), where)


def coordinates(positions: NDArray[np.float64], place: NDArray[np.int64], places: int) -> NDArray[np.float64]:
    """Return the (places, D) positions of the places of some rows; a coordinate that a block does not set is 0."""
    where = np.zeros((places, positions.shape[1]))
    where[place] = np.nan_to_num(positions)
    return where


def dense(codes: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number the codes that occur 0…L − 1, in ascending order.

    Returns:
        (N,) numbers and the (L,) codes.
    """
    if not len(codes):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    low, high = int(codes.min()), int(codes.max())
    if high - low > 4 * len(codes):
        levels, numbers = np.unique(codes, return_inverse=True)
        return numbers.astype(np.int64), levels.astype(np.int64)
    shifted = codes.astype(np.int64) - low
    present = np.bincount(shifted) > 0
    return (np.cumsum(present) - 1)[shifted], np.flatnonzero(present) + low


def bin_codes(x: ArrayLike, bins: int) -> NDArray[np.int64]:
    """Return the bin of each value, with about equally many values in each bin.

    Args:
        x: (N,) finite numbers.
        bins: at least 2.
    """
    numbers = np.asarray(x, np.float64)
    edges = np.unique(np.quantile(numbers, np.linspace(0, 1, bins + 1)[1:-1]))
    return np.searchsorted(edges, numbers, side="right").astype(np.int64)
