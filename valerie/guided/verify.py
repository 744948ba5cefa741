"""Verify a requirement with operational points until the sequential test of `valerie.statistics.verdicts` decides.

The requirement bounds the share of scores that pass, or the mean score. The test may be inspected after every batch. Each
point is a unit, so first combine all scores of a variant (of several cameras, say) into one number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Scores, Why
from valerie.parameters.samplers import UnitPoints
from valerie.statistics.verdicts import Outcome, judge_sample, units_to_decide


@dataclass(frozen=True, slots=True)
class Verification(Result):
    """The verdict on a requirement so far.

    Attributes:
        outcome: met, not met, or undecided.
        estimate: share of defined scores that pass, or mean score; NaN without any.
        bound: the required minimum.
        confidence: 1 − the chance of a false verdict.
        decided_after: number of defined scores that decided; None while undecided.
        further: number of further scores that would decide if the estimate is right; None if decided, or if no affordable
            number would.
        undefined: number of undefined scores, which are left out.
        evaluations: number of all points.
    """

    outcome: Outcome
    estimate: float
    bound: float
    confidence: float
    decided_after: int | None
    further: int | None
    undefined: int
    evaluations: int


class Verify:
    """Strategy that decides a requirement.

    Args:
        domain: the operational domain.
        bound: the least share of passing scores, or the least mean score.
        at_least: scores in [0, 1] below it fail; None for a bound of the mean score.
        seed: of all draws.
        confidence: 1 − the chance of a false verdict.

    Raises:
        InvalidInput: a number outside 0…1.
    """

    def __init__(
        self, domain: Cube, *, bound: float, at_least: float | None, seed: int, confidence: float = 0.95
    ) -> None:
        for name, value in (("bound", bound), ("at_least", at_least), ("confidence", confidence)):
            if value is not None and not 0 < value < 1:
                raise InvalidInput("has to lie between 0 and 1", field=name, value=value)
        self.domain, self.bound, self.at_least, self.seed = domain, bound, at_least, seed
        self.confidence = confidence
        self._open = OpenBatches()
        self._asked = 0
        self._scores: Scores = np.empty(0)
        self._known: Verification | None = None

    @property
    def result(self) -> Verification | None:
        """The verdict so far; None before any score."""
        return self._known

    def ask(self, count: int) -> Proposal:
        """Return the next operational points; none once the requirement is decided."""
        no_points = np.empty((0, self.domain.dimensions))
        if self._known is not None and self._known.outcome is not Outcome.UNDECIDED:
            return self._open.add(no_points, Reason(Why.DECIDED))
        rng = np.random.default_rng([self.seed, self._asked])
        self._asked += 1
        known = self._known
        numbers: dict[str, float] = {"points": count, "bound": self.bound, "scored": 0}
        if known is not None:
            numbers |= {"scored": known.evaluations - known.undefined, "estimate": known.estimate}
        if known is not None and known.further is not None:
            numbers["further"] = known.further
        elif not numbers["scored"] and (
            cheapest := units_to_decide(1.0, at_least=self.bound, confidence=self.confidence)
        ):
            numbers["cheapest"] = cheapest
        return self._open.add(self.domain.draw(rng, count), Reason(Why.JUDGING, numbers))

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, not one score for each, or a score outside 0…1.
        """
        values = self._open.close(points, scores)
        self._scores = np.concatenate([self._scores, values])
        judged = self._scores
        if self.at_least is not None:
            judged = np.where(np.isnan(judged), np.nan, judged >= self.at_least)
        verdict = judge_sample(judged, np.arange(len(judged)), at_least=self.bound, confidence=self.confidence)
        self._known = Verification(
            verdict.outcome,
            verdict.estimate,
            self.bound,
            self.confidence,
            verdict.decided_after,
            verdict.further,
            verdict.undefined,
            len(self._scores),
        )
