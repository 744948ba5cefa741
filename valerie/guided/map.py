"""A map of the boundary between pass and fail: pass, fail, undefined, or not known.

A Gaussian process is fitted to the margins. Half of each batch explores with scrambled Sobol' points. The others are the
points of a pool where the process is least sure of the verdict, with the largest 1.96 σ − |μ| (straddle heuristic: Bryan and
others 2005, *Advances in Neural Information Processing Systems* 18); each choice lowers σ around it before the next.

The calls need more than the process, since verdicts jump where a person is hidden, and since scores have noise. A random
forest of the classes pass, fail and undefined knows jumps, the verdicts of the nearest points know small regions, and a
logistic regression of the held-out predictions of all three weighs them (stacking: Wolpert 1992,
doi:10.1016/S0893-6080(05)80023-1). *Held-out* is out of bag for the forest and leave-one-out for the others, so no point is
predicted from its own score.

The map gives a verdict from the largest probability of a call down to where at most a share `WRONG` of the calls is wrong, by
the upper bound (`highest_share`) of the held-out calls of exploring points, which are
spread like the domain (selection with guaranteed risk: Geifman and El-Yaniv 2017, arXiv:1705.08500). Elsewhere it says "not
known".
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.exploration import SpaceFilling
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Scores, Why
from valerie.guided.surrogate import margins
from valerie.parameters.samplers import UnitPoints
from valerie.statistics.intervals import highest_share
from valerie.statistics.threads import one_thread

if TYPE_CHECKING:
    from valerie.guided.process import Process

Floats = NDArray[np.float64]

#: Share of a batch that explores.
EXPLORING: Final = 0.5
#: Exploring points before the first fit.
FIRST: Final = 64
#: Largest share of wrong calls where the map gives a verdict, and the confidence in it.
WRONG: Final = 0.05
CONFIDENCE: Final = 0.9
#: Most points for a fit of the length scales.
FITTED: Final = 300
_POOL: Final = 2_000
_DOUBTFUL: Final = 400
_REFERENCE: Final = 1_024
_TREES: Final = 30
#: Nearest points whose verdicts count.
_NEAREST: Final = 10
#: Largest |μ| / σ that the regression distinguishes.
_SUREST: Final = 4.0


class Call(StrEnum):
    """The map's verdict on a point."""

    PASS = "pass"  # noqa: S105  not a password
    FAIL = "fail"
    UNDEFINED = "undefined"
    NOT_KNOWN = "not known"


#: The verdicts by the numbers of the forest's classes.
_CLASSES: Final = np.array([Call.PASS.value, Call.FAIL.value, Call.UNDEFINED.value])


@dataclass(frozen=True, slots=True)
class Boundary(Result):
    """The map of the boundary so far.

    Attributes:
        passing, failing, undefined, not_known: shares of the operational domain.
        wrong: share of wrong held-out calls among the exploring points for which the map gives a verdict; NaN without any.
        tested: number of these.
        failing_unknown: share of failures among the other exploring points; NaN without any.
        evaluations: number of all points.
        nearest: (k, dimensions) evaluated points nearest to the boundary.
    """

    passing: float
    failing: float
    undefined: float
    not_known: float
    wrong: float
    tested: int
    failing_unknown: float
    evaluations: int
    nearest: UnitPoints


class Map:
    """Strategy that maps the boundary.

    Args:
        domain: the operational domain.
        at_least: scores in [0, 1] below it fail.
        seed: of all draws.

    Raises:
        InvalidInput: a bound outside 0…1.
    """

    def __init__(self, domain: Cube, *, at_least: float, seed: int) -> None:
        if not 0 < at_least < 1:
            raise InvalidInput("a bound of scores in 0…1", field="at_least", value=at_least, limit="above 0, below 1")
        self.domain, self.at_least, self.seed = domain, at_least, seed
        self._exploration = SpaceFilling(domain, seed)
        self._open = OpenBatches()
        self._asked = 0
        self._points = np.empty((0, domain.dimensions))
        self._scores: Scores = np.empty(0)
        self._explores: deque[int] = deque()
        self._explored = np.empty(0, np.bool_)
        self._process: Process | None = None
        self._verdicts: _Verdicts | None = None
        self._fitted = 0  # defined scores at the last fit of the kernel
        self._reference: UnitPoints | None = None
        self._seen = np.empty((0, _REFERENCE))  # what the first values tell about the reference

    @one_thread()
    def ask(self, count: int) -> Proposal:
        """Return the next batch."""
        rng = np.random.default_rng([self.seed, 1, self._asked])
        self._asked += 1
        doubtful = np.empty((0, self.domain.dimensions))
        if self._process is not None:
            doubtful = self._doubtful(self._process, rng, count - max(int(EXPLORING * count), 1))
        exploring = count - len(doubtful)
        points = np.concatenate([self._exploration.take(exploring), doubtful])
        self._explores.append(exploring)
        numbers = {"scored": len(self._scores), "exploring": exploring, "doubtful": len(doubtful)}
        return self._open.add(points, Reason(Why.BORDER, numbers))

    @one_thread()
    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, not one score for each, or a score outside 0…1.
        """
        values = self._open.close(points, scores)
        self._explored = np.concatenate([self._explored, np.arange(len(points)) < self._explores.popleft()])
        self._points = np.concatenate([self._points, points])
        self._scores = np.concatenate([self._scores, values])
        self._verdicts = None
        if np.count_nonzero(~np.isnan(self._scores)) >= FIRST:
            self._fit()

    @one_thread()
    def calls(self, points: UnitPoints) -> NDArray[np.str_]:
        """Return the verdicts on points, (n,) of `Call`."""
        if self._process is None:
            return np.full(len(points), Call.NOT_KNOWN.value, dtype="<U9")
        features = self.domain.features(points)
        return self._known().calls(features, self._process.seen(self._process.covariance(features)))

    @property
    @one_thread()
    def result(self) -> Boundary | None:
        """The map so far; None before the first fit."""
        if self._process is None:
            return None
        if self._reference is None:
            self._reference = SpaceFilling(self.domain, self.seed + 1).take(_REFERENCE)
        features = self.domain.features(self._reference)
        self._seen = self._process.seen(self._process.covariance(features, len(self._seen)), self._seen)
        verdicts = self._known()
        calls = verdicts.calls(features, self._seen)
        shares = {call: float(np.mean(calls == call)) for call in Call}
        held_out, truth = verdicts.held_out[self._explored], verdicts.truth[self._explored]
        known = held_out != Call.NOT_KNOWN
        nearest = np.argsort(np.abs(np.where(np.isnan(self._scores), np.inf, self._scores - self.at_least)))[:5]
        return Boundary(
            shares[Call.PASS],
            shares[Call.FAIL],
            shares[Call.UNDEFINED],
            shares[Call.NOT_KNOWN],
            _share(held_out[known] != truth[known]),
            int(known.sum()),
            _share(truth[~known] == Call.FAIL),
            len(self._scores),
            self._points[nearest],
        )

    def _known(self) -> _Verdicts:
        assert self._process is not None, "there are enough scores"
        if self._verdicts is None:
            self._verdicts = _Verdicts(
                self.domain, self._process, self._points, self._scores, self._explored, self.at_least
            )
        return self._verdicts

    def _doubtful(self, process: Process, rng: np.random.Generator, count: int) -> UnitPoints:
        """Return legal points where the process is least sure, (count, dimensions); fewer if hardly any is legal."""
        pool = rng.random((max(_POOL, 4 * count), self.domain.dimensions))
        features = self.domain.features(pool)
        covariance = process.covariance(features)
        certain, half = np.abs(process.mean(covariance)), len(covariance) // 2
        seen = process.seen(covariance[:half])  # bounds σ at a quarter of the cost
        best = np.argsort(certain - 1.96 * process.deviation(seen), kind="stable")[: max(_DOUBTFUL, 4 * count)]
        pool, features, certain = pool[best], features[best], certain[best]
        seen = process.seen(covariance[half:, best], seen[:, best])
        covariance = process.kernel(features, features) - seen.T @ seen
        variance, columns = np.diag(covariance).copy(), np.empty((len(pool), count))
        chosen: list[int] = []
        for _ in pool:
            if len(chosen) == count:
                break
            row = int(np.argmax(1.96 * np.sqrt(np.maximum(variance, 0)) - certain))
            certain[row] = np.inf
            if not self.domain.legal(pool[row : row + 1])[0]:  # legality costs most, so only chosen points are tried
                continue
            k = len(chosen)
            column = covariance[:, row] - columns[:, :k] @ columns[row, :k]
            columns[:, k] = column / np.sqrt(column[row] + process.kernel.noise)
            variance -= columns[:, k] ** 2
            chosen.append(row)
        return pool[chosen]

    def _fit(self) -> None:
        """Fit the process to all scores so far; its kernel is refitted each time the points have grown by half."""
        from valerie.guided.process import Kernel, Process  # loads much of scipy

        defined = ~np.isnan(self._scores)
        features, values = self.domain.features(self._points[defined]), margins(self._scores[defined], self.at_least)
        before = self._process
        if len(features) >= 1.5 * self._fitted and self._fitted < FITTED:
            self._fitted = len(features)
            self._seen = self._seen[:0]
            start = None if before is None else before.kernel
            kernel = Kernel.likeliest(features[-FITTED:], values[-FITTED:], start)
            self._process = Process(kernel, features, values)
        else:
            assert before is not None, "the first scores fit a kernel"
            self._process = Process(before.kernel, features, values, before)


class _Verdicts:
    """The calls of a map at its present scores.

    Args:
        domain, at_least: those of the map.
        process: the process for the defined scores.
        points, scores: (n, dimensions) and (n,), all so far.
        explored: (n,) True for exploring points.

    Attributes:
        truth: (n,) verdicts on the evaluated points.
        held_out: (n,) calls of these without their own scores.
    """

    def __init__(
        self,
        domain: Cube,
        process: Process,
        points: UnitPoints,
        scores: Scores,
        explored: NDArray[np.bool_],
        at_least: float,
    ) -> None:
        from scipy.spatial import cKDTree
        from sklearn.linear_model import LogisticRegression

        from valerie.guided.forest import Forest

        self._domain, self._process = domain, process
        features, lacking = domain.features(points), np.isnan(scores)
        numbers = np.where(lacking, 2, scores < at_least).astype(np.int64)
        self.truth = _CLASSES[numbers]
        # A forest of indicators splits as one of classes, and votes on all of them even if some do not occur.
        self._forest = Forest(features, np.eye(len(_CLASSES))[numbers], _TREES)
        self._near = cKDTree(features[~lacking] / process.kernel.lengths)
        self._near_fails = numbers[~lacking] == 1
        votes = self._forest.held_out
        confidence, own = np.zeros(len(points)), np.full(len(points), -1)
        confidence[~lacking], own[~lacking] = process.held_out(), np.arange(self._near.n)
        inputs = self._inputs(confidence, votes, features, own)
        # One made-up failure and pass, at even odds, keep the regression defined.
        self._weights = LogisticRegression().fit(
            np.concatenate([inputs[~lacking], np.zeros((2, inputs.shape[1]))]), np.append(numbers[~lacking], [0, 1])
        )
        likely = self._probabilities(inputs, votes)
        self._least = least_probability(likely[explored], numbers[explored])
        self.held_out = self._called(likely)

    def calls(self, features: Floats, seen: Floats) -> NDArray[np.str_]:
        """Return the verdicts on points, (n,) of `Call`, from their (n, k) features and what the process has seen of them."""
        mean, deviation = self._process.predict(seen)
        votes = self._forest.predict(features)
        confidence = mean / np.hypot(deviation, np.sqrt(self._process.kernel.noise))
        return self._called(self._probabilities(self._inputs(confidence, votes, features, np.array([-1])), votes))

    def _inputs(self, confidence: Floats, votes: Floats, features: Floats, own: NDArray[np.int64]) -> Floats:
        """Return the inputs of the regression, (n, 3): μ / σ, and the log odds of the votes and of the nearest points.

        Args:
            confidence: (n,) μ / σ.
            votes: (n, 3) of the forest.
            features: (n, k).
            own: (n,) or (1,) number of each point among the defined ones, which does not count; -1 if it has none.
        """
        nearest = self._near.query(features / self._process.kernel.lengths, _NEAREST + 1)[1]
        others = np.argsort(nearest == own[:, None], axis=1, kind="stable")[:, :_NEAREST]
        failing = self._near_fails[np.take_along_axis(nearest, others, axis=1)].sum(axis=1)
        odds = [
            np.log((passes + 0.5) / (fails + 0.5))
            for passes, fails in ((_TREES * votes[:, 0], _TREES * votes[:, 1]), (_NEAREST - failing, failing))
        ]
        return np.column_stack([np.clip(confidence, -_SUREST, _SUREST), *odds])

    def _probabilities(self, inputs: Floats, votes: Floats) -> Floats:
        undefined = votes[:, 2:]
        return np.column_stack([self._weights.predict_proba(inputs) * (1 - undefined), undefined])

    def _called(self, probabilities: Floats) -> NDArray[np.str_]:
        sure = probabilities.max(axis=1) >= self._least
        return np.where(sure, _CLASSES[probabilities.argmax(axis=1)], Call.NOT_KNOWN.value)


def least_probability(probabilities: Floats, numbers: NDArray[np.int64]) -> float:
    """Return the least probability of a call at which at most a share `WRONG` is wrong; infinite if there is none."""
    order = np.argsort(-probabilities.max(axis=1), kind="stable")
    likely, wrong = probabilities.max(axis=1)[order], (probabilities.argmax(axis=1) != numbers)[order]
    called, errors = np.arange(1, len(order) + 1), np.cumsum(wrong)
    bound = highest_share(errors, called, CONFIDENCE)
    complete = np.append(likely[1:] < likely[:-1], True)  # calls of equal probability count together
    return float(likely[complete & (bound <= WRONG)].min(initial=np.inf))


def _share(of: NDArray[np.bool_]) -> float:
    return float(of.mean()) if len(of) else float("nan")
