"""Differences between groups of a run's evaluations, as numbers and names; `valerie.analysis.wording` words them.

Compared are neighbouring bins of an axis, values of a varied parameter, pedestrians, and functions. The share of false
person pixels of a function is compared with one half.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations, pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.frame_counts import ALL, UNNAMED, Group, characters, frame_counts, rows_of, settings
from valerie.analysis.intervals import MIN_SITUATIONS, Resampler
from valerie.analysis.levels import Level, levels_of
from valerie.analysis.table import EvaluationTable, combine
from valerie.analysis.trends import Trends

#: Fewest persons in frames on each side of a comparison; `MIN_SITUATIONS` holds for each side too.
MIN_PERSONS: Final = 10
#: Precisions in which the labels of a function differ from those in full precision.
_REDUCED: Final = frozenset({"bf16", "fp16"})
#: A function is named when more than this share of the pixels that it calls person belong to no person.
HEAVY: Final = 0.5


class FindingKind(StrEnum):
    BINS = "bins"
    VALUES = "values"
    CHARACTERS = "characters"
    FUNCTIONS = "functions"
    FALSE_POSITIVES = "false positives"


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a comparison; without name and range, all that is not on the other side.

    Attributes:
        name: of a function, a pedestrian or a value.
        low, high: range of the axis or parameter, equal for a single number.
        unit: of the range of a parameter.
        mean: mean pACC of a bin; share of false person pixels of a function.
        n: number of persons in the bin.
    """

    name: str = ""
    low: float | None = None
    high: float | None = None
    unit: str = ""
    mean: float = 0.0
    n: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """A number that is 0 where there is no effect.

    Attributes:
        estimate: the effect; positive where the first side has more.
        replicates: (B,) bootstrap replicates of it.
        situations: drawn units that it rests on; the smaller number of two sides.
        n: what was counted, by side.
        paired: whether the same situations (or pictures) are on both sides.
    """

    estimate: float
    replicates: NDArray[np.float64]
    situations: int
    n: dict[str, int]
    paired: bool


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """One comparison, before it is judged.

    Attributes:
        kind: what is compared.
        function: who looked; the first of two functions.
        sensor: behind which sensor setting.
        first, second: the sides; the difference is that of the first to the second.
        difference: of mean pACC; of the share of false person pixels to `HEAVY`.
        column: axis or path of the parameter along which bins or values differ, else empty.
        character: the pedestrian that two functions looked at, else `ALL`.
    """

    kind: FindingKind
    function: str
    sensor: str
    first: Side
    second: Side
    difference: Difference
    column: str = ""
    character: str = ALL


def compare_all(
    table: EvaluationTable, trends: Trends, resampler: Resampler, precisions: Mapping[str, str]
) -> Iterator[Comparison]:
    """Yield every comparison that the table has enough persons and situations for.

    Args:
        table: the run's evaluations.
        trends: its trends, whose bins are compared.
        resampler: the run's bootstrap draws.
        precisions: function to precision; `incomparable` functions are left out.
    """
    if len(table):
        yield from _between_bins(table, trends, resampler)
        yield from _between_values(table, resampler)
        yield from _between_characters(table, resampler)
        yield from _between_functions(table, resampler, precisions)
        yield from _false_positives(table, resampler)


def incomparable(table: EvaluationTable, precisions: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of functions, sorted, whose precisions differ so that a difference would partly be theirs.

    bf16 and fp16 are comparable with themselves only. All other precisions are comparable with one another.

    Args:
        table: that holds the functions.
        precisions: function to the precision that it ran in; a function that is missing ran in full precision.
    """

    def reduced(name: str) -> str:
        precision = precisions.get(name, "")
        return precision if precision in _REDUCED else ""

    pairs = combinations(sorted({function for function, _ in settings(table)}), 2)
    return tuple((a, b) for a, b in pairs if reduced(a) != reduced(b))


def _between_bins(table: EvaluationTable, trends: Trends, resampler: Resampler) -> Iterator[Comparison]:
    """Compare each bin of an axis with the one before it, over all pedestrians."""
    pacc = table.numbers("pacc")
    together = {ALL} if len(characters(table)) > 1 else set(characters(table))
    for trend in (trend for trend in trends.items if trend.character in together):
        x = table.numbers(trend.column)
        rows = rows_of(table, Group(trend.function, trend.sensor, ALL))
        for sides in pairwise(trend.bins):
            before, after = (rows & (x >= side.low) & (x < side.high) for side in sides)
            difference = _unpaired(pacc, after, before, resampler)
            if difference is not None:
                second, first = (Side(low=one.low, high=one.high, mean=one.mean, n=one.n) for one in sides)
                yield Comparison(
                    FindingKind.BINS, trend.function, trend.sensor, first, second, difference, column=trend.column
                )


def _between_values(table: EvaluationTable, resampler: Resampler) -> Iterator[Comparison]:
    """Compare each value (or range) of each varied parameter with all others; characters are compared apart."""
    pacc = table.numbers("pacc")
    for path in table.parameters:
        levels = () if path.rpartition(".")[2] == "character" else levels_of(table, path)
        if len(levels) < 2:
            continue
        anywhere = np.any([level.rows for level in levels], axis=0)
        # With two values, comparing the second with the first says it all.
        rest = _side(levels[0]) if len(levels) == 2 else Side()
        for level in levels[1:] if len(levels) == 2 else levels:
            for function, sensor in settings(table):
                rows = rows_of(table, Group(function, sensor, ALL)) & anywhere
                difference = _unpaired(pacc, rows & level.rows, rows & ~level.rows, resampler)
                if difference is not None:
                    yield Comparison(FindingKind.VALUES, function, sensor, _side(level), rest, difference, column=path)


def _side(level: Level) -> Side:
    return Side(level.name, level.low, level.high, level.unit)


def _between_characters(table: EvaluationTable, resampler: Resampler) -> Iterator[Comparison]:
    """Compare two pedestrians in the same situation and camera; on average, where the design repeats none."""
    pacc = table.numbers("pacc")
    same = combine([table.situations, table.codes("camera").index, np.nan_to_num(table.numbers("instance_id"))])
    names = [name for name in characters(table) if name != UNNAMED]
    for function, sensor in settings(table):
        for pair in combinations(names, 2):
            a, b = (rows_of(table, Group(function, sensor, name)) for name in pair)
            difference = _paired(pacc, a, b, same, resampler) or _unpaired(pacc, a, b, resampler)
            if difference is not None:
                first, second = map(Side, pair)
                yield Comparison(FindingKind.CHARACTERS, function, sensor, first, second, difference)


def _between_functions(
    table: EvaluationTable, resampler: Resampler, precisions: Mapping[str, str]
) -> Iterator[Comparison]:
    """Compare two functions on the same picture of the same person."""
    apart = incomparable(table, precisions)
    pacc = table.numbers("pacc")
    same = combine([table.codes("frame_id").index, np.nan_to_num(table.numbers("instance_id"))])
    pairs = settings(table)
    for sensor in sorted({sensor for _, sensor in pairs}):
        for pair in combinations(sorted(function for function, own in pairs if own == sensor), 2):
            for name in () if pair in apart else characters(table):
                a, b = (rows_of(table, Group(function, sensor, name)) for function in pair)
                difference = _paired(pacc, a, b, same, resampler)
                if difference is not None:
                    first, second = map(Side, pair)
                    yield Comparison(FindingKind.FUNCTIONS, pair[0], sensor, first, second, difference, character=name)


def _false_positives(table: EvaluationTable, resampler: Resampler) -> Iterator[Comparison]:
    """Compare the share of each function's person pixels that are wrong with `HEAVY`."""
    counts = frame_counts(table)
    called, wrong = np.zeros(len(table)), np.zeros(len(table))
    called[counts.row], wrong[counts.row] = counts.tp + counts.fp, counts.fp
    first = np.zeros(len(table), np.bool_)
    first[counts.row] = True
    for function, sensor in settings(table):
        rows = first & table.codes("function").where(function) & table.codes("sensor").where(sensor)
        n = int(np.count_nonzero(rows))
        situations = resampler.occupied(rows & (called > 0))
        if n < MIN_PERSONS or situations < MIN_SITUATIONS:
            continue
        share, replicates = resampler.ratio(wrong, called, rows)
        difference = Difference(share - HEAVY, replicates - HEAVY, situations, {"frames": n}, paired=False)
        yield Comparison(FindingKind.FALSE_POSITIVES, function, sensor, Side(function, mean=share), Side(), difference)


def _paired(
    values: NDArray[np.float64],
    a: NDArray[np.bool_],
    b: NDArray[np.bool_],
    same: NDArray[np.int64],
    resampler: Resampler,
) -> Difference | None:
    """Return the mean of (value of a − value of b) over the keys ``same`` that both sides have.

    Rows with the same key lie in the same drawn unit. None where there are too few pairs or situations.
    """
    count = int(same.max()) + 1
    unit = np.zeros(count, np.int64)
    unit[same] = resampler.group
    means = []
    for side in (a & np.isfinite(values), b & np.isfinite(values)):
        n = np.bincount(same[side], minlength=count)
        with np.errstate(invalid="ignore"):
            means.append(np.bincount(same[side], weights=values[side], minlength=count) / n)
    difference = means[0] - means[1]
    both = np.isfinite(difference)
    pairs = int(np.count_nonzero(both))
    situations = len(np.unique(unit[both]))
    if pairs < MIN_PERSONS or situations < MIN_SITUATIONS:
        return None
    total = np.bincount(unit[both], weights=difference[both], minlength=resampler.groups)
    number = np.bincount(unit[both], minlength=resampler.groups).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        replicates = (resampler.weights @ total) / (resampler.weights @ number)
    return Difference(float(total.sum() / pairs), replicates, situations, {"pairs": pairs}, paired=True)


def _unpaired(
    values: NDArray[np.float64], a: NDArray[np.bool_], b: NDArray[np.bool_], resampler: Resampler
) -> Difference | None:
    """Return mean value of a − mean value of b; None where a side has too few persons or situations."""
    sides = [side & np.isfinite(values) for side in (a, b)]
    n = [int(np.count_nonzero(side)) for side in sides]
    situations = min(resampler.occupied(side) for side in sides)
    if min(n) < MIN_PERSONS or situations < MIN_SITUATIONS:
        return None
    (mean_a, drawn_a), (mean_b, drawn_b) = (resampler.mean(values, side) for side in sides)
    return Difference(mean_a - mean_b, drawn_a - drawn_b, situations, {"first": n[0], "second": n[1]}, paired=False)
