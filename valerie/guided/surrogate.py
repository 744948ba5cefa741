"""A cheap model of scores, fitted to the evaluated points: boosted trees on the logit of the score."""

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


def margins(scores: Scores, at_least: float) -> NDArray[np.float64]:
    """Return the margins of scores in [0, 1] over ``at_least``, in logits; negative for failures."""
    return np.asarray(logit(np.clip(scores, *CLIPPED)) - logit(np.clip(at_least, *CLIPPED)))


class Surrogate:
    """Predictions of margins.

    Args:
        points: (n, dimensions), n ≥ `LEAST_POINTS`.
        margins: (n,) from `margins`.
    """

    @one_thread()
    def __init__(self, points: UnitPoints, margins: NDArray[np.float64]) -> None:
        from sklearn.ensemble import HistGradientBoostingRegressor

        self._trees = HistGradientBoostingRegressor(
            max_iter=100, learning_rate=0.1, max_leaf_nodes=8, min_samples_leaf=5, early_stopping=False
        ).fit(points, margins)

    @one_thread()
    def predict(self, points: UnitPoints) -> NDArray[np.float64]:
        """Return the predicted margin of each point, (n,)."""
        return np.asarray(self._trees.predict(points), np.float64)


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
