"""Mean pACC at every level of every varied factor, and over the pair of factors that explains most of its variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.levels import Factor, factor_of, factors_of
from valerie.analysis.rows.table import EvaluationTable

#: Name, levels, and the position of every row's level among them.
Axis = tuple[str, Sequence[str], NDArray[np.int64]]


@dataclass(frozen=True, slots=True)
class Cell:
    """The persons at one level of each of two factors.

    Attributes:
        n: number of persons with a defined pACC; a person counts once in each frame.
        mean: their mean pACC; None without persons.
    """

    n: int
    mean: float | None


@dataclass(frozen=True, slots=True)
class Means:
    """Mean pACC over the levels of two factors.

    Attributes:
        down, across: names of the factors.
        columns: levels of ``across``.
        rows: each level of ``down`` with one cell per column; levels without any person are left out.
    """

    down: str
    across: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]


def level_means(table: EvaluationTable) -> tuple[Means, ...]:
    """Return mean pACC over the levels of each varied factor, by function."""
    functions, everything = factor_of(table, "function"), np.ones(len(table), np.bool_)
    return tuple(_means(table, factor, functions, everything) for factor in factors_of(table))


def strongest_pair(table: EvaluationTable) -> dict[str, Means]:
    """Return mean pACC over the two factors that together explain most of its variance, by function.

    The pair has the largest share of the variance between its cells, adjusted for their number (adjusted R²; Fisher 1924,
    *Philosophical Transactions A* 213, 89–142) and averaged over the functions. Empty if fewer than two factors vary.
    """
    functions, pacc = table.codes("function"), table.numbers("pacc")
    of_functions = [functions.where(name) & np.isfinite(pacc) for name in functions.names]

    def explained(pair: tuple[Factor, Factor]) -> float:
        cell = pair[0].codes * len(pair[1].levels) + pair[1].codes
        return float(np.mean([_adjusted_r2(pacc[rows], cell[rows]) for rows in of_functions]))

    pairs = list(combinations(factors_of(table), 2))
    if not pairs or not len(table):
        return {}
    across, down = max(pairs, key=explained)
    return {name: _means(table, down, across, functions.where(name)) for name in functions.names}


def _means(table: EvaluationTable, down: Factor, across: Factor, chosen: NDArray[np.bool_]) -> Means:
    pacc = table.numbers("pacc")
    rows = chosen & np.isfinite(pacc)
    return means_of_cells(pacc, rows, (down.name, down.levels, down.codes), (across.name, across.levels, across.codes))


def means_of_cells(pacc: NDArray[np.float64], rows: NDArray[np.bool_], down: Axis, across: Axis) -> Means:
    """Return the means over the levels of two axes.

    Args:
        pacc: (N,) of the whole table.
        rows: (N,) bool, the rows to use; their pACC is defined.
        down, across: name, levels, and (N,) position of each row's level among them.
    """
    down_name, down_levels, down_codes = down
    across_name, across_levels, across_codes = across
    shape = len(down_levels), len(across_levels)
    cell = down_codes[rows] * shape[1] + across_codes[rows]
    n = np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape)
    total = np.bincount(cell, pacc[rows], shape[0] * shape[1]).reshape(shape)
    cells = [
        (
            level,
            tuple(Cell(k, s / k if k else None) for k, s in zip(n[i].tolist(), total[i].tolist(), strict=True)),
        )
        for i, level in enumerate(down_levels)
        if n[i].any()
    ]
    return Means(down_name, across_name, tuple(across_levels), tuple(cells))


def _adjusted_r2(values: NDArray[np.float64], cell: NDArray[np.int64]) -> float:
    """Return the share of the variance between cells; 0 if the values are too few."""
    if not len(values) or np.ptp(values) == 0:
        return 0.0
    n = np.bincount(cell)
    within = float((values**2).sum() - (np.bincount(cell, values)[n > 0] ** 2 / n[n > 0]).sum())
    free = len(values) - np.count_nonzero(n)
    return 1 - within / free / float(values.var(ddof=1)) if free > 0 else 0.0
