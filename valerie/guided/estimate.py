"""A failure rate over the operational domain, with two intervals.

The *assumption-free* number uses only points that were drawn from the operational density, in a number fixed in advance:
the interval of `valerie.statistics.intervals` for shares is valid for any scores.

The *model-assisted* number uses all points. Later batches are drawn from a fresh pool of M points of the operational
density by the mixture π = α/M + (1 − α) v/Σv, with v² = g(1 − g) + ((1 − λ)² + `DOUBT`) g² and g the failure probability by
a surrogate fitted to the earlier batches. With w = 1/(Mπ) and the indicator of failure I, a point contributes
Y = λḡ + w(I − λg): importance weighting with a control variate (Owen and Zhou 2000, doi:10.1080/01621459.2000.10473909). λ is
the regression coefficient in the latest batches, shrunk to 1, which is best for a calibrated g; ḡ is the mean of g over the
pool. Batches of n points are combined with weights ω ∝ 1 / (r/n + 1/M). Before a batch is drawn, r is foreseen as a multiple of
plain Monte Carlo's variance: that of a calibrated g, and that of failures that no surrogate expects. The interval is
p̂ exp(± t √V / p̂). The variance of a batch in V is at least the foreseen one of a calibrated g, scaled to all batches.

The operational share α is the one with the least variance. With h, the weighted number of failures where g < `KNOWN` per
evaluated point, and u, the variance of guided points alone for a calibrated g, the variance is about h/α + u/(1 − α), so
α = √h / (√h + √u).

Where the term w(I − λg) of a single point is more than `HEAVIEST` of the sum, the interval is the gamma interval for
weighted sums, with the largest weight that an unseen failure can have (Fay and Feuer 1997, *Statistics in Medicine* 16,
791-801).

Only the operational share can detect a mode of failures that the surrogate does not know, so the model-assisted interval can
miss it. `FailureRate.hidden_mode` bounds the probability of a mode that no operational point hit, and
`FailureRate.calibrated` says whether the operational failures show that the surrogate knows most of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv, stdtrit

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Scores, Why
from valerie.guided.surrogate import (
    LEAST_POINTS,
    Covariates,
    Surrogate,
    defined_probability,
    failure_probability,
    held_out,
    margins,
    prediction_error,
)
from valerie.parameters.samplers import UnitPoints
from valerie.statistics.intervals import Interval, highest_share, mean_interval
from valerie.statistics.units import Estimand, sampling_units

#: Range of the operational share α of guided batches.
SHARES: Final = (0.5, 0.9)
#: Weighted number of failures that no surrogate expects which is taken as seen before any is.
UNEXPECTED: Final = 0.05
#: Points of a pool for each point of its batch, so that it costs about 2 % of rendering them, within this range; for large
#: batches at least `LEAST_POOL` each.
POOL: Final = 40
POOL_RANGE: Final = (4_000, 20_000)
LEAST_POOL: Final = 20
#: With fewer failures than this, the proposal aims at the points with the lowest scores.
FEW: Final = 11
#: Share of the failures that the surrogate is sure of which are drawn as if they might not fail.
DOUBT: Final = 0.1
#: Number of sure failures that shrink λ to 1.
SURE: Final = 5.0
#: Number of expected and of unexpected failures that are taken as seen before any is.
SEEN: Final = 0.5
#: Range of the foreseen variance, as a multiple of plain Monte Carlo's.
FORESEEN: Final = (0.01, 2.0)
#: Largest share of the estimate that one point may carry before the gamma interval is taken.
HEAVIEST: Final = 0.1
#: A failure is known to the surrogate if its predicted probability is at least this.
KNOWN: Final = 0.05
#: Largest weighted share of failures unknown to the surrogate at which the assisted number may be used.
MOST_UNKNOWN: Final = 0.2
#: Largest upper bound (Clopper and Pearson, 95 %) of the share of unknown failures at which it may be used: few operational
#: failures are no evidence that the surrogate knows them all.
MOST_HIDDEN: Final = 0.5


@dataclass(frozen=True, slots=True)
class FailureRate(Result):
    """A failure rate with its intervals.

    Attributes:
        assumption_free: from operational points only. Intervals are valid for a number of points fixed in advance; k planned
            looks need the level 1 − 0.05 / k each.
        assisted: from all points and the surrogate; None before the second batch.
        undefined: rate of undefined scores, from operational points only.
        hidden_mode: largest probability of a mode of failures that no operational point hit, at 95 %: about 3 / n.
        unknown: weighted share of the failures of guided batches to which the surrogate of their batch gave a probability
            below `KNOWN`; NaN without failures.
        judged: number of failures among the operational points of guided batches.
        unforeseen: number of these that are unknown to the surrogate in the same sense.
        evaluations: number of all points.
    """

    assumption_free: Interval
    assisted: Interval | None
    undefined: Interval
    hidden_mode: float
    unknown: float
    judged: int
    unforeseen: int
    evaluations: int

    @property
    def hidden_share(self) -> float:
        """Upper bound of the share of failures that the surrogate does not expect, at 95 %: 1 without failures."""
        return float(highest_share(self.unforeseen, self.judged, 0.95))

    @property
    def calibrated(self) -> bool:
        """True if ``assisted`` may be used: the surrogate expected most failures, and enough were seen to tell."""
        return self.assisted is not None and self.unknown <= MOST_UNKNOWN and self.hidden_share <= MOST_HIDDEN


@dataclass(frozen=True, slots=True)
class Draws:
    """A drawn batch.

    Attributes:
        number: t, 0 for the operational points at the beginning.
        points: (n, dimensions).
        known: (n, k) what the surrogate sees: the points, and their covariates.
        weights: (n,) operational density over proposal density.
        predicted: (n,) margins that the surrogate predicted; None without one.
        expected: (n,) failure probabilities by the surrogate; 0 without one.
        pool_mean: mean of that probability over the pool.
        pool: number of points in the pool; 0 without one.
        control: λ, the coefficient of the control variate.
        share: α, the operational share of the mixture.
        counted: number of points, from the first on, that are operational and count for the assumption-free number.
        known_variance: foreseen variance of a contribution Y, if g is calibrated.
        foreseen: r, the foreseen variance with unexpected failures, as a multiple of plain Monte Carlo's.
    """

    number: int
    points: UnitPoints
    known: NDArray[np.float64]
    weights: NDArray[np.float64]
    predicted: NDArray[np.float64] | None
    expected: NDArray[np.float64]
    pool_mean: float
    pool: int
    control: float
    share: float
    counted: int
    known_variance: float = 0.0
    foreseen: float = 1.0

    @property
    def operational(self) -> int:
        """Number of operational points; they come first."""
        return round(self.share * len(self.points))


class Estimate:
    """Strategy that estimates a failure rate.

    Args:
        domain: the operational domain; the rate is that of its legal points.
        at_least: scores in [0, 1] below it fail.
        seed: of all draws.
        first: number of operational points at the beginning.
        pool: number of points in a pool; None: by the size of the batch.
        covariates: (n, dimensions) points to (n, k) known numbers, such as distances, for the surrogate.

    Attributes:
        draws: every batch with its weights, oldest first.
        scores: scores of the batches that were told, oldest first.

    Raises:
        InvalidInput: a bound outside 0…1, or too few points to fit a surrogate to.
    """

    def __init__(
        self,
        domain: Cube,
        *,
        at_least: float,
        seed: int,
        first: int = 256,
        pool: int | None = None,
        covariates: Covariates | None = None,
    ) -> None:
        if not 0 < at_least < 1:
            raise InvalidInput("a bound of scores in 0…1", field="at_least", value=at_least, limit="above 0, below 1")
        if first < LEAST_POINTS:
            raise InvalidInput("too few points to fit a surrogate to", field="first", value=first, limit=LEAST_POINTS)
        self.domain, self.at_least, self.seed, self.first, self.pool = domain, at_least, seed, first, pool
        self._covariates = covariates
        self.draws: list[Draws] = []
        self.scores: list[Scores] = []
        self._open = OpenBatches()
        self._predicted: list[NDArray[np.float64]] = []

    @property
    def result(self) -> FailureRate | None:
        """The failure rate; None while the first points lack scores."""
        return None if sum(map(len, self.scores)) < self.first else self.rate()

    def ask(self, count: int) -> Proposal:
        """Return the next batch; an empty one while the first points lack scores."""
        rng = np.random.default_rng([self.seed, len(self.draws)])
        missing = self.first - sum(len(draws.points) for draws in self.draws if draws.number == 0)
        if missing:
            draws = self._operational(rng, 0, min(count, missing))
        elif sum(map(len, self.scores)) < self.first:
            return Proposal(np.empty((0, self.domain.dimensions)), Reason(Why.FIRST_SCORES))
        else:
            draws = self._guided(rng, self.draws[-1].number + 1, count)
        self.draws.append(draws)
        return self._open.add(draws.points, self._reason(draws))

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, not one score for each, or a score outside 0…1.
        """
        self.scores.append(self._open.close(points, scores))

    def _reason(self, draws: Draws) -> Reason:
        scores = np.concatenate([np.empty(0), *self.scores])
        scored, failed = np.count_nonzero(~np.isnan(scores)), np.count_nonzero(scores < self.at_least)
        known = {"scored": int(scored), "failed": int(failed)}
        numbers = {"points": len(draws.points), **known}
        if draws.predicted is not None:
            doubtful = len(draws.points) - draws.operational
            expected = {"operational": draws.operational, "doubtful": doubtful, "expected": draws.pool_mean}
            return Reason(Why.DOUBTFUL, {**numbers, **expected})
        return Reason(Why.UNMODELLED if draws.number else Why.FIRST, {**numbers, "first": self.first})

    def _known(self, points: UnitPoints) -> NDArray[np.float64]:
        return points if self._covariates is None else np.column_stack([points, self._covariates(points)])

    def _operational(self, rng: np.random.Generator, number: int, count: int) -> Draws:
        zeros, points = np.zeros(count), self.domain.draw(rng, count)
        return Draws(number, points, self._known(points), zeros + 1, None, zeros, 0.0, 0, 0.0, 1.0, count)

    def _guided(self, rng: np.random.Generator, number: int, count: int) -> Draws:
        told = self._told()
        known, scores = np.concatenate([draws.known for draws, _ in told]), np.concatenate([s for _, s in told])
        true, defined = margins(scores, self.at_least), ~np.isnan(scores)
        predicted = self._predicted_before(told, true)
        judged = defined & ~np.isnan(predicted)
        if np.count_nonzero(judged) < LEAST_POINTS:
            return self._operational(rng, number, count)
        recent = _latest(judged, scores < self.at_least, told)
        error = prediction_error(true[recent], predicted[recent])
        control = self._control(told, failure_probability(predicted, error), recent)

        surrogate = Surrogate(known[defined], true[defined])
        pool = self.domain.draw(rng, self.pool or _pool_of(count))
        candidates = self._known(pool)
        of_pool = surrogate.predict(candidates)
        possible = defined_probability(known, defined, candidates)
        expected = possible * failure_probability(of_pool, error)
        # With few failures, the proposal aims at a bound with more points below it.
        aim = np.sort(true[defined])[FEW - 1] if np.count_nonzero(scores < self.at_least) < FEW else 0.0
        aimed = possible * failure_probability(of_pool - max(aim, 0.0), error)
        spread = np.sqrt(aimed * (1 - aimed) + ((1 - control) ** 2 + DOUBT) * aimed**2) + 1e-12
        doubt = expected * (1 - expected) + ((1 - control) * expected) ** 2

        share = self._share(told, float((doubt / spread).mean() * spread.mean()))
        operational = math.ceil(share * count)
        share = operational / count
        weights = 1 / (share + (1 - share) * len(pool) * spread / spread.sum())
        variance = float((weights * doubt).mean())
        chosen = np.concatenate(
            [
                rng.choice(len(pool), operational, replace=False),
                rng.choice(len(pool), count - operational, p=spread / spread.sum()),
            ]
        )
        return Draws(
            number,
            pool[chosen],
            candidates[chosen],
            weights[chosen],
            of_pool[chosen],
            expected[chosen],
            float(expected.mean()),
            len(pool),
            control,
            share,
            math.ceil(SHARES[0] * count),
            variance,
            self._foreseen(told, variance / max(float(expected.mean()), 1e-12), share),
        )

    def _predicted_before(self, told: list[tuple[Draws, Scores]], true: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return predictions of the margins by surrogates that were not fitted to them; NaN where there is none."""
        for draws, scores in told[len(self._predicted) :]:
            self._predicted.append(np.full(len(scores), np.nan) if draws.predicted is None else draws.predicted)
        predicted = np.concatenate(self._predicted)
        # Operational batches had no surrogate: each of their points is predicted from the others.
        unseen = np.isnan(predicted) & ~np.isnan(true)
        if np.count_nonzero(unseen) >= LEAST_POINTS:
            known = np.concatenate([draws.known for draws, _ in told])
            predicted[unseen] = held_out(known[unseen], true[unseen])
            self._predicted = np.split(predicted, np.cumsum([len(scores) for _, scores in told])[:-1])
        return predicted

    def _told(self) -> list[tuple[Draws, Scores]]:
        return list(zip(self.draws, self.scores, strict=False))

    def _share(self, told: list[tuple[Draws, Scores]], guided: float) -> float:
        """Return α for a variance u of ``guided`` points."""
        _, missed = self._weighted_failures(told)
        hidden = (UNEXPECTED + missed) / sum(len(scores) for _, scores in told)
        return float(np.clip(hidden**0.5 / (hidden**0.5 + guided**0.5), *SHARES))

    def _weighted_failures(self, told: list[tuple[Draws, Scores]]) -> tuple[float, float]:
        """Return the weighted number of failures in guided batches, and of those that their surrogates did not expect."""
        total = missed = 0.0
        for draws, scores in told:
            if draws.predicted is not None:
                failing = draws.weights * (scores < self.at_least)
                total += float(failing.sum())
                missed += float(failing[draws.expected < KNOWN].sum())
        return total, missed

    def _control(
        self, told: list[tuple[Draws, Scores]], expected: NDArray[np.float64], recent: NDArray[np.bool_]
    ) -> float:
        """Return λ, by regression of weighted failures on weighted expectations over the recent points."""
        weights = np.concatenate([draws.weights for draws, _ in told])[recent]
        failing = np.concatenate([scores < self.at_least for _, scores in told])[recent]
        (variance, covariance), _ = np.cov(weights * expected[recent], weights * failing, bias=True)
        sure = SURE / len(weights)
        return float(np.clip((covariance + sure) / (variance + sure), 0.0, 1.0))

    def _foreseen(self, told: list[tuple[Draws, Scores]], known: float, share: float) -> float:
        """Return r from the known part, and from the share of failures that surrogates did not expect."""
        judged, unforeseen = self._unforeseen(told)
        hidden = (unforeseen + SEEN) / (judged + 2 * SEEN)
        return float(np.clip(known + hidden / share, *FORESEEN))

    def rate(self, level: float = 0.95) -> FailureRate:
        """Return the failure rate from all batches that were told.

        Raises:
            InvalidInput: the first points lack scores.
        """
        told = self._told()
        evaluations = sum(len(scores) for _, scores in told)
        if evaluations < self.first:
            raise InvalidInput("the first points lack scores", field="scores", value=evaluations, limit=self.first)
        counted = np.concatenate([scores[: draws.counted] for draws, scores in told])
        total, missed = self._weighted_failures(told)
        return FailureRate(
            _share_interval(counted < self.at_least, level),
            self._assisted(told, level) if told[-1][0].number else None,
            _share_interval(np.isnan(counted), level),
            1 - 0.05 ** (1 / len(counted)),
            missed / total if total else math.nan,
            *self._unforeseen(told),
            evaluations,
        )

    def _unforeseen(self, told: list[tuple[Draws, Scores]]) -> tuple[int, int]:
        """Return the number of failures among the operational points of guided batches, and of those not expected."""
        judged = unforeseen = 0
        for draws, scores in told:
            if draws.predicted is not None:
                failing = (scores < self.at_least)[: draws.operational]
                judged += int(np.count_nonzero(failing))
                unforeseen += int(np.count_nonzero(failing & (draws.expected < KNOWN)[: draws.operational]))
        return judged, unforeseen

    def _assisted(self, told: list[tuple[Draws, Scores]], level: float) -> Interval:
        failing = np.concatenate([scores < self.at_least for _, scores in told])
        weights = np.concatenate([draws.weights for draws, _ in told])
        number = np.concatenate([np.full(len(scores), draws.number) for draws, scores in told])
        terms = weights * failing
        base = np.concatenate([np.full(len(scores), draws.control * draws.pool_mean) for draws, scores in told])
        expected = np.concatenate([draws.control * draws.expected for draws, _ in told])
        surprises = weights * (failing - expected)
        controlled = base + surprises
        sizes = np.bincount(number).astype(np.float64)
        of_pools = _by_number(told, [1 / draws.pool if draws.pool else 0.0 for draws, _ in told])
        batch = 1 / (_by_number(told, [draws.foreseen for draws, _ in told]) / sizes + of_pools)
        batch /= batch.sum()
        per_point = (batch / sizes)[number]
        estimate = float(per_point @ controlled)

        pooled = float(batch**2 @ of_pools)
        tail = (1 - level) / 2
        heaviest = float((per_point * np.abs(surprises)).max())
        if estimate <= 0 or heaviest > HEAVIEST * estimate:
            largest = max(batch[draws.number] / sizes[draws.number] / draws.share for draws, _ in told)
            estimate = float(per_point @ terms)
            variance = float(((per_point * terms) ** 2).sum()) + pooled * estimate
            low, high = _gamma_interval(estimate, variance, largest, tail)
            method = "Fay and Feuer"
        else:
            of_batch = [controlled[number == t] for t in range(len(sizes))]
            squares = np.array([values.var(ddof=1) if len(values) > 1 else 0.0 for values in of_batch])
            fourths = np.array([((values - values.mean()) ** 4).mean() for values in of_batch])
            foreseen = _by_number(told, [draws.known_variance for draws, _ in told])
            guided = foreseen > 0
            known = float((sizes * foreseen).sum())
            seen = float((sizes * squares)[guided].sum()) / known if known else 0.0
            least = np.maximum(squares, min(seen, 1.0) * foreseen)
            variance = pooled * estimate * (1 - estimate) + float((batch**2 * least / sizes).sum())
            noise = float(((batch**2 / sizes) ** 2 * (fourths - squares**2) / sizes).sum())
            freedom = max(2 * variance**2 / noise, 4.0) if noise > 0 else 4.0
            factor = math.exp(float(-stdtrit(freedom, tail)) * math.sqrt(variance) / estimate)
            low, high = estimate / factor, estimate * factor
            method = "Student's t on the logarithm"
        return Interval(low, min(high, 1.0), min(estimate, 1.0), level, len(terms), method, Estimand.DESIGN_BOX)


def _pool_of(count: int) -> int:
    least, most = POOL_RANGE
    return max(min(max(POOL * count, least), most), LEAST_POOL * count)


def _latest(
    judged: NDArray[np.bool_], failing: NDArray[np.bool_], told: list[tuple[Draws, Scores]]
) -> NDArray[np.bool_]:
    """Return the mask of the judged points in the latest batches with `FEW` failures: their surrogates are the best."""
    ends = np.cumsum([len(scores) for _, scores in told])
    for start in (*ends[-2::-1], 0):
        latest: NDArray[np.bool_] = judged & (np.arange(len(judged)) >= start)
        if np.count_nonzero(latest & failing) >= FEW:
            return latest
    return judged


def _by_number(told: list[tuple[Draws, Scores]], values: list[float]) -> NDArray[np.float64]:
    """Return the values of the batches by their number; the operational ones at the beginning have one number."""
    of_number = np.empty(told[-1][0].number + 1)
    of_number[[draws.number for draws, _ in told]] = values
    return of_number


def _share_interval(hits: NDArray[np.bool_], level: float) -> Interval:
    interval = mean_interval(hits, sampling_units("random", np.arange(len(hits))), level=level)
    assert isinstance(interval, Interval), "there are enough points"
    return interval


def _gamma_interval(estimate: float, variance: float, largest: float, tail: float) -> tuple[float, float]:
    """Return Fay and Feuer's interval of a weighted sum of counts.

    Args:
        estimate: the sum.
        variance: sum of the squared weights of the counts.
        largest: largest weight that a further count could have.
        tail: error of each side.
    """
    low = variance / estimate * float(gammaincinv(estimate**2 / variance, tail)) if estimate > 0 else 0.0
    upper, spread = estimate + largest, variance + largest**2
    return low, spread / upper * float(gammaincinv(upper**2 / spread, 1 - tail))
