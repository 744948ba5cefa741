"""A map of the boundary between pass and fail: pass, fail, undefined, or not known.

A Gaussian process (Matérn 5/2, one length scale per parameter) is fitted to the margins. Half of each batch explores
with scrambled Sobol' points. The others are the points of a pool where the process is least sure of the verdict, with the
largest 1.96 σ − |μ| (straddle heuristic: Bryan and others 2005, *Advances in Neural Information Processing Systems* 18);
each choice lowers σ around it before the next.

The calls need more than the process, since verdicts jump where a person is hidden, and since scores have noise. A random
forest of the classes pass, fail and undefined knows jumps, and a logistic regression of both models' held-out predictions
weighs them (stacking: Wolpert 1992, doi:10.1016/S0893-6080(05)80023-1). *Held-out* is leave-one-out for the process, out of
bag for the forest, so no point is predicted from its own score.

The map gives a verdict from the largest probability of a call down to where at most a share `WRONG` of the calls is wrong, by
the upper bound (`highest_share`) of the held-out calls of exploring points, which are
spread like the domain (selection with guaranteed risk: Geifman and El-Yaniv 2017, arXiv:1705.08500). Elsewhere it says "not
known".
"""

from __future__ import annotations

import warnings
from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

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
_REFERENCE: Final = 4_096
_TREES: Final = 200
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
        self._lengths: tuple[int, Any] = (0, None)
        self._reference: UnitPoints | None = None

    @one_thread()
    def ask(self, count: int) -> Proposal:
        """Return the next batch."""
        rng = np.random.default_rng([self.seed, 1, self._asked])
        self._asked += 1
        process = self._process
        exploring = count if process is None else max(int(EXPLORING * count), 1)
        points = self._exploration.take(exploring)
        doubtful = np.empty((0, self.domain.dimensions))
        if process is not None and exploring < count:
            doubtful = self._doubtful(process, rng, count - exploring)
            points = np.concatenate([points, doubtful])
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
            self._process = self._fitted()

    @one_thread()
    def calls(self, points: UnitPoints) -> NDArray[np.str_]:
        """Return the verdicts on points, (n,) of `Call`."""
        if self._process is None:
            return np.full(len(points), Call.NOT_KNOWN.value, dtype="<U9")
        return self._known().calls(points)

    @property
    def result(self) -> Boundary | None:
        """The map so far; None before the first fit."""
        if self._process is None:
            return None
        if self._reference is None:
            self._reference = self.domain.draw(np.random.default_rng([self.seed, 2]), _REFERENCE)
        calls = self.calls(self._reference)
        verdicts = self._known()
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
        pool = self.domain.draw(rng, max(_POOL, 4 * count))
        mean, deviation = process.predict(pool)
        best = np.argsort(np.abs(mean) - 1.96 * deviation, kind="stable")[: max(_DOUBTFUL, 2 * count)]
        pool, mean = pool[best], mean[best]
        covariance = process.covariance(pool)
        left = np.ones(len(pool), np.bool_)
        chosen: list[int] = []
        for _ in range(count):
            deviation = np.sqrt(np.maximum(np.diag(covariance), 0))
            row = int(np.argmax(np.where(left, 1.96 * deviation - np.abs(mean), -np.inf)))
            chosen.append(row)
            left[row] = False
            column = covariance[:, row]
            covariance = covariance - np.outer(column, column) / (column[row] + process.noise)
        return pool[chosen]

    def _fitted(self) -> Process:
        """Return the process for all scores so far; length scales are refitted each time the points have grown by half."""
        defined = ~np.isnan(self._scores)
        points, values = self.domain.features(self._points[defined]), margins(self._scores[defined], self.at_least)
        if len(points) >= 1.5 * self._lengths[0] and self._lengths[0] < FITTED:
            self._lengths = len(points), Process.lengths(points[-FITTED:], values[-FITTED:], self._lengths[1])
        return Process(self.domain, points, values, self._lengths[1])


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
        from sklearn.ensemble import RandomForestClassifier
        from sklearn.linear_model import LogisticRegression

        self._domain, self._process = domain, process
        lacking = np.isnan(scores)
        numbers = np.where(lacking, 2, scores < at_least).astype(np.int64)
        self.truth = _CLASSES[numbers]
        self._forest = RandomForestClassifier(
            _TREES, min_samples_leaf=2, max_features=None, oob_score=True, random_state=0
        ).fit(domain.features(points), numbers)
        votes = self._votes(self._forest.oob_decision_function_)
        confidence = np.zeros(len(points))
        confidence[~lacking] = process.held_out()
        inputs = _inputs(confidence, votes)
        # One made-up failure and pass, at even odds, keep the regression defined.
        self._weights = LogisticRegression().fit(
            np.concatenate([inputs[~lacking], np.zeros((2, 2))]), np.append(numbers[~lacking], [0, 1])
        )
        likely = self._probabilities(inputs, votes)
        self._least = least_probability(likely[explored], numbers[explored])
        self.held_out = self._called(likely)

    def calls(self, points: UnitPoints) -> NDArray[np.str_]:
        """Return the verdicts on points, (n,) of `Call`."""
        mean, deviation = self._process.predict(points)
        votes = self._votes(self._forest.predict_proba(self._domain.features(points)))
        confidence = mean / np.hypot(deviation, np.sqrt(self._process.noise))
        return self._called(self._probabilities(_inputs(confidence, votes), votes))

    def _votes(self, shares: Floats) -> Floats:
        votes = np.zeros((len(shares), len(_CLASSES)))
        votes[:, self._forest.classes_] = shares
        return votes

    def _probabilities(self, inputs: Floats, votes: Floats) -> Floats:
        undefined = votes[:, 2:]
        return np.column_stack([self._weights.predict_proba(inputs) * (1 - undefined), undefined])

    def _called(self, probabilities: Floats) -> NDArray[np.str_]:
        sure = probabilities.max(axis=1) >= self._least
        return np.where(sure, _CLASSES[probabilities.argmax(axis=1)], Call.NOT_KNOWN.value)


def _inputs(confidence: Floats, votes: Floats) -> Floats:
    """Return the inputs of the regression, (n, 2): μ / σ, and the log odds of the votes."""
    passing, failing = votes[:, 0] + 0.5 / _TREES, votes[:, 1] + 0.5 / _TREES
    return np.column_stack([np.clip(confidence, -_SUREST, _SUREST), np.log(passing / failing)])


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


class Process:
    """A Gaussian process with a given kernel."""

    def __init__(self, domain: Cube, features: Floats, values: Floats, kernel: Any) -> None:
        from sklearn.gaussian_process import GaussianProcessRegressor

        self._domain = domain
        self._middle = float(values.mean())
        self.noise = float(kernel.k2.noise_level)
        self._process = GaussianProcessRegressor(kernel, optimizer=None).fit(features, values - self._middle)

    @staticmethod
    def lengths(features: Floats, values: Floats, before: Any) -> Any:
        """Return the kernel with the largest likelihood, starting from the previous one."""
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

        kernel = before or ConstantKernel(4.0, (1e-2, 1e3)) * Matern(
            np.ones(features.shape[1]), (0.05, 30.0), nu=2.5
        ) + WhiteKernel(0.05, (1e-4, 10.0))
        with warnings.catch_warnings():  # length scales of parameters without effect end at their bound
            warnings.simplefilter("ignore", ConvergenceWarning)
            return GaussianProcessRegressor(kernel).fit(features, values - values.mean()).kernel_

    def predict(self, points: UnitPoints) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of the margins, without noise."""
        mean, deviation = self._process.predict(self._domain.features(points), return_std=True)
        return np.asarray(mean) + self._middle, np.sqrt(np.maximum(np.asarray(deviation) ** 2 - self.noise, 1e-12))

    def covariance(self, points: UnitPoints) -> Floats:
        """Return the covariance of the margins, without noise."""
        _, covariance = self._process.predict(self._domain.features(points), return_cov=True)
        return np.asarray(covariance) - self.noise * np.eye(len(points))

    def held_out(self) -> Floats:
        """Return μ / σ, (n,), of each point from all others (Rasmussen and Williams 2006, equations 5.12)."""
        from scipy.linalg import cho_solve

        process = self._process
        inverse = np.diag(cho_solve((process.L_, True), np.eye(len(process.alpha_))))
        mean = process.y_train_ + self._middle - process.alpha_ / inverse
        return np.asarray(mean * np.sqrt(inverse))
