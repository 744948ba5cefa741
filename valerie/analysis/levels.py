"""Groups of rows by the value of a varied parameter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.binning import bin_edges
from valerie.analysis.table import EvaluationTable

#: Numbers with more distinct values than this are put into about this many bins.
MAX_LEVELS: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """The rows in which a parameter has one value, or lies in [low, high).

    Attributes:
        rows: (N,) bool.
        name: the value of a CATEGORICAL or BOOL parameter; empty for numbers.
        low, high: the range, equal for a single number; None for a name.
        unit: ``°`` for an angle, else empty.
    """

    rows: NDArray[np.bool_]
    name: str = ""
    low: float | None = None
    high: float | None = None
    unit: str = ""


def levels_of(table: EvaluationTable, path: str) -> tuple[Level, ...]:
    """Return the levels of a varied parameter in ascending order.

    Empty levels are left out. A row without a value belongs to no level.
    """
    kind = table.parameters[path]
    if kind == "CATEGORICAL":
        codes = table.codes(path)
        return tuple(Level(codes.where(name), name) for name in codes.names)
    values = table.numbers(path)
    known = np.unique(values[np.isfinite(values)])
    if kind == "BOOL":
        return tuple(Level(values == value, "true" if value else "false") for value in known.tolist())
    unit = "°" if kind == "ANGLE" else ""
    if len(known) <= MAX_LEVELS:
        return tuple(Level(values == value, low=value, high=value, unit=unit) for value in known.tolist())
    edges = bin_edges(float(known[0]), float(known[-1]), _round_width(float(known[-1] - known[0]) / MAX_LEVELS))
    place = np.digitize(values, edges) - 1  # an empty value lies beyond the last edge
    levels = (
        Level(place == k, low=low, high=high, unit=unit) for k, (low, high) in enumerate(pairwise(edges.tolist()))
    )
    return tuple(level for level in levels if level.rows.any())


def _round_width(least: float) -> float:
    """Return the smallest of 1, 2 and 5 · 10ᵏ that is not below ``least``."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= least * (1 - 1e-9))
