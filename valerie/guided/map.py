"""A map of the boundary between pass and fail: pass, fail, undefined, or not known.

A Gaussian process (Matérn 5/2, one length scale per parameter) is fitted to the margins. A quarter of each batch explores
with scrambled Sobol' points. The others are the points of a pool where the process is least sure of the verdict, with the
largest 1.96 σ − |μ| (straddle heuristic: Bryan and others 2005, *Advances in Neural Information Processing Systems* 18);
each choice lowers σ around it before the next.

The process is tested: every point was predicted before its score was known. The map gives a verdict where at most a share
`WRONG` of such calls was wrong at the same |μ| / σ (isotonic regression); elsewhere it says "not known". Boosted trees
predict where scores are undefined.
"""

from __future__ import annotations

import warnings
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

Floats = NDArray[np.float64]

#: Share of a batch that explores.
EXPLORING: Final = 0.25
#: Exploring points before the first fit.
FIRST: Final = 64
#: Largest share of wrong calls where the map gives a verdict.
WRONG: Final = 0.05
#: Fewest calls for estimating that share.
TESTED: Final = 30
#: Most points for a fit of the length scales.
FITTED: Final = 300
_POOL: Final = 2_000
_DOUBTFUL: Final = 400
_REFERENCE: Final = 4_096


class Call(StrEnum):
    """The map's verdict on a point."""

    PASS = "pass"  # noqa: S105  not a password
    FAIL = "fail"
    UNDEFINED = "undefined"
    NOT_KNOWN = "not known"


@dataclass(frozen=True, slots=True)
class Boundary(Result):
    """The map of the boundary so far.

    Attributes:
        passing, failing, undefined, not_known: shares of the operational domain.
        wrong: share of wrong calls among points that were predicted before their scores were told and for which the map
            now gives a verdict; NaN without any.
        tested: number of these.
        evaluations: number of all points.
        nearest: (k, dimensions) evaluated points nearest to the boundary.
    """

    passing: float
    failing: float
    undefined: float
    not_known: float
    wrong: float
    tested: int
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
        self._predicted: list[Floats] = []
        #: (n,) μ / σ as predicted before the score was told; NaN without a prediction.
        self._confidence: Floats = np.empty(0)
        self._model: _Model | None = None
        self._lengths: tuple[int, Any] = (0, None)

    def ask(self, count: int) -> Proposal:
        """Return the next batch."""
        rng = np.random.default_rng([self.seed, 1, self._asked])
        self._asked += 1
        model = self._model
        exploring = count if model is None else max(int(EXPLORING * count), 1)
        points = self._exploration.take(exploring)
        doubtful = np.empty((0, self.domain.dimensions))
        if model is not None and exploring < count:
            doubtful = self._doubtful(model, rng, count - exploring)
            points = np.concatenate([points, doubtful])
        self._predicted.append(np.full(len(points), np.nan) if model is None else model.confidence(points))
        numbers = {"scored": len(self._scores), "exploring": exploring, "doubtful": len(doubtful)}
        return self._open.add(points, Reason(Why.BORDER, numbers))

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, not one score for each, or a score outside 0…1.
        """
        values = self._open.close(points, scores)
        self._confidence = np.concatenate([self._confidence, self._predicted.pop(0)])
        self._points = np.concatenate([self._points, points])
        self._scores = np.concatenate([self._scores, values])
        if np.count_nonzero(~np.isnan(self._scores)) >= FIRST:
            self._model = self._fitted()

    def calls(self, points: UnitPoints) -> NDArray[np.str_]:
        """Return the verdicts on points, (n,) of `Call`."""
        calls = np.full(len(points), Call.NOT_KNOWN.value, dtype="<U9")
        if self._model is None:
            return calls
        confidence = self._model.confidence(points)
        known = self._error(confidence) <= WRONG
        calls[known & (confidence >= 0)] = Call.PASS
        calls[known & (confidence < 0)] = Call.FAIL
        calls[self._undefined(points)] = Call.UNDEFINED
        return calls

    @property
    def result(self) -> Boundary | None:
        """The map so far; None before the first fit."""
        if self._model is None:
            return None
        reference = self.domain.draw(np.random.default_rng([self.seed, 2]), _REFERENCE)
        calls = self.calls(reference)
        shares = {call: float(np.mean(calls == call)) for call in Call}
        tested = ~np.isnan(self._confidence) & ~np.isnan(self._scores)
        tested[tested] = self._error(self._confidence[tested]) <= WRONG
        misses = (self._confidence[tested] < 0) != (self._scores[tested] < self.at_least)
        wrong = float(misses.mean()) if len(misses) else float("nan")
        nearest = np.argsort(np.abs(np.where(np.isnan(self._scores), np.inf, self._scores - self.at_least)))[:5]
        return Boundary(
            shares[Call.PASS],
            shares[Call.FAIL],
            shares[Call.UNDEFINED],
            shares[Call.NOT_KNOWN],
            wrong,
            len(misses),
            len(self._scores),
            self._points[nearest],
        )

    def _doubtful(self, model: _Model, rng: np.random.Generator, count: int) -> UnitPoints:
        pool = self.domain.draw(rng, max(_POOL, 4 * count))
        mean, deviation = model.predict(pool)
        best = np.argsort(np.abs(mean) - 1.96 * deviation, kind="stable")[: max(_DOUBTFUL, 2 * count)]
        pool, mean = pool[best], mean[best]
        covariance = model.covariance(pool)
        left = np.ones(len(pool), np.bool_)
        chosen: list[int] = []
        for _ in range(count):
            deviation = np.sqrt(np.maximum(np.diag(covariance), 0))
            row = int(np.argmax(np.where(left, 1.96 * deviation - np.abs(mean), -np.inf)))
            chosen.append(row)
            left[row] = False
            column = covariance[:, row]
            covariance = covariance - np.outer(column, column) / (column[row] + model.noise)
        return pool[chosen]

    def _fitted(self) -> _Model:
        """Return the process for all scores so far; length scales are refitted each time the points have grown by half."""
        defined = ~np.isnan(self._scores)
        points, values = self.domain.features(self._points[defined]), margins(self._scores[defined], self.at_least)
        if len(points) >= 1.5 * self._lengths[0] and self._lengths[0] < FITTED:
            self._lengths = len(points), _Model.lengths(points[-FITTED:], values[-FITTED:], self._lengths[1])
        return _Model(self.domain, points, values, self._lengths[1])

    def _error(self, confidence: Floats) -> Floats:
        """Return the (n,) shares of wrong calls at these confidences; 1 with too few tested calls."""
        from sklearn.isotonic import IsotonicRegression

        tested = ~np.isnan(self._confidence) & ~np.isnan(self._scores)
        if np.count_nonzero(tested) < TESTED:
            return np.ones(len(confidence))
        told = self._confidence[tested]
        wrong = (told < 0) != (self._scores[tested] < self.at_least)
        curve = IsotonicRegression(increasing=False, out_of_bounds="clip").fit(np.abs(told), wrong.astype(np.float64))
        return np.asarray(curve.predict(np.abs(confidence)), np.float64)

    def _undefined(self, points: UnitPoints) -> NDArray[np.bool_]:
        from sklearn.ensemble import HistGradientBoostingClassifier

        lacking = np.isnan(self._scores)
        if not lacking.any():
            return np.zeros(len(points), np.bool_)
        trees = HistGradientBoostingClassifier(max_iter=50, max_leaf_nodes=8, min_samples_leaf=5, early_stopping=False)
        trees.fit(self.domain.features(self._points), lacking)
        return np.asarray(trees.predict(self.domain.features(points)), np.bool_)


class _Model:
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

    def confidence(self, points: UnitPoints) -> Floats:
        """Return μ / σ of points."""
        mean, deviation = self.predict(points)
        return mean / deviation
