"""Minimal pairs without known verdicts: draws variants until one fails and one passes, or checks two specified ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from valerie.guided.domain import Domain
from valerie.guided.explain import Explain, MinimalPair
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Scores, Why
from valerie.parameters.samplers import UnitPoints


class ExplainFromScratch:
    """Strategy that finds a failing and a passing variant, then the minimal pair between them.

    The failing variant is the one with the lowest score; the passing one differs least from it, in quantiles.

    Args:
        domain: of the variants.
        pair: a failing and a passing point, (dimensions,) each; None: the strategy searches for them.
        at_least: scores below it fail.
        seed: seeds the drawn points.
        batch: number of variants that can be evaluated at the same time.
    """

    def __init__(
        self, domain: Domain, pair: tuple[UnitPoints, UnitPoints] | None, *, at_least: float, seed: int, batch: int
    ) -> None:
        self.domain, self.at_least, self.seed, self.batch = domain, at_least, seed, batch
        self._wanted = None if pair is None else domain.snapped(np.array(pair))
        self._given = pair is not None
        self._points: list[UnitPoints] = []
        self._scores: list[Scores] = []
        self._open = OpenBatches()
        self._explain: Explain | None = None

    @property
    def result(self) -> MinimalPair | None:
        """The pair; None while the search goes on."""
        return None if self._explain is None else self._explain.result

    def ask(self, count: int) -> Proposal:
        """Return the next variants to evaluate."""
        if self._explain is not None:
            return self._explain.ask(count)
        no_points = np.empty((0, self.domain.dimensions))
        if not self._given:
            rng = np.random.default_rng([self.seed, len(self._points)])
            self._points.append(self.domain.snapped(self.domain.draw(rng, count)))
            scores = np.concatenate([np.empty(0), *self._scores])
            scored, failed = np.count_nonzero(~np.isnan(scores)), np.count_nonzero(scores < self.at_least)
            known = {"scored": int(scored), "failed": int(failed)}
            return self._open.add(self._points[-1], Reason(Why.DRAWN, {"points": count, **known}))
        if self._wanted is None:
            return Proposal(no_points, Reason(Why.VERDICTS) if len(self._open) else self._refusal())
        now, left = self._wanted[:count], self._wanted[count:]
        self._wanted = left if len(left) else None
        self._points.append(now)
        return self._open.add(now, Reason(Why.GIVEN, {"points": len(now)}))

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Add the scores of the oldest open batch."""
        if self._explain is not None and not len(self._open):
            self._explain.tell(points, scores)
            return
        self._scores.append(self._open.close(points, scores))
        if self._explain is None and not (self._given and self._wanted is not None):
            self._start()

    def _start(self) -> None:
        scores = np.concatenate(self._scores)
        points = np.concatenate(self._points[: len(self._scores)])
        fails, passes = scores < self.at_least, scores >= self.at_least
        if self._given:
            fails[1:], passes[:1] = False, False
        if not fails.any() or not passes.any():
            return
        failing = points[np.nanargmin(np.where(fails, scores, np.nan))]
        ways = np.abs(self.domain.steps(failing, points[passes])).sum(axis=1)
        passing = points[passes][np.argmin(ways)]
        self._explain = Explain(self.domain, failing, passing, at_least=self.at_least, batch=self.batch)

    def _refusal(self) -> Reason:
        failing, passing = np.concatenate(self._scores).tolist()
        return Reason(Why.NO_PAIR, {"failing": failing, "passing": passing, "at_least": self.at_least})
