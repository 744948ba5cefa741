"""First findings, said in sentences that numbers wrote: each with its n and an interval, none where nothing was shown.

All comparisons that were made, the silent ones too, share one family of simultaneous 95 % intervals
(`valerie.analysis.intervals.simultaneous`): the chance that even one sentence is due to the choice of situations alone
is 5 %. What holds between bins may still have another cause than the axis it is binned by.
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
    """One sentence and what it rests on.

    Attributes:
        kind: which comparison.
        sentence: for people; holds the effect, its interval and every n.
        function, sensor: who looked (of two functions, the one with the higher pACC).
        column: the x column of a comparison between bins, the path of one between values, else empty.
        effect: a difference of pACC (0…1 scale), or by how much the share of false person pixels passes one half.
        interval: simultaneous 95 % interval of ``effect``; never holds 0.
        evidence: effect / standard error, without sign; findings are sorted by it.
        n: what was counted on each side.
        situations: how many different situations that rests on.
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
    """What a run shows at first sight.

    Attributes:
        items: strongest evidence first; of several changes along one axis or parameter only the clearest.
        examined: number of comparisons made.
        held: number whose interval leaves out "no effect".
        level: joint confidence of all intervals.
        resamples: bootstrap draws.
        seed: of the draws.
        unpaired: a sentence for each two functions that were not held against each other, with the reason.
    """

    items: tuple[Finding, ...]
    examined: int
    held: int
    level: float
    resamples: int
    seed: int
    unpaired: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Plain dicts, lists, numbers and None."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: Mapping[str, object]) -> Findings:
        """Read what `to_json` gave, also after a trip through JSON."""
        return TypeAdapter(cls).validate_python(document)


def find_findings(
    table: EvaluationTable, trends: Trends, *, resampler: Resampler, precisions: Mapping[str, str] | None = None
) -> Findings:
    """Compare bins, values of every varied parameter, characters, functions and false positives; say what holds.

    Args:
        table: the run's evaluations.
        trends: its trends (their bins are compared).
        resampler: the run's bootstrap draws (made of ``table.situations``).
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


def _clearest(found: list[Finding]) -> tuple[Finding, ...]:
    """All but those that repeat a clearer change along the same axis or parameter."""
    kept: list[Finding] = []
    said: set[tuple[str, str, str]] = set()
    for finding in found:
        axis = (finding.function, finding.sensor, finding.column)
        if finding.kind in (FindingKind.BINS, FindingKind.VALUES):
            if axis in said:
                continue
            said.add(axis)
        kept.append(finding)
    return tuple(kept)
