"""Factors of a run as numbered levels, for contrasts and figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.binning import bin_edges
from valerie.analysis.rows.table import EvaluationTable
from valerie.parameters.paths import short_name

#: Numbers with more distinct values than this are put into about `_RANGES` ranges.
MAX_LEVELS: Final = 12
_RANGES: Final = 5
#: Angles with ends, which are no cycles.
_INCLINATIONS: Final = ("elevation", "pitch")
#: Columns, besides the varied parameters, over which a run repeats every variant.
REPEATED: Final = ("camera", "sensor", "instance_id")


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """A column as levels in ascending order.

    Attributes:
        column: path of a parameter, or name of a measure.
        levels: texts of the occurring levels: ``red``, ``300°``, ``5 to 10 m``; the last is ``default`` if rows have no value.
        codes: (N,) int64, index into ``levels``.
    """

    column: str
    levels: tuple[str, ...]
    codes: NDArray[np.int64]

    @property
    def name(self) -> str:
        """Short name: ``sun-1.azimuth``."""
        return "person" if self.column == "instance_id" else short_name(self.column)


def factors_of(table: EvaluationTable) -> tuple[Factor, ...]:
    """Return the factors that vary among rows with a pACC: parameters, then camera, sensor setting and person."""
    scored = np.isfinite(table.numbers("pacc"))
    factors = (factor_of(table, column) for column in (*table.parameters, *REPEATED))
    return tuple(factor for factor in factors if len(np.unique(factor.codes[scored])) > 1)


def factor_of(table: EvaluationTable, column: str) -> Factor:
    """Return the levels of a column.

    Each name is a level, as is each of up to `MAX_LEVELS` numbers; more numbers are grouped into round ranges.
    """
    kind = table.parameters.get(column, "CATEGORICAL")
    if kind == "CATEGORICAL":
        codes = table.codes(column)
        names = [_person(name) for name in codes.names] if column == "instance_id" else codes.names
        return _with_default(column, list(names), codes.index)
    values = table.numbers(column)
    known = np.unique(values[np.isfinite(values)])
    if kind == "BOOL":
        levels = ["true" if value else "false" for value in known]
        return _with_default(column, levels, _positions(values, known))
    unit = unit_after(column, kind)
    if len(known) <= MAX_LEVELS:
        levels = [f"{value:g}{unit}" for value in known.tolist()]
        return _with_default(column, levels, _positions(values, known))
    edges = bin_edges(float(known[0]), float(known[-1]), _round_width(float(known[-1] - known[0]) / _RANGES))
    place = np.where(np.isfinite(values), np.digitize(values, edges) - 1, -1)
    filled = np.unique(place[place >= 0])
    ranges = [f"{low:g} to {high:g}{unit}" for low, high in pairwise(edges.tolist())]
    return _with_default(column, [ranges[k] for k in filled], np.where(place >= 0, np.searchsorted(filled, place), -1))


def unit_after(column: str, kind: str) -> str:
    """Return the unit after a number of a parameter; the world is in metres and degrees."""
    if kind == "ANGLE" or column.rpartition(".")[2] in _INCLINATIONS:
        return "°"
    return " m" if ".pos." in column else ""


def _with_default(column: str, levels: list[str], codes: NDArray[np.int64]) -> Factor:
    """Return the factor; rows without a value have the asset's default, which is a level of its own."""
    empty = codes < 0
    if empty.any():
        levels = [*levels, "default"]
        codes = np.where(empty, len(levels) - 1, codes)
    return Factor(column, tuple(levels), codes)


def _positions(values: NDArray[np.float64], known: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.where(np.isfinite(values), np.searchsorted(known, values), -1).astype(np.int64)


def _person(instance: str) -> str:
    return f"person-{int(instance) % 1000}"


def _round_width(least: float) -> float:
    """Return the smallest of 1, 2 and 5 · 10ᵏ that is not below ``least``."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= least * (1 - 1e-9))
