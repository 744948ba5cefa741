"""How pACC depends on distance, pixel area, occlusion, light and time: curves with bands, binned means (the paper's figures 4–7).

Numbers only; `valerie.analysis.plots` draws them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np

from valerie.analysis.binning import Bin, bin_edges, bins_of
from valerie.analysis.frame_counts import groups, rows_of
from valerie.analysis.intervals import Resampler
from valerie.analysis.regression import Curve, fit_curve
from valerie.analysis.table import EvaluationTable
from valerie.errors import UnknownName


@dataclass(frozen=True, slots=True)
class Axis:
    """A column that pACC is drawn over.

    Attributes:
        column: of the evaluation table.
        title: what people read, e.g. ``distance``.
        unit: shown behind numbers, after multiplying by ``scale``.
        scale: from the column's unit to the shown one (rates are shown in per cent).
        bin_width: in the column's unit; the paper's bins of five where it has one.
    """

    column: str
    title: str
    unit: str
    scale: float
    bin_width: float


AXES: Final = (
    Axis("distance_m", "distance", "m", 1.0, 5.0),
    Axis("occlusion_rate", "occlusion", "%", 100.0, 0.05),
    Axis("pixel_area_percent", "pixel area", "% of the image", 1.0, 0.05),
    Axis("irradiance", "light on the body", "of a clear noon sun", 1.0, 0.1),
    Axis("shadow_share", "body in shadow", "%", 100.0, 0.1),
    Axis("contrast", "contrast to the surroundings", "Michelson", 1.0, 0.1),
    Axis("time_s", "time", "s", 1.0, 0.5),
)


@dataclass(frozen=True, slots=True)
class Trend:
    """pACC over one column, for one group.

    Attributes:
        column: the x column; x values are in its unit.
        function, sensor, character: the group (`all` = characters combined).
        curve: the regression; None where there are too few situations or one x only.
        bins: binned means, empty bins left out; the same edges for every group.
    """

    column: str
    function: str
    sensor: str
    character: str
    curve: Curve | None
    bins: tuple[Bin, ...]


@dataclass(frozen=True, slots=True)
class Trends:
    """All trends of a run.

    Attributes:
        threshold: of the bins' detection counts.
        seed: of the cross-validation folds.
        items: per column, function, sensor and character.
    """

    threshold: float
    seed: int
    items: tuple[Trend, ...]

    def of(self, column: str, function: str, sensor: str) -> tuple[Trend, ...]:
        """The trends of one panel: each character, then all combined."""
        wanted = (column, function, sensor)
        return tuple(item for item in self.items if (item.column, item.function, item.sensor) == wanted)

    def to_json(self) -> dict[str, object]:
        """Plain dicts, lists, numbers and None."""
        return asdict(self)


def axis_of(column: str) -> Axis:
    """The axis of a column.

    Raises:
        UnknownName: no axis is defined over it.
    """
    for axis in AXES:
        if axis.column == column:
            return axis
    raise UnknownName("axis", column, [axis.column for axis in AXES])


def find_trends(
    table: EvaluationTable, *, resampler: Resampler, seed: int, threshold: float = 0.5, axes: Sequence[Axis] = AXES
) -> Trends:
    """Regress and bin pACC over each axis on which several values occur, per function, sensor and character and combined.

    Args:
        table: the run's evaluations.
        resampler: the run's bootstrap draws (made of ``table.situations``).
        seed: of the cross-validation folds.
        threshold: of the bins' detection counts.
        axes: columns to look at.
    """
    pacc = table.numbers("pacc")
    items = []
    for axis in axes:
        x = table.numbers(axis.column)
        known = x[np.isfinite(x) & np.isfinite(pacc)]
        if not len(known) or known.min() == known.max():
            continue
        edges = bin_edges(float(known.min()), float(known.max()), axis.bin_width)
        for group in groups(table):
            rows = rows_of(table, group)
            curve = fit_curve(x, pacc, rows, resampler=resampler, seed=seed)
            bins = bins_of(x, pacc, rows, edges=edges, threshold=threshold, resampler=resampler)
            items.append(Trend(axis.column, group.function, group.sensor, group.character, curve, bins))
    return Trends(threshold, seed, tuple(items))
