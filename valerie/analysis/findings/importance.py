"""Columns, set or measured, that explain the pACC of each function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from valerie.analysis.rows.levels import factors_of
from valerie.analysis.rows.table import EvaluationTable
from valerie.measures import MEASURES
from valerie.statistics.importance import Importance, Share, measured_importance, variance_shares
from valerie.statistics.observations import observe

#: Measured columns that are tested.
MEASURED: Final = tuple(measure.name for measure in MEASURES if measure.is_tested)


@dataclass(frozen=True, slots=True)
class BlockShares:
    """Shares of the variance among the rows of one block, for the factors that it varies.

    Factors of different blocks are not crossed: rows of two blocks also differ in what only one of them sets.

    Attributes:
        block: its number, from 1; None if all rows are of one block. Runs with equal blocks share them.
        shares: largest first.
    """

    block: int | None
    shares: tuple[Share, ...]


@dataclass(frozen=True, slots=True)
class Explanation:
    """Columns that explain the pACC of one function.

    Attributes:
        function: its name.
        blocks: shares of the variance, for the factors that each block set; of many blocks the largest.
        measured: importance of measured columns, smallest p-value first; empty if there are too few places.
    """

    function: str
    blocks: tuple[BlockShares, ...]
    measured: tuple[Importance, ...]


def explanations(table: EvaluationTable, *, seed: int = 0) -> tuple[Explanation, ...]:
    """Explain the pACC of each function that has any; equal input gives equal numbers.

    Only measured columns with a value for every person are used.

    Args:
        table: the run's evaluations.
        seed: of folds and permutations.
    """
    pacc, functions = table.numbers("pacc"), table.codes("function")
    blocks = table.by_block()
    results = []
    for name in functions.names:
        rows = functions.where(name) & np.isfinite(pacc)
        if not rows.any():
            continue
        shares = [
            BlockShares(number if len(blocks) > 1 else None, _shares(block, name)) for number, block in blocks.items()
        ]
        columns = {column: table.numbers(column)[rows] for column in MEASURED}
        complete = {column: values for column, values in columns.items() if np.isfinite(values).all()}
        measured = measured_importance(
            pacc[rows], table.places[rows], complete, seed=seed, positions=table.positions_of(rows)
        )
        results.append(Explanation(name, tuple(shares), measured))
    return tuple(results)


def _shares(table: EvaluationTable, function: str) -> tuple[Share, ...]:
    pacc = np.where(table.codes("function").where(function), table.numbers("pacc"), np.nan)
    return variance_shares(observe(pacc, table.places, {factor.name: factor.codes for factor in factors_of(table)}))
