"""The process of margins, against scikit-learn's."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from valerie.guided.process import Kernel, Process

KERNEL = Kernel(2.0, 0.1, np.array([0.5, 1.0, 3.0]))
PEER = ConstantKernel(2.0) * Matern(KERNEL.lengths, nu=2.5) + WhiteKernel(0.1)
POINTS = np.random.default_rng(9).random((60, 3))
VALUES = 3 + np.sin(6 * POINTS[:, 0]) + POINTS[:, 1] ** 2 + 0.2 * np.random.default_rng(8).normal(size=60)


def peer(rows: np.ndarray) -> GaussianProcessRegressor:
    return GaussianProcessRegressor(PEER, optimizer=None).fit(POINTS[rows], VALUES[rows] - VALUES.mean())


def test_predictions_are_those_of_scikit_learn() -> None:
    asked = np.random.default_rng(7).random((20, 3))
    process = Process(KERNEL, POINTS, VALUES)
    model = peer(np.arange(60))
    mean, covariance = model.predict(asked, return_cov=True)
    covariances = process.covariance(asked)
    seen = process.seen(covariances)
    assert process.mean(covariances) == pytest.approx(mean + VALUES.mean(), rel=1e-6)
    assert process.predict(seen)[0] == pytest.approx(mean + VALUES.mean(), rel=1e-6)
    assert process.predict(seen)[1] ** 2 == pytest.approx(np.diag(covariance) - 0.1, rel=1e-5)
    assert KERNEL(asked, asked) - seen.T @ seen == pytest.approx(covariance - 0.1 * np.eye(20), abs=1e-7)


def test_a_held_out_prediction_is_that_of_a_process_without_the_point() -> None:
    held_out = Process(KERNEL, POINTS, VALUES).held_out()
    for row in (0, 17, 39):
        mean, deviation = peer(np.arange(60) != row).predict(POINTS[row : row + 1], return_std=True)
        assert held_out[row] == pytest.approx((mean[0] + VALUES.mean()) / deviation[0], rel=1e-6)


def test_an_extended_process_is_one_of_all_points() -> None:
    asked = np.random.default_rng(7).random((20, 3))
    before = Process(KERNEL, POINTS[:40], VALUES[:40])
    extended = Process(KERNEL, POINTS, VALUES, before)
    whole = Process(KERNEL, POINTS, VALUES)
    first = whole.seen(whole.covariance(asked)[:40])
    assert first == pytest.approx(before.seen(before.covariance(asked)), rel=1e-9)
    assert (whole.deviation(first) > whole.deviation(whole.seen(whole.covariance(asked)))).all()
    seen = extended.seen(extended.covariance(asked, 40), first)
    expected = whole.seen(whole.covariance(asked))
    assert seen == pytest.approx(expected, rel=1e-9)
    for found, wanted in zip(extended.predict(seen), whole.predict(expected), strict=True):
        assert found == pytest.approx(wanted, rel=1e-9)
    assert extended.held_out() == pytest.approx(whole.held_out(), rel=1e-9)


@pytest.mark.parametrize("start", [None, Kernel(20.0, 1.0, np.array([0.3, 0.3]))])
def test_the_likeliest_kernel_is_as_likely_as_that_of_scikit_learn(start: Kernel | None) -> None:
    points = POINTS[:, :2]
    found = Kernel.likeliest(points, VALUES, start)
    kernel = ConstantKernel(4.0, (1e-2, 1e3)) * Matern([1.0, 1.0], (0.05, 30), nu=2.5) + WhiteKernel(0.05, (1e-4, 10))
    best = GaussianProcessRegressor(kernel).fit(points, VALUES - VALUES.mean())
    ours = np.log([found.variance, *found.lengths, found.noise])
    assert best.log_marginal_likelihood(ours) == pytest.approx(best.log_marginal_likelihood_value_, abs=0.02)
