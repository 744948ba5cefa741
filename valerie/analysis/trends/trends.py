"""Trends of pACC over distance, pixel area, occlusion, light and time: curves, polynomials and binned means.

They are the numbers of the paper's figures 4 to 7; `valerie.analysis.report.plots` draws them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from valerie.analysis.rows.binning import Bin, bin_edges, bins_of
from valerie.analysis.rows.frame_counts import groups, rows_of
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.trends.regression import Polynomial, fit_polynomial
from valerie.measures import MEASURES, Measure
from valerie.statistics.curves import Curve, fit_curve

#: Measures that the report plots pACC over.
AXES: Final = tuple(measure for measure in MEASURES if measure.bin_width is not None)


@dataclass(frozen=True, slots=True)
class Trend:
    """pACC over one column, for one group.

    Attributes:
        column: column of the x values, in its unit.
        function, sensor, character: the group; the character `ALL` stands for all together.
        curve: fitted curve with its band; None with too few places for two bins.
        polynomial: the paper's regression; None with too few places or a single x.
        bins: binned means without empty bins; every group has the same edges.
    """

    column: str
    function: str
    sensor: str
    character: str
    curve: Curve | None
    polynomial: Polynomial | None
    bins: tuple[Bin, ...]


@dataclass(frozen=True, slots=True)
class Trends:
    """All trends of a run.

    Attributes:
        threshold: of the bins' detection counts.
        seed: of folds and bands.
        items: one per column, function, sensor and character.
    """

    threshold: float
    seed: int
    items: tuple[Trend, ...]

    def of(self, column: str, function: str, sensor: str) -> tuple[Trend, ...]:
        """Return the trends of one panel: of each character, then of all together."""
        panel = (column, function, sensor)
        return tuple(item for item in self.items if (item.column, item.function, item.sensor) == panel)


def find_trends(table: EvaluationTable, *, seed: int, threshold: float = 0.5, axes: Sequence[Measure] = AXES) -> Trends:
    """Return the trends of each group over each axis on which several values occur.

    Args:
        table: the run's evaluations.
        seed: of folds and bands.
        threshold: of the bins' detection counts.
        axes: measures with a ``bin_width``.
    """
    pacc = table.numbers("pacc")
    items = []
    for axis in axes:
        x = table.numbers(axis.name)
        known = x[np.isfinite(x) & np.isfinite(pacc)]
        if not len(known) or known.min() == known.max():
            continue
        assert axis.bin_width is not None
        edges = bin_edges(float(known.min()), float(known.max()), axis.bin_width)
        for group in groups(table):
            rows = rows_of(table, group)
            own = x[rows], pacc[rows], table.places[rows]
            curve = fit_curve(*own, seed=seed, positions=table.positions_of(rows))
            polynomial = fit_polynomial(*own, seed=seed)
            bins = bins_of(x, pacc, rows, edges=edges, threshold=threshold)
            items.append(Trend(axis.name, group.function, group.sensor, group.character, curve, polynomial, bins))
    return Trends(threshold, seed, tuple(items))
