"""Which comparisons a run is asked for: neighbouring bins, values of what was varied, pedestrians, functions, false positives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations, pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.frame_counts import ALL, UNNAMED, Group, characters, frame_counts, rows_of, settings
from valerie.analysis.intervals import MIN_SITUATIONS, Resampler
from valerie.analysis.levels import levels_of
from valerie.analysis.table import EvaluationTable, combine
from valerie.analysis.trends import Trends
from valerie.measures import measure_of

#: Each side of a comparison needs this many person-frames (and `MIN_SITUATIONS` situations).
MIN_PERSONS: Final = 10
#: Precisions in which a function's labels differ from what it says in full.
_REDUCED: Final = frozenset({"bf16", "fp16"})
#: A function is named when more than this share of the pixels that it calls person belong to no person.
HEAVY: Final = 0.5


class FindingKind(StrEnum):
    BINS = "bins"
    VALUES = "values"
    CHARACTERS = "characters"
    FUNCTIONS = "functions"
    FALSE_POSITIVES = "false positives"


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """A number that is 0 where there is no effect, before it is judged.

    Attributes:
        kind: which comparison.
        function, other: who looked; ``other`` only where two functions are compared.
        sensor, column: behind which sensor setting, along which axis or varied parameter (or empty).
        estimate: the effect; positive where ``function``, the first character or the later bin has more.
        replicates: (B,) bootstrap replicates of it.
        situations: drawn units that it rests on (of two sides, the smaller number).
        n: what was counted on each side.
        say: (positive?, size, interval) → the sentence.
        upward_only: whether a negative effect is nothing to speak of.
    """

    kind: FindingKind
    function: str
    other: str
    sensor: str
    column: str
    estimate: float
    replicates: NDArray[np.float64]
    situations: int
    n: dict[str, int]
    say: Callable[[bool, str, str], str]
    upward_only: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Difference:
    estimate: float
    replicates: NDArray[np.float64]
    situations: int
    n: dict[str, int]
    counted: str
    paired: bool


def compare_all(
    table: EvaluationTable, trends: Trends, resampler: Resampler, precisions: Mapping[str, str]
) -> Iterator[Comparison]:
    """Every comparison that the table has enough persons and situations for.

    Functions of unequal ``precisions`` (by name, as `unpaired` says) are not held against each other.
    """
    if not len(table):
        return
    yield from _between_bins(table, trends, resampler)
    yield from _between_values(table, resampler)
    yield from _between_characters(table, resampler)
    yield from _between_functions(table, resampler, precisions)
    yield from _false_positives(table, resampler)


def _between_bins(table: EvaluationTable, trends: Trends, resampler: Resampler) -> Iterator[Comparison]:
    """Neighbouring bins of each axis, all characters together."""
    pacc = table.numbers("pacc")
    together = {ALL} if len(characters(table)) > 1 else set(characters(table))
    for trend in trends.items:
        if trend.character not in together:
            continue
        axis, x = measure_of(trend.column), table.numbers(trend.column)
        rows = rows_of(table, Group(trend.function, trend.sensor, ALL)) & np.isfinite(x) & np.isfinite(pacc)
        who = trend.function + _behind(table, trend.sensor)
        for a, b in pairwise(trend.bins):
            sides = [rows & (x >= side.low) & (x < side.high) for side in (a, b)]
            difference = _unpaired(pacc, sides[1], sides[0], resampler)
            if difference is None:
                continue
            steps = (
                f"from {axis.title} {axis.range_text(a.low, a.high)} ({100 * a.mean:.1f} %, n = {a.n:,}) to "
                f"{axis.range_text(b.low, b.high)} ({100 * b.mean:.1f} %, n = {b.n:,})"
            )

            def say(positive: bool, size: str, interval: str, who: str = who, steps: str = steps) -> str:
                return f"{who}: pACC {'rises' if positive else 'falls'} by {size} ({interval}) {steps}."

            yield Comparison(
                FindingKind.BINS,
                trend.function,
                "",
                trend.sensor,
                trend.column,
                difference.estimate,
                difference.replicates,
                difference.situations,
                {"from": a.n, "to": b.n},
                say,
            )


def _between_values(table: EvaluationTable, resampler: Resampler) -> Iterator[Comparison]:
    """Each value (or range) of each varied parameter against all the others; characters are compared apart."""
    pacc = table.numbers("pacc")
    for path in table.parameters:
        levels = () if path.rpartition(".")[2] == "character" else levels_of(table, path)
        if len(levels) < 2:
            continue
        name, anywhere = path.removeprefix("scene."), np.any([level.rows for level in levels], axis=0)
        # Of two values, the second against the first says it all.
        for level in levels[1:] if len(levels) == 2 else levels:
            rest = f"where it is {levels[0].text}" if len(levels) == 2 else "elsewhere"
            for function, sensor in settings(table):
                rows = rows_of(table, Group(function, sensor, ALL)) & anywhere
                difference = _unpaired(pacc, rows & level.rows, rows & ~level.rows, resampler)
                if difference is None:
                    continue
                ends = (function + _behind(table, sensor), f"where {name} is {level.text}", rest, difference.counted)

                def say(positive: bool, size: str, interval: str, ends: tuple[str, str, str, str] = ends) -> str:
                    who, where, rest, counted = ends
                    more = "higher" if positive else "lower"
                    return f"{who}: pACC is {more} by {size} {where} than {rest}, on average ({interval}; {counted})."

                yield Comparison(
                    FindingKind.VALUES,
                    function,
                    "",
                    sensor,
                    path,
                    difference.estimate,
                    difference.replicates,
                    difference.situations,
                    difference.n,
                    say,
                )


def _between_characters(table: EvaluationTable, resampler: Resampler) -> Iterator[Comparison]:
    """Two pedestrians in the same situation and camera; where the design repeats none, on average."""
    pacc = table.numbers("pacc")
    same = combine([table.situations, table.codes("camera").index, np.nan_to_num(table.numbers("instance_id"))])
    names = [name for name in characters(table) if name != UNNAMED]
    for function, sensor in settings(table):
        who = function + _behind(table, sensor)
        for a, b in combinations(names, 2):
            ours, theirs = (rows_of(table, Group(function, sensor, name)) for name in (a, b))
            difference = _paired(pacc, ours, theirs, same, resampler) or _unpaired(pacc, ours, theirs, resampler)
            if difference is None:
                continue
            where = "in the same situations" if difference.paired else "on average, in different situations"
            ends = (who, where, difference.counted, a, b)

            def say(positive: bool, size: str, interval: str, ends: tuple[str, str, str, str, str] = ends) -> str:
                who, where, counted, first, second = ends
                better, worse = (first, second) if positive else (second, first)
                return (
                    f"{who} sees {better} better than {worse} {where}: "
                    f"pACC is higher by {size} ({interval}; {counted})."
                )

            yield Comparison(
                FindingKind.CHARACTERS,
                function,
                "",
                sensor,
                "",
                difference.estimate,
                difference.replicates,
                difference.situations,
                difference.n,
                say,
            )


def unpaired(table: EvaluationTable, precisions: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Pairs of functions, sorted, whose difference would be one of precision too: bf16 and fp16 are like themselves alone.

    Args:
        table: that holds the functions.
        precisions: function to the precision that it ran in; a function that is missing ran in full.
    """

    def reduced(name: str) -> str:
        precision = precisions.get(name, "")
        return precision if precision in _REDUCED else ""

    pairs = combinations(sorted({function for function, _ in settings(table)}), 2)
    return tuple((a, b) for a, b in pairs if reduced(a) != reduced(b))


def _between_functions(
    table: EvaluationTable, resampler: Resampler, precisions: Mapping[str, str]
) -> Iterator[Comparison]:
    """Two functions on the same picture of the same person."""
    apart = unpaired(table, precisions)
    pacc = table.numbers("pacc")
    same = combine([table.codes("frame_id").index, np.nan_to_num(table.numbers("instance_id"))])
    pairs = settings(table)
    for sensor in sorted({sensor for _, sensor in pairs}):
        for a, b in combinations(sorted(function for function, s in pairs if s == sensor), 2):
            for name in () if (a, b) in apart else characters(table):
                ours, theirs = (rows_of(table, Group(function, sensor, name)) for function in (a, b))
                difference = _paired(pacc, ours, theirs, same, resampler)
                if difference is None:
                    continue
                ends = (name, _behind(table, sensor), difference.counted, a, b)

                def say(positive: bool, size: str, interval: str, ends: tuple[str, str, str, str, str] = ends) -> str:
                    name, behind, counted, first, second = ends
                    better, worse = (first, second) if positive else (second, first)
                    return (
                        f"{better} sees {name} better than {worse} does on the same pictures{behind}: "
                        f"pACC is higher by {size} ({interval}; {counted})."
                    )

                yield Comparison(
                    FindingKind.FUNCTIONS,
                    a,
                    b,
                    sensor,
                    "",
                    difference.estimate,
                    difference.replicates,
                    difference.situations,
                    difference.n,
                    say,
                )


def _false_positives(table: EvaluationTable, resampler: Resampler) -> Iterator[Comparison]:
    """Functions whose person pixels are mostly wrong."""
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
        ends = (function + _behind(table, sensor), f"{100 * share:.1f} %", f"n = {n:,} frames")

        def say(_positive: bool, size: str, interval: str, ends: tuple[str, str, str] = ends) -> str:
            who, part, counted = ends
            return (
                f"{who}: {part} of the pixels that it calls person belong to no person, "
                f"{size} more than half ({interval}; {counted})."
            )

        yield Comparison(
            FindingKind.FALSE_POSITIVES,
            function,
            "",
            sensor,
            "",
            share - HEAVY,
            replicates - HEAVY,
            situations,
            {"frames": n},
            say,
            upward_only=True,
        )


def _paired(
    values: NDArray[np.float64],
    a: NDArray[np.bool_],
    b: NDArray[np.bool_],
    same: NDArray[np.int64],
    resampler: Resampler,
) -> _Difference | None:
    """Mean of (value of a − value of b) over the keys ``same`` that both sides have; None where there are too few.

    Rows with the same key lie in the same drawn unit.
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
    estimate = float(total.sum() / pairs)
    return _Difference(estimate, replicates, situations, {"pairs": pairs}, f"n = {pairs:,} pairs", paired=True)


def _unpaired(
    values: NDArray[np.float64], a: NDArray[np.bool_], b: NDArray[np.bool_], resampler: Resampler
) -> _Difference | None:
    """Mean value of a − mean value of b; None where either side is too small."""
    sides = [side & np.isfinite(values) for side in (a, b)]
    n = [int(np.count_nonzero(side)) for side in sides]
    situations = min(resampler.occupied(side) for side in sides)
    if min(n) < MIN_PERSONS or situations < MIN_SITUATIONS:
        return None
    (mean_a, drawn_a), (mean_b, drawn_b) = (resampler.mean(values, side) for side in sides)
    counted = {"first": n[0], "second": n[1]}
    estimate, replicates = mean_a - mean_b, drawn_a - drawn_b
    return _Difference(estimate, replicates, situations, counted, f"n = {n[0]:,} and {n[1]:,}", paired=False)


def _behind(table: EvaluationTable, sensor: str) -> str:
    return f" behind sensor {sensor}" if len(table.codes("sensor").names) > 1 else ""
