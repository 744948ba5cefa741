"""Estimate the difference between two functions on the same variants to a requested precision.

Sampling stops at the first batch after which the half width of Student's interval, with the variance (1 + Σ(d − d̄)²) / n,
is at most the requested one (Chow and Robbins 1965, doi:10.1214/aoms/1177700156). Its coverage approaches the nominal level
as that width shrinks; docs/benchmarks.md has measured coverages. The sequential test of `valerie.statistics.verdicts`, valid
at any number of points, also judges which function is better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Why
from valerie.parameters.samplers import UnitPoints
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.units import sampling_units
from valerie.statistics.verdicts import Outcome, judge_sample

#: Fewest pairs for an interval.
FEWEST: Final = 50
#: With fewer differing points than this, rises and falls are bounded separately.
FEW: Final = 20
_EXAMPLES: Final = 5


@dataclass(frozen=True, slots=True)
class Difference(Result):
    """The difference so far, second minus first function.

    Attributes:
        estimate, low, high: mean difference of the scores, or of the shares of passing scores, with its interval.
        half_width: half width of the interval; 1 below `FEWEST` pairs.
        within: the requested half width.
        better: 0 or 1, the function with the higher mean; None while undecided.
        pairs: number of points on which both have a score.
        undefined: number of points on which a function has no score.
        further: number of further pairs until the half width is reached, at the current spread; None below `FEWEST` pairs.
        falls, rises: points on which the second function does worst, and best, compared with the first.
    """

    estimate: float
    low: float
    high: float
    half_width: float
    within: float
    better: int | None
    pairs: int
    undefined: int
    further: int | None
    falls: UnitPoints
    rises: UnitPoints


class Compare:
    """Strategy that compares two functions.

    Args:
        domain: the operational domain.
        within: the requested half width.
        seed: of all draws.
        at_least: compares shares of scores that reach it; None compares mean scores.
        level: confidence of the interval, and of the verdict on the better function.

    Attributes:
        columns: number of scores of each point.

    Raises:
        InvalidInput: a number outside 0…1.
    """

    columns: Final = 2

    def __init__(
        self,
        domain: Cube,
        *,
        within: float,
        seed: int,
        at_least: float | None = None,
        level: float = 0.95,
    ) -> None:
        for name, value in (("within", within), ("at_least", at_least), ("level", level)):
            if value is not None and not 0 < value < 1:
                raise InvalidInput("has to lie between 0 and 1", field=name, value=value)
        self.domain, self.within, self.seed, self.at_least, self.level = domain, within, seed, at_least, level
        self._open = OpenBatches(self.columns)
        self._asked = 0
        self._points = np.empty((0, domain.dimensions))
        self._scores = np.empty((0, self.columns))

    def ask(self, count: int) -> Proposal:
        """Return the next operational points; none once the interval is narrow enough."""
        known = self.result
        if known is not None and known.half_width <= self.within:
            return self._open.add(self._points[:0], Reason(Why.NARROW))
        rng = np.random.default_rng([self.seed, self._asked])
        self._asked += 1
        numbers: dict[str, float] = {"points": count, "within": self.within, "pairs": 0, "fewest": FEWEST}
        if known is not None:
            numbers |= {"pairs": known.pairs, "estimate": known.estimate, "half_width": known.half_width}
        if known is not None and known.further is not None:
            numbers["further"] = known.further
        return self._open.add(self.domain.draw(rng, count), Reason(Why.PAIRING, numbers))

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores, (n, 2), of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, not two scores for each, or a score outside 0…1.
        """
        values = self._open.close(points, scores)
        self._points = np.concatenate([self._points, points])
        self._scores = np.concatenate([self._scores, values])

    @property
    def result(self) -> Difference | None:
        """The difference so far; None before any pair."""
        defined = ~np.isnan(self._scores).any(axis=1)
        if not defined.any():
            return None
        first, second = self._scores[defined].T
        if self.at_least is not None:
            first, second = first >= self.at_least, second >= self.at_least
        differences = second.astype(np.float64) - first
        estimate, (low, high) = float(differences.mean()), self._interval(differences)
        half, count = (high - low) / 2, len(differences)
        # The width shrinks with the root of the number of pairs.
        further = None if count < FEWEST else max(math.ceil(count * ((half / self.within) ** 2 - 1)), 0)
        verdict = judge_sample(
            (differences + 1) / 2, np.arange(len(differences)), at_least=0.5, confidence=self.level
        ).outcome
        better = {Outcome.MET: 1, Outcome.NOT_MET: 0, Outcome.UNDECIDED: None}[verdict]
        order = np.argsort(differences, kind="stable")
        points = self._points[defined]
        falls = points[[row for row in order[:_EXAMPLES] if differences[row] < 0]]
        rises = points[[row for row in order[::-1][:_EXAMPLES] if differences[row] > 0]]
        undefined = int(np.count_nonzero(~defined))
        return Difference(
            estimate,
            low,
            high,
            half,
            self.within,
            better,
            count,
            undefined,
            further,
            falls,
            rises,
        )

    def _interval(self, differences: NDArray[np.float64]) -> tuple[float, float]:
        count, estimate = len(differences), float(differences.mean())
        if count < FEWEST:
            return -1.0, 1.0
        if np.count_nonzero(differences) < FEW:
            units = sampling_units("random", np.arange(count))
            rises, falls = (
                mean_interval(np.maximum(sign * differences, 0), units, level=(1 + self.level) / 2) for sign in (1, -1)
            )
            assert isinstance(rises, Interval), "there are enough points"
            assert isinstance(falls, Interval), "there are enough points"
            return rises.low - falls.high, rises.high - falls.low
        variance = (1 + float(((differences - estimate) ** 2).sum())) / count
        half = -float(stdtrit(count - 1, (1 - self.level) / 2)) * math.sqrt(variance / count)
        return max(estimate - half, -1.0), min(estimate + half, 1.0)
