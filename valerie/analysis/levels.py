"""The values of a varied parameter as a few groups of rows that can be compared."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.binning import bin_edges
from valerie.analysis.table import EvaluationTable

#: Numbers with more distinct values than this are put into about so many bins.
MAX_LEVELS: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """The rows where a parameter has one value, or lies in [low, high).

    Attributes:
        text: the value or the range, for people; without unit, but ° for an angle.
        rows: (N,) bool.
    """

    text: str
    rows: NDArray[np.bool_]


def levels_of(table: EvaluationTable, path: str) -> tuple[Level, ...]:
    """The levels of a varied parameter in ascending order; rows without a value are in none, empty levels are left out."""
    kind = table.parameters[path]
    if kind == "CATEGORICAL":
        codes = table.codes(path)
        return tuple(Level(name, codes.where(name)) for name in codes.names)
    values = table.numbers(path)
    known = np.unique(values[np.isfinite(values)])
    unit = "°" if kind == "ANGLE" else ""
    if len(known) <= MAX_LEVELS:
        texts = ["false", "true"] if kind == "BOOL" else None
        return tuple(Level(texts[int(v)] if texts else f"{v:g}{unit}", values == v) for v in known)
    edges = bin_edges(float(known[0]), float(known[-1]), _round_width(float(known[-1] - known[0]) / MAX_LEVELS))
    place = np.digitize(values, edges) - 1  # of an empty value: beyond the last
    found = [Level(f"{low:g}–{high:g}{unit}", place == k) for k, (low, high) in enumerate(pairwise(edges.tolist()))]
    return tuple(level for level in found if level.rows.any())


def _round_width(least: float) -> float:
    """The smallest of 1, 2 and 5 · 10ᵏ that is not below ``least``."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= least * (1 - 1e-9))
