"""Findings: the comparisons of a run whose effect the choice of situations cannot explain.

All comparisons, also those without a finding, share one family of simultaneous 95 % intervals
(`valerie.analysis.intervals.simultaneous`). The chance that even one finding is due to the choice of situations alone is
5 %. A difference between bins may still have another cause than the axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
from pydantic import TypeAdapter

from valerie.analysis.comparisons import Comparison, FindingKind, compare_all, incomparable
from valerie.analysis.intervals import Interval, Resampler, simultaneous
from valerie.analysis.table import EvaluationTable
from valerie.analysis.trends import Trends
from valerie.analysis.wording import finding_sentence, incomparable_sentence

#: Joint confidence of all findings of a run.
LEVEL: Final = 0.95


@dataclass(frozen=True, slots=True)
class Finding:
    """One effect with its evidence.

    Attributes:
        kind: kind of the comparison.
        sentence: for people, with the effect, its interval and every n.
        function, sensor: names of the function and the sensor setting; of two functions, the one with the higher pACC.
        column: axis of the bins or path of the parameter; empty for other kinds.
        effect: difference of mean pACC (0…1 scale), or of the share of false person pixels to one half.
        interval: simultaneous 95 % interval of ``effect``; never holds 0.
        evidence: |effect| / standard error; findings are sorted by it.
        n: number of persons, pairs or frames on each side.
        situations: number of different situations.
    """

    kind: FindingKind
    sentence: str
    function: str
    sensor: str
    column: str
    effect: float
    interval: Interval
    evidence: float
    n: dict[str, int]
    situations: int


@dataclass(frozen=True, slots=True)
class Findings:
    """Findings of a run.

    Attributes:
        items: strongest evidence first; of several changes along one axis or parameter only the clearest.
        examined: number of comparisons.
        held: number of comparisons whose interval leaves out 0.
        level: joint confidence of all intervals.
        resamples: number of bootstrap draws.
        seed: of the draws.
        unpaired: a sentence with the reason for each two functions that are not compared.
    """

    items: tuple[Finding, ...]
    examined: int
    held: int
    level: float
    resamples: int
    seed: int
    unpaired: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Return the findings as JSON values."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: Mapping[str, object]) -> Findings:
        """Read the result of `to_json`, also after a round trip through JSON text."""
        return TypeAdapter(cls).validate_python(document)


def find_findings(
    table: EvaluationTable, trends: Trends, *, resampler: Resampler, precisions: Mapping[str, str] | None = None
) -> Findings:
    """Compare bins, values of every varied parameter, pedestrians and functions, and return the effects that hold.

    Args:
        table: the run's evaluations.
        trends: its trends, whose bins are compared.
        resampler: bootstrap draws of ``table.situations``.
        precisions: function to the precision that it ran in; see `valerie.analysis.comparisons.incomparable`.
    """
    precisions = precisions or {}
    comparisons = tuple(compare_all(table, trends, resampler, precisions))
    draws = len(resampler.weights)
    differences = [comparison.difference for comparison in comparisons]
    replicates = np.stack([one.replicates for one in differences], axis=1) if differences else np.zeros((draws, 0))
    estimates, situations = np.array([d.estimate for d in differences]), np.array([d.situations for d in differences])
    half, error = simultaneous(estimates, replicates, situations, level=LEVEL)
    several = len(table.codes("sensor").names) > 1
    findings = [
        _finding(comparison, own_half, own_error, several_sensors=several)
        for comparison, own_half, own_error in zip(comparisons, half.tolist(), error.tolist(), strict=True)
        if _holds(comparison, own_half)
    ]
    findings.sort(key=lambda finding: (-finding.evidence, finding.sentence))
    apart = tuple(incomparable_sentence(a, b, precisions) for a, b in incomparable(table, precisions))
    return Findings(_clearest(findings), len(comparisons), len(findings), LEVEL, draws, resampler.seed, apart)


def _holds(comparison: Comparison, half: float) -> bool:
    """Return whether the interval leaves out 0, in a direction that is worth saying."""
    estimate = comparison.difference.estimate
    return abs(estimate) > half and (estimate > 0 or comparison.kind is not FindingKind.FALSE_POSITIVES)


def _finding(comparison: Comparison, half: float, error: float, *, several_sensors: bool) -> Finding:
    difference = comparison.difference
    effect = difference.estimate
    interval = Interval(effect - half, effect + half)
    better = comparison.second.name if comparison.kind is FindingKind.FUNCTIONS and effect < 0 else comparison.function
    return Finding(
        kind=comparison.kind,
        sentence=finding_sentence(comparison, interval, several_sensors=several_sensors),
        function=better,
        sensor=comparison.sensor,
        column=comparison.column,
        effect=effect,
        interval=interval,
        evidence=abs(effect) / error,
        n=difference.n,
        situations=difference.situations,
    )


def _clearest(findings: list[Finding]) -> tuple[Finding, ...]:
    """Return the findings without those that repeat a clearer change along the same axis or parameter."""
    kept: list[Finding] = []
    named: set[tuple[str, str, str]] = set()
    for finding in findings:
        axis = (finding.function, finding.sensor, finding.column)
        if finding.kind in (FindingKind.BINS, FindingKind.VALUES):
            if axis in named:
                continue
            named.add(axis)
        kept.append(finding)
    return tuple(kept)
