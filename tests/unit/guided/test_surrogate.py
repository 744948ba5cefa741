"""The cheap model of scores, against functions that it does not see."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from valerie.guided.surrogate import Surrogate, defined_probability, margins

Floats = np.ndarray


def cube(seed: int, count: int, dimensions: int = 4) -> Floats:
    return np.random.default_rng(seed).random((count, dimensions))


def fitted(margin: Floats, points: Floats) -> Surrogate:
    return Surrogate(points, margins(expit(margin), 0.5))


def curved(points: Floats) -> Floats:
    """Margins of -40 to 10; a tenth is negative, and most are clipped on one side or the other."""
    x, y = points[:, 0] - 0.5, points[:, 1] - 0.5
    return 9 - 60 * x * y - 40 * y**2 + 20 * x


def test_a_quadratic_trend_is_known_beyond_the_range_of_scores() -> None:
    points, others = cube(1, 400), cube(2, 5000)
    true = curved(others)
    assert np.mean(np.abs(curved(points)) > 5.8) > 0.4, "clipped"
    predicted = fitted(curved(points), points).predict(others)
    assert np.abs(predicted - true)[np.abs(true) < 20].max() < 1.0
    assert np.mean((predicted < 0) != (true < 0)) < 0.002


def test_steps_and_choices_are_known_by_the_trees() -> None:
    def stepped(points: Floats) -> Floats:
        return np.where((points[:, 0] > 0.4) & (points[:, 1] > 0.7), -2.0, 2.0) + points[:, 2]

    others = cube(2, 5000)
    predicted = fitted(stepped(cube(1, 800)), cube(1, 800)).predict(others)
    assert np.mean((predicted < 0) != (stepped(others) < 0)) < 0.02


def test_scores_that_are_all_alike_or_have_two_values_are_no_error() -> None:
    points = cube(1, 60)
    assert np.allclose(fitted(np.full(60, 1.5), points).predict(cube(2, 50)), 1.5)
    two = np.where(points[:, 0] < 0.5, -9.0, 9.0)
    assert np.mean((fitted(two, points).predict(points) < 0) == (two < 0)) > 0.9


def test_the_probability_of_a_score_is_low_where_scores_are_undefined() -> None:
    points, others = cube(1, 500), cube(2, 1000)
    assert (defined_probability(points, np.ones(500, np.bool_), others) == 1).all()
    probability = defined_probability(points, points[:, 3] < 0.8, others)
    assert probability[others[:, 3] > 0.82].max() < 0.2
    assert probability[others[:, 3] < 0.78].min() > 0.8
