"""Distributions of a run's persons over a measure, and mean pACC over two binned measures."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.findings.effects import Means, means_of_cells
from valerie.analysis.rows.binning import bin_edges
from valerie.analysis.rows.frame_counts import ALL, UNNAMED, Group, characters, present, rows_of, settings
from valerie.analysis.rows.table import EvaluationTable, combine
from valerie.measures import Measure, measure_of

#: Orders of the quantiles in a distribution.
QUANTILES = (0.1, 0.5, 0.9)


@dataclass(frozen=True, slots=True)
class Distribution:
    """Persons over one measure; a person counts once in each frame, regardless of the number of functions.

    Attributes:
        column: the measure.
        character: their character; `ALL` for all together.
        persons: number with a value.
        low, high: smallest and largest value.
        quantiles: at `QUANTILES`.
        bins: (low, high, number of persons), empty ones included; every character has the same edges.
    """

    column: str
    character: str
    persons: int
    low: float
    high: float
    quantiles: tuple[float, ...]
    bins: tuple[tuple[float, float, int], ...]


def distributions(table: EvaluationTable, axis: Measure) -> tuple[Distribution, ...]:
    """Return the distribution of each character, then of all together; empty if the measure has no bins or no values."""
    values = table.numbers(axis.name)
    known = _once(table) & np.isfinite(values)
    if axis.bin_width is None or not known.any():
        return ()
    edges = bin_edges(float(values[known].min()), float(values[known].max()), axis.bin_width)
    names = characters(table)
    results = []
    for name in (*names, ALL) if len(names) > 1 else names:
        own = values[known & _of_character(table, name)]
        if len(own):
            n = np.histogram(own, edges)[0].tolist()
            bins = tuple((low, high, n[k]) for k, (low, high) in enumerate(pairwise(edges.tolist())))
            quantiles = tuple(np.quantile(own, QUANTILES).tolist())
            results.append(Distribution(axis.name, name, len(own), float(own.min()), float(own.max()), quantiles, bins))
    return tuple(results)


def binned_means(table: EvaluationTable, down: Measure, across: Measure, group: Group) -> Means | None:
    """Return mean pACC of a group over the bins of two measures (the paper's figure 5); None if either has fewer than 2."""
    pacc = table.numbers("pacc")
    rows = rows_of(table, group) & np.isfinite(pacc)
    axes = []
    for axis in (down, across):
        values = table.numbers(axis.name)
        everyone = np.isfinite(values) & np.isfinite(pacc)
        if axis.bin_width is None or not everyone.any():
            return None
        edges = bin_edges(float(values[everyone].min()), float(values[everyone].max()), axis.bin_width)
        if len(edges) < 3:
            return None
        rows = rows & np.isfinite(values)
        axes.append((edges, np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)))
    levels = [
        [f"{low * axis.scale:g}–{high * axis.scale:g}" for low, high in pairwise(edges.tolist())]
        for axis, (edges, _) in zip((down, across), axes, strict=True)
    ]
    titles = [f"{axis.title}, {axis.unit}" for axis in (down, across)]
    return means_of_cells(pacc, rows, (titles[0], levels[0], axes[0][1]), (titles[1], levels[1], axes[1][1]))


def means_by_occlusion(table: EvaluationTable) -> dict[tuple[str, str], list[tuple[str, Means]]]:
    """Return mean pACC over occlusion and pixel area by function and sensor: (character, means), all pedestrians first."""
    down, across = measure_of("occlusion_rate"), measure_of("pixel_area_percent")
    names = characters(table)
    return {
        (function, sensor): [
            (name, means)
            for name in ((ALL, *names) if len(names) > 1 else names)
            if (means := binned_means(table, down, across, Group(function, sensor, name))) is not None
        ]
        for function, sensor in settings(table)
    }


def _once(table: EvaluationTable) -> NDArray[np.bool_]:
    """Return (N,) bool: the first row of each present person in each frame."""
    instance = np.nan_to_num(table.numbers("instance_id"))
    key = combine([table.codes("frame_id").index, instance])
    first = np.zeros(len(table), np.bool_)
    first[np.unique(key, return_index=True)[1]] = True
    return first & present(table)


def _of_character(table: EvaluationTable, name: str) -> NDArray[np.bool_]:
    codes = table.codes("character")
    if name == ALL:
        return np.ones(len(table), np.bool_)
    return codes.index < 0 if name == UNNAMED else codes.where(name)
