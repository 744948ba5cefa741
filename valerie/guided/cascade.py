"""One estimate from two render engines: the cheap one at all points, the costly one at some.

Some points are evaluated by both. For a *mean score* the cheap scores of all points are a control variate: with the
regression coefficient β from the pairs, the estimate is ȳ + β (x̄ of all − x̄ of pairs), and its variance
s²(y − βx) / m + β² s²(x) / N (Cochran 1977, *Sampling Techniques*, section 12.6). Cheap points are drawn until there are
√(ρ² / (1 − ρ²) · cost ratio) for each pair, the best split of a budget (Peherstorfer and others 2016,
doi:10.1137/15M1046472); correlation ρ and split are measured again in every batch.

For a *failure rate*, normal intervals covered 51 to 70 % in trials. Instead, the verdict of the cheap engine defines two strata
of shares W and 1 − W. The costly points are divided as W √¼ to (1 − W) √0.01, the deviations where it is right half of the time,
and where it misses 1 %: by cheap verdicts only, so that the bounds of Clopper and Pearson hold within each stratum. They are
combined by recovered variances: with the distances d of each bound from its estimate, that of the sum is the root of Σ (W d)²
(Zou and Donner 2008, doi:10.1002/sim.3095).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, stdtrit

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Why
from valerie.parameters.samplers import UnitPoints
from valerie.statistics.intervals import highest_share

Floats = NDArray[np.float64]

#: Fewest pairs for an interval.
FEWEST: Final = 50
#: Deviations of costly verdicts that are assumed where the cheap engine fails, and where it passes.
ASSUMED: Final = (0.5, 0.1)
#: Most cheap points for each pair.
MOST_CHEAP: Final = 50.0
_EXAMPLES: Final = 8


@dataclass(frozen=True, slots=True)
class TwoEngines(Result):
    """The estimate from both engines.

    Attributes:
        estimate, low, high: mean score, or failure rate, of the costly engine, with its 95 % interval.
        method: how the interval was computed.
        correlation: between the engines' scores, or failures, on the same points; NaN if one of them is constant.
        cheap, costly: number of points of each engine.
        costs: mean cost of a point by the cheap and the costly engine; NaN where unknown.
        ratio: the optimal number of cheap points for each pair, from correlation and costs; NaN where unknown.
        saved: share of costly points saved at equal variance, 1 − variance ratio; NaN for failure rates.
        disagree: (k, dimensions) points on which the engines differ most.
        undefined: number of points on which the costly engine has no score; they are left out.
    """

    estimate: float
    low: float
    high: float
    method: str
    correlation: float
    cheap: int
    costly: int
    costs: tuple[float, float]
    ratio: float
    saved: float
    disagree: UnitPoints
    undefined: int


class Cascade:
    """Strategy that divides a budget between two engines. Proposals of level 1 are for the costly one.

    Args:
        domain: the operational domain.
        seed: of all draws.
        costs: cost of a point by the cheap and by the costly engine, in any unit; None: those that `spend` is told.
        at_least: estimates the share of scores below it; None estimates the mean score.

    Raises:
        InvalidInput: a bound outside 0…1, or costs that are not positive.
    """

    def __init__(
        self, domain: Cube, *, seed: int, costs: tuple[float, float] | None = None, at_least: float | None = None
    ) -> None:
        if at_least is not None and not 0 < at_least < 1:
            raise InvalidInput("has to lie between 0 and 1", field="at_least", value=at_least)
        if costs is not None and min(costs) <= 0:
            raise InvalidInput("a cost is positive", field="costs", value=min(costs), limit="> 0")
        self.domain, self.seed, self.at_least = domain, seed, at_least
        self._spent, self._evaluated = np.array(costs or (0.0, 0.0)), np.array([1, 1] if costs else [0, 0])
        self._open = OpenBatches()
        self._levels: deque[NDArray[np.int64] | None] = deque()
        self._asked = 0
        self._points = np.empty((0, domain.dimensions))
        self._cheap: Floats = np.empty(0)
        self._costly: Floats = np.empty(0)
        #: Rows that were proposed for the costly engine.
        self._paired = np.empty(0, np.bool_)
        self._drawn = 0

    def ask(self, count: int) -> Proposal:
        """Return the next batch, of one engine."""
        rows = self._next_pairs(count)
        if len(rows):
            self._paired[rows] = True
            self._levels.append(rows)
            return self._open.add(self._points[rows], Reason(Why.COSTLY, self._known(len(rows))), 1)
        rng = np.random.default_rng([self.seed, self._asked])
        self._asked += 1
        self._levels.append(None)
        self._drawn += count
        return self._open.add(self.domain.draw(rng, count), Reason(Why.CHEAP, self._known(count)))

    def _known(self, count: int) -> dict[str, float]:
        """Return the numbers of the reason for a batch of ``count`` points."""
        return {
            "points": count,
            "cheap": int(np.count_nonzero(~np.isnan(self._cheap))),
            "pairs": int(np.count_nonzero(self._both())),
            "fewest": FEWEST,
            "correlation": self._correlation(),
            "ratio": self._ratio(),
        }

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, not one score for each, or a score outside 0…1.
        """
        values = self._open.close(points, scores)
        rows = self._levels.popleft()
        if rows is not None:
            self._costly[rows] = values
            return
        missing = np.full(len(values), np.nan)
        self._points = np.concatenate([self._points, points])
        self._cheap, self._costly = np.concatenate([self._cheap, values]), np.concatenate([self._costly, missing])
        self._paired = np.concatenate([self._paired, np.zeros(len(values), np.bool_)])

    def spend(self, level: int, cost: float, count: int) -> None:
        """Take the cost of points that an engine evaluated; the split of the budget follows from the means.

        Args:
            level: 0 for the cheap engine, 1 for the costly one.
            cost: of all these points, in one unit for both engines.
            count: number of points.
        """
        self._spent[level] += cost
        self._evaluated[level] += count

    @property
    def costs(self) -> tuple[float, float]:
        """Mean cost of a point by the cheap and the costly engine; NaN before any."""
        cheap, costly = np.where(self._evaluated > 0, self._spent / np.maximum(self._evaluated, 1), np.nan).tolist()
        return cheap, costly

    def _ratio(self) -> float:
        """Return the optimal number of cheap points for each pair; NaN before `FEWEST` pairs."""
        correlation, both = self._correlation(), np.count_nonzero(self._both())
        if both < FEWEST or math.isnan(correlation):
            return math.nan
        remaining = max(1 - correlation**2, 1e-3)
        cheap, costly = self.costs
        # Products that cost nothing, or were never priced, say nothing of the split.
        priced = costly / cheap if cheap > 0 and costly > 0 else 1.0
        return float(np.clip(math.sqrt(correlation**2 / remaining * priced), 1.0, MOST_CHEAP))

    def _next_pairs(self, count: int) -> NDArray[np.int64]:
        """Return the rows for the costly engine; none if cheap points come next."""
        left = np.flatnonzero(~self._paired & ~np.isnan(self._cheap))
        pairs, ratio = int(np.count_nonzero(self._paired)), self._ratio()
        wanted = FEWEST - pairs if math.isnan(ratio) and pairs < FEWEST else 0
        if not math.isnan(ratio):
            wanted = int(self._drawn / ratio) - pairs
        elif np.count_nonzero(self._both()) >= FEWEST:  # the scores of an engine are constant
            wanted = self._drawn // 2 - pairs
        wanted = min(wanted, count)
        if wanted <= 0 or not len(left):
            return left[:0]
        if self.at_least is None:
            return left[:wanted]
        fails = self._cheap[left] < self.at_least
        share = float((self._cheap[~np.isnan(self._cheap)] < self.at_least).mean())
        failing, passing = share * ASSUMED[0], (1 - share) * ASSUMED[1]
        count = min(math.ceil(wanted * failing / (failing + passing)), int(fails.sum()))
        return np.sort(np.concatenate([left[fails][:count], left[~fails][: wanted - count]]))

    def _both(self) -> NDArray[np.bool_]:
        return ~np.isnan(self._cheap) & ~np.isnan(self._costly)

    def _judged(self, scores: Floats) -> Floats:
        return scores if self.at_least is None else (scores < self.at_least).astype(np.float64)

    def _correlation(self) -> float:
        both = self._both()
        x, y = self._judged(self._cheap[both]), self._judged(self._costly[both])
        if np.count_nonzero(both) < 3 or np.ptp(x) == 0 or np.ptp(y) == 0:
            return math.nan
        if self.at_least is None:
            return float(np.corrcoef(x, y)[0, 1])
        # The pairs have another share of failures than the domain.
        share, strata = self._strata(both)
        weight, failing, passing = (part.shrunk for part in (share, *strata))
        rate = weight * failing + (1 - weight) * passing
        return (failing - passing) * math.sqrt(weight * (1 - weight) / (rate * (1 - rate)))

    @property
    def result(self) -> TwoEngines | None:
        """The estimate so far; None below `FEWEST` pairs."""
        both = self._both()
        if np.count_nonzero(both) < FEWEST:
            return None
        if self.at_least is None:
            estimate, low, high, saved = self._mean(both)
            method = "regression on the cheap engine, Student's t"
        else:
            estimate, low, high = self._rate(both)
            saved, method = math.nan, "strata by the cheap engine, recovered variances of Clopper and Pearson"
        apart = np.abs(self._judged(self._cheap) - self._judged(self._costly))
        order = np.argsort(-np.where(both, apart, -1.0), kind="stable")[:_EXAMPLES]
        disagree = self._points[order[both[order] & (apart[order] > 0)]]
        cheap, costly = int(np.count_nonzero(~np.isnan(self._cheap))), int(np.count_nonzero(both))
        correlation = self._correlation()
        undefined = int(np.count_nonzero(self._paired & np.isnan(self._costly)))
        return TwoEngines(
            estimate,
            low,
            high,
            method,
            correlation,
            cheap,
            costly,
            self.costs,
            self._ratio(),
            saved,
            disagree,
            undefined,
        )

    def _mean(self, both: NDArray[np.bool_]) -> tuple[float, float, float, float]:
        x, y = self._cheap[both], self._costly[both]
        everywhere = self._cheap[~np.isnan(self._cheap)]
        count = len(y)
        beta = float(np.cov(x, y)[0, 1] / x.var(ddof=1)) if np.ptp(x) > 0 else 0.0
        estimate = float(y.mean() + beta * (everywhere.mean() - x.mean()))
        residuals = y - y.mean() - beta * (x - x.mean())
        variance = float((residuals**2).sum()) / (count - 2) / count + beta**2 * float(everywhere.var(ddof=1)) / len(
            everywhere
        )
        half = -float(stdtrit(count - 2, 0.025)) * math.sqrt(variance)
        alone = float(y.var(ddof=1)) / count
        saved = 1 - variance / alone if alone > 0 else math.nan
        return estimate, max(estimate - half, 0.0), min(estimate + half, 1.0), saved

    def _strata(self, both: NDArray[np.bool_]) -> tuple[_Share, tuple[_Share, _Share]]:
        """Return how many points the cheap engine fails, and of these and of the others how many the costly one fails."""
        assert self.at_least is not None, "a failure rate has a bound"
        known, cheap_fails = ~np.isnan(self._cheap), self._cheap < self.at_least
        failing, passing = (
            _Share(int((self._costly[both & stratum] < self.at_least).sum()), int((both & stratum).sum()))
            for stratum in (cheap_fails, ~cheap_fails)
        )
        return _Share(int((cheap_fails & known).sum()), int(known.sum())), (failing, passing)

    def _rate(self, both: NDArray[np.bool_]) -> tuple[float, float, float]:
        share, strata = self._strata(both)
        (failing, passing), weight = (stratum.estimate for stratum in strata), share.estimate
        estimate = weight * failing + (1 - weight) * passing
        parts = zip((weight, 1 - weight, failing - passing), (*strata, share), strict=True)
        steps = [(factor * (bound - part.estimate)) for factor, part in parts for bound in part.bounds(0.05)]
        below = math.sqrt(sum(step**2 for step in steps if step < 0))
        above = math.sqrt(sum(step**2 for step in steps if step > 0))
        return estimate, max(estimate - below, 0.0), min(estimate + above, 1.0)


@dataclass(frozen=True, slots=True)
class _Share:
    """``hits`` of ``count``."""

    hits: int
    count: int

    @property
    def estimate(self) -> float:
        return self.hits / self.count if self.count else 0.5

    @property
    def shrunk(self) -> float:
        """The estimate, drawn towards ½ so that few points never look certain."""
        return (self.hits + 0.5) / (self.count + 1)

    def bounds(self, error: float) -> tuple[float, float]:
        """Return the bounds of Clopper and Pearson (1934, doi:10.1093/biomet/26.4.404)."""
        if not self.count:
            return 0.0, 1.0
        missed = self.count - self.hits
        low = float(betaincinv(self.hits, missed + 1, error / 2)) if self.hits else 0.0
        return low, float(highest_share(self.hits, self.count, 1 - error / 2))
