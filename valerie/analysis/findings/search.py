"""Search for a run's findings.

Contrasts (`valerie.statistics.contrasts`) of all varied factors are searched in one half of the places and confirmed in the
other. The contrasts of one function form a *family*, and so do the comparisons of functions on identical frames; the
families share the error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.findings.child_specs import child_spec
from valerie.analysis.findings.findings import Finding, Findings, Inequality, PictureFault, ScoredPerson, Step
from valerie.analysis.findings.wording import (
    alike_sentence,
    false_positives_sentence,
    finding_sentence,
    incomparable_sentence,
)
from valerie.analysis.rows.frame_counts import frame_counts, settings
from valerie.analysis.rows.levels import Factor, factor_of, factors_of
from valerie.analysis.rows.picture_faults import picture_faults
from valerie.analysis.rows.table import EvaluationTable
from valerie.runs.document.run_spec import RunSpec
from valerie.statistics.confirmation import Confirmation, find, named
from valerie.statistics.contrasts import Change, Contrast, Matching, contrasts, largest_flips
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.observations import Observations, observe

#: Joint confidence of all findings of a run.
LEVEL: Final = 0.95
#: A function is named when more than this share of the pixels that it calls person belong to no person.
HEAVY: Final = 0.5
#: Differences of measured quantities between two sides above which a finding mentions them: share of the person, metres.
UNEQUAL: Final[Mapping[str, float]] = {"occlusion_rate": 0.1, "distance_m": 2.0}
#: Candidates that need more than this many times the places of the run are not listed.
AFFORDABLE: Final = 10
#: Image pairs of a finding.
_PAIRS: Final = 3
#: Precisions in which the labels of a function differ from those at full precision.
_REDUCED: Final = frozenset({"bf16", "fp16", "int8"})


@dataclass(frozen=True, slots=True, eq=False)
class _Family:
    """Rows that are compared, and the changes to test; None: all, with their interactions."""

    function: str
    observations: Observations
    factors: Mapping[str, Factor]
    only: tuple[tuple[Change, ...], ...] | None = None


def find_findings(
    table: EvaluationTable,
    *,
    seed: int = 0,
    precisions: Mapping[str, str] | None = None,
    spec: RunSpec | None = None,
) -> Findings:
    """Compare the levels of everything that the run varied, for each function, and the functions with each other.

    Args:
        table: the run's evaluations.
        seed: of the choice of places to search.
        precisions: function to the precision that it ran in; see `incomparable`.
        spec: of the run; if present, each finding proposes a run that examines it.
    """
    families = list(_families(table, precisions or {}))
    clearest: dict[tuple[str, tuple[str | Change, ...]], tuple[bool, Finding]] = {}
    comparisons = searched = confirming = 0
    for family in families:
        level = 1 - (1 - LEVEL) / len(families)
        observations, only = family.observations, family.only
        result = find(observations, seed=seed, interactions=only is None, only=only, level=level)
        confirmed = [item for item in result.items if item.confirmed]
        others = [item for item in result.items if not item.confirmed]
        comparisons += result.comparisons
        searched, confirming = max(searched, result.places_searched), max(confirming, result.places_confirming)
        for item in (*confirmed, *named(observations, only=only, level=level), *others):
            if not (item.confirmed or _worth_a_run(item, observations.places)):
                continue
            # Only the clearest of several changes of the same factors is kept, but every pair of functions.
            steps = item.candidate.changes
            key = family.function, steps if family.only else tuple(change.factor for change in steps)
            if key not in clearest:
                seen = item.contrast is None and result.places_confirming > 0
                clearest[key] = item.adjusted_p <= 1 - level, _finding(table, family, item, spec, searched=seen)
    ordered = sorted(
        clearest.values(), key=lambda one: (not one[0], one[1].matching is Matching.MODEL, len(one[1].steps))
    )
    findings = [finding for _, finding in ordered]
    notes = [alike_sentence(function) for function in sorted({one.function for one in findings if one.alike})]
    notes += _false_positives(table)
    notes += [incomparable_sentence(a, b, precisions or {}) for a, b in incomparable(table, precisions or {})]
    return Findings(
        items=tuple(finding for finding in findings if finding.confirmed),
        candidates=tuple(finding for finding in findings if not finding.confirmed),
        comparisons=comparisons,
        level=LEVEL,
        places_searched=searched,
        places_confirming=confirming,
        notes=tuple(notes),
    )


def _worth_a_run(item: Confirmation, places: int) -> bool:
    """Return True if a fresh run can settle a candidate and the other places do not already show the opposite."""
    contradicted = item.contrast is not None and item.contrast.estimate * item.candidate.estimate < 0
    return not contradicted and item.places_needed is not None and item.places_needed <= AFFORDABLE * places


def incomparable(table: EvaluationTable, precisions: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of functions, sorted, whose precisions differ so much that they affect a comparison.

    bf16 and fp16 are comparable only with themselves. All other precisions are comparable with one another.

    Args:
        table: the evaluations of the functions.
        precisions: function to the precision that it ran in; default: full precision.
    """

    def reduced(name: str) -> str:
        precision = precisions.get(name, "")
        return precision if precision in _REDUCED else ""

    pairs = combinations(table.codes("function").names, 2)
    return tuple((a, b) for a, b in pairs if reduced(a) != reduced(b))


def _families(table: EvaluationTable, precisions: Mapping[str, str]) -> Iterator[_Family]:
    """Yield the family of each function, then that of the functions, where there is anything to compare."""
    pacc = table.numbers("pacc")
    factors = {factor.name: factor for factor in factors_of(table)}
    codes = {name: factor.codes for name, factor in factors.items()}
    functions = table.codes("function")
    for name in functions.names:
        of_function = np.where(functions.where(name), pacc, np.nan)
        if factors:
            yield _Family(name, observe(of_function, table.places, codes, table.place_positions), factors)
    apart = incomparable(table, precisions)
    names = functions.names
    comparable = [(a, b) for a, b in combinations(range(len(names)), 2) if (names[a], names[b]) not in apart]
    if comparable:
        factor = factor_of(table, "function")
        observations = observe(pacc, table.places, {**codes, "function": factor.codes}, table.place_positions)
        only = tuple((Change("function", a, b),) for a, b in comparable)
        yield _Family("", observations, {**factors, "function": factor}, only)


def _finding(
    table: EvaluationTable, family: _Family, item: Confirmation, spec: RunSpec | None, *, searched: bool
) -> Finding:
    contrast = item.candidate if item.contrast is None else item.contrast
    factors = [family.factors[change.factor] for change in contrast.changes]
    steps = tuple(
        Step(factor.name, factor.levels[change.before], factor.levels[change.after])
        for factor, change in zip(factors, contrast.changes, strict=True)
    )
    known, widest = np.isfinite(item.low), float(len(steps))  # scores lie in 0…1
    flips = largest_flips(family.observations, item.candidate, _PAIRS)
    finding = Finding(
        sentence="",
        function=family.function,
        steps=steps,
        matching=contrast.matching,
        estimand=table.units.estimand,
        confirmed=item.confirmed,
        effect=contrast.estimate,
        low=max(item.low, -widest) if known else None,
        high=min(item.high, widest) if known else None,
        places=contrast.places,
        pairs=contrast.pairs,
        places_needed=item.places_needed,
        examples=tuple((_view(table, before), _view(table, after)) for before, after in flips[:, -2:].tolist()),
        unequal=tuple(
            inequality
            for factor, change, step in zip(factors, contrast.changes, steps, strict=True)
            for inequality in _unequal(table, family.observations.rows, factor, change, step)
        ),
        picture_fault=_picture_fault(table, family, contrast),
        spec="" if spec is None else child_spec(table, spec, factors, contrast.changes, item.places_needed),
        places_for_size=item.places_for_size,
        alike=item.alike,
        searched=searched,
    )
    return replace(finding, sentence=finding_sentence(finding))


def _view(table: EvaluationTable, row: int) -> ScoredPerson:
    columns = table.arrow.slice(row, 1).select(["frame_id", "sensor", "function", "instance_id", "pacc"])
    return ScoredPerson(**columns.to_pylist()[0])


def _picture_fault(table: EvaluationTable, family: _Family, contrast: Contrast) -> PictureFault | None:
    """Return the faulty pictures without which less than half of a contrast is left; None where more is."""
    faults, observations = picture_faults(table), family.observations
    behind = np.zeros(len(table), np.bool_)
    behind[observations.rows] = True
    for change in contrast.changes:
        behind &= np.isin(family.factors[change.factor].codes, (change.before, change.after))
    counts = {fault: int(np.count_nonzero(behind & rows)) for fault, rows in faults.items()}
    if not any(counts.values()):
        return None
    values = np.full(len(table), np.nan)
    values[observations.rows] = observations.values
    values[np.logical_or.reduce(list(faults.values()))] = np.nan
    sound = observe(values, table.places, {name: factor.codes for name, factor in family.factors.items()})
    left = next((item.estimate for item in contrasts(sound, only=(contrast.changes,))), None)
    if left is not None and left * np.sign(contrast.estimate) >= abs(contrast.estimate) / 2:
        return None
    share = sum(counts.values()) / int(np.count_nonzero(behind))
    return PictureFault(max(counts, key=lambda fault: counts[fault]), share, left)


def _unequal(
    table: EvaluationTable, rows: NDArray[np.int64], factor: Factor, change: Change, step: Step
) -> Iterator[Inequality]:
    """Yield the measured quantities whose means differ strongly between the two sides of a change."""
    before, after = (rows[factor.codes[rows] == level] for level in (change.before, change.after))
    for column, bound in UNEQUAL.items():
        values = table.numbers(column)
        if not (np.isfinite(values[before]).any() and np.isfinite(values[after]).any()):
            continue
        means = float(np.nanmean(values[before])), float(np.nanmean(values[after]))
        if abs(means[1] - means[0]) > bound:
            yield Inequality(column, step, *means)


def _false_positives(table: EvaluationTable) -> Iterator[str]:
    """Name the functions with a share of false person pixels above `HEAVY`, by the lower end of its interval."""
    counts = frame_counts(table)
    called = counts.tp + counts.fp
    for function, sensor in settings(table):
        of_setting = table.codes("function").where(function) & table.codes("sensor").where(sensor)
        evaluations = of_setting[counts.row] & (called > 0)
        rows = np.zeros(len(table), np.bool_)
        rows[counts.row[evaluations]] = True
        wrong = np.zeros(len(table))
        weight = np.zeros(len(table))
        wrong[counts.row[evaluations]] = counts.fp[evaluations] / called[evaluations]
        weight[counts.row[evaluations]] = called[evaluations]
        interval = mean_interval(wrong[rows], table.units.of(rows), weights=weight[rows])
        if isinstance(interval, Interval) and interval.low > HEAVY:
            yield false_positives_sentence(function, sensor, interval)
