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

from valerie.analysis.comparisons import Comparison, FindingKind, compare_all, unpaired
from valerie.analysis.intervals import Interval, Resampler, simultaneous
from valerie.analysis.table import EvaluationTable
from valerie.analysis.trends import Trends

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
        precisions: function to the precision that it ran in; see `valerie.analysis.comparisons.unpaired`.
    """
    precisions = precisions or {}
    made = tuple(compare_all(table, trends, resampler, precisions))
    draws = len(resampler.weights)
    replicates = np.stack([c.replicates for c in made], axis=1) if made else np.zeros((draws, 0))
    estimates, situations = np.array([c.estimate for c in made]), np.array([c.situations for c in made])
    half, error = simultaneous(estimates, replicates, situations, level=LEVEL)
    judged = zip(made, half.tolist(), error.tolist(), strict=True)
    found = [_finding(comparison, h, e) for comparison, h, e in judged if _holds(comparison, h)]
    found.sort(key=lambda finding: (-finding.evidence, finding.sentence))
    apart = tuple(
        f"{a} ({precisions.get(a, 'full precision')}) and {b} ({precisions.get(b, 'full precision')}) ran in unequal precisions "
        "and are not held against each other."
        for a, b in unpaired(table, precisions)
    )
    return Findings(_clearest(found), len(made), len(found), LEVEL, draws, resampler.seed, apart)


def _holds(comparison: Comparison, half: float) -> bool:
    """Whether the interval leaves out "no effect", in a direction that is worth saying."""
    return abs(comparison.estimate) > half and (comparison.estimate > 0 or not comparison.upward_only)


def _finding(comparison: Comparison, half: float, error: float) -> Finding:
    effect = comparison.estimate
    interval = f"95 % interval {100 * (abs(effect) - half):.1f} to {100 * (abs(effect) + half):.1f}"
    return Finding(
        kind=comparison.kind,
        sentence=comparison.say(effect > 0, f"{100 * abs(effect):.1f} points", interval),
        function=comparison.function if effect > 0 or not comparison.other else comparison.other,
        sensor=comparison.sensor,
        column=comparison.column,
        effect=effect,
        interval=Interval(effect - half, effect + half),
        evidence=abs(effect) / error,
        n=comparison.n,
        situations=comparison.situations,
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
