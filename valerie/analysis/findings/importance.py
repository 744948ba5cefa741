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
class Explanation:
    """Columns that explain the pACC of one function.

    Attributes:
        function: its name.
        shares: shares of the variance, for the factors that the run set, largest first.
        measured: importance of measured columns, smallest p-value first; empty if there are too few places.
    """

    function: str
    shares: tuple[Share, ...]
    measured: tuple[Importance, ...]


def explanations(table: EvaluationTable, *, seed: int = 0) -> tuple[Explanation, ...]:
    """Explain the pACC of each function that has any; equal input gives equal numbers.

    Only measured columns with a value for every person are used.

    Args:
        table: the run's evaluations.
        seed: of folds and permutations.
    """
    pacc, functions = table.numbers("pacc"), table.codes("function")
    factors = {factor.name: factor.codes for factor in factors_of(table)}
    results = []
    for name in functions.names:
        rows = functions.where(name) & np.isfinite(pacc)
        if not rows.any():
            continue
        shares = variance_shares(observe(np.where(rows, pacc, np.nan), table.places, factors))
        columns = {column: table.numbers(column)[rows] for column in MEASURED}
        complete = {column: values for column, values in columns.items() if np.isfinite(values).all()}
        measured = measured_importance(pacc[rows], table.places[rows], complete, seed=seed)
        results.append(Explanation(name, shares, measured))
    return tuple(results)
