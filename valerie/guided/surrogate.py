"""A cheap model of scores, fitted to the evaluated points.

Margins are logits of scores. Their trend is a quadratic response surface (Box and Wilson 1951,
doi:10.1111/j.2517-6161.1951.tb00067.x); boosted trees model what it leaves: steps, choices and bends.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit, ndtr

from valerie.guided.strategy import Scores
from valerie.parameters.samplers import UnitPoints
from valerie.statistics.threads import one_thread

#: Maps (n, dimensions) points to (n, k) numbers that cost little, such as distances.
Covariates = Callable[[UnitPoints], NDArray[np.float64]]
#: Scores are clipped to this range before the logit is taken.
CLIPPED: Final = (0.003, 0.997)
#: Smallest standard deviation of a prediction, in logits.
SMALLEST_ERROR: Final = 0.15
#: Fewest points for a fit.
LEAST_POINTS: Final = 20
_FOLDS: Final = 5
#: Ridge penalties to choose from, relative to the number of points.
_PENALTIES: Final = np.logspace(-5, 1, 7)
#: Largest number of times that the trend is fitted, each without the censored margins that the last trend exceeds.
_REFITS: Final = 8
_TREES: Final = {
    "max_iter": 100,
    "learning_rate": 0.1,
    "max_leaf_nodes": 8,
    "min_samples_leaf": 5,
    "early_stopping": False,
}


def margins(scores: Scores, at_least: float) -> NDArray[np.float64]:
    """Return the margins of scores in [0, 1] over ``at_least``, in logits; negative for failures."""
    return np.asarray(logit(np.clip(scores, *CLIPPED)) - logit(np.clip(at_least, *CLIPPED)))


class Surrogate:
    """Predictions of margins.

    Since scores are clipped, the lowest and the highest margin are censored: true ones may lie beyond, and a trend that does is
    no error.

    Args:
        points: (n, dimensions), n ≥ `LEAST_POINTS`.
        margins: (n,) from `margins`.
    """

    @one_thread()
    def __init__(self, points: UnitPoints, margins: NDArray[np.float64]) -> None:
        from sklearn.ensemble import HistGradientBoostingRegressor

        self._trend = _Trend(points, margins)
        self._trees = HistGradientBoostingRegressor(**_TREES).fit(points, self._trend.rest)

    @one_thread()
    def predict(self, points: UnitPoints) -> NDArray[np.float64]:
        """Return the predicted margin of each point, (n,)."""
        return np.asarray(self._trees.predict(points), np.float64) + self._trend.predict(points)


class _Trend:
    """A quadratic response surface; ``rest``, (n,), is what it leaves of the margins that are not beyond."""

    def __init__(self, points: UnitPoints, margins: NDArray[np.float64]) -> None:
        from sklearn.linear_model import Ridge, RidgeCV
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import PolynomialFeatures, StandardScaler

        self._terms = make_pipeline(PolynomialFeatures(2, include_bias=False), StandardScaler())
        terms = self._terms.fit_transform(points)
        self._surface = Ridge(RidgeCV(_PENALTIES * len(points)).fit(terms, margins).alpha_)
        lowest, highest = margins == margins.min(), margins == margins.max()
        beyond = np.zeros(len(points), np.bool_)
        for _ in range(_REFITS):
            rest = margins - self._surface.fit(terms[~beyond], margins[~beyond]).predict(terms)
            before, beyond = beyond, (lowest & (rest > 0)) | (highest & (rest < 0))
            if np.array_equal(before, beyond) or np.count_nonzero(~beyond) < LEAST_POINTS:
                break
        self.rest = np.where(beyond, 0.0, rest)

    def predict(self, points: UnitPoints) -> NDArray[np.float64]:
        return np.asarray(self._surface.predict(self._terms.transform(points)), np.float64)


@one_thread()
def defined_probability(points: UnitPoints, defined: NDArray[np.bool_], candidates: UnitPoints) -> NDArray[np.float64]:
    """Return the probability of each candidate, (m,), that its score is defined.

    Args:
        points: (n, dimensions) evaluated points.
        defined: (n,) True where the score is defined.
        candidates: (m, dimensions).
    """
    from sklearn.ensemble import HistGradientBoostingClassifier

    if defined.all():
        return np.ones(len(candidates))
    trees = HistGradientBoostingClassifier(**_TREES).fit(points, defined)
    return np.asarray(trees.predict_proba(candidates)[:, 1], np.float64)


def held_out(points: UnitPoints, margins: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return predictions, (n,), each by a surrogate that was not fitted to the point: five folds of every fifth point."""
    folds = np.arange(len(points)) % _FOLDS
    predicted = np.empty(len(points))
    for fold in range(_FOLDS):
        tested = folds == fold
        predicted[tested] = Surrogate(points[~tested], margins[~tested]).predict(points[tested])
    return predicted


def prediction_error(margins: NDArray[np.float64], predicted: NDArray[np.float64]) -> float:
    """Return the root mean square residual of the third with the lowest predictions, which contains the failures."""
    lowest = np.argsort(predicted, kind="stable")[: max(len(predicted) // 3, 1)]
    return max(SMALLEST_ERROR, float(np.sqrt(np.mean((margins - predicted)[lowest] ** 2))))


def failure_probability(predicted: NDArray[np.float64], error: float) -> NDArray[np.float64]:
    """Return Φ(−m/σ), (n,): the probability that a margin is negative."""
    return np.asarray(ndtr(-predicted / error))
