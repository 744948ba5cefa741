import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from valerie.analysis.intervals import Resampler
from valerie.analysis.regression import fit_curve


def noisy(law, n=400, noise=0.05, seed=0):
    generator = np.random.default_rng(seed)
    x = generator.uniform(15, 40, n)
    return x, law(x) + noise * generator.standard_normal(n), Resampler(np.arange(n), seed=0, resamples=500)


LAWS = {
    0: lambda x: 0.7 + 0 * x,
    1: lambda x: 1.2 - 0.02 * x,
    2: lambda x: 0.9 - 0.002 * (x - 25) ** 2,
    3: lambda x: 0.6 + 0.0004 * (x - 20) * (x - 27) * (x - 36),
}


@pytest.mark.parametrize("degree", sorted(LAWS))
def test_cross_validation_finds_the_degree_of_the_law(degree):
    x, y, resampler = noisy(LAWS[degree])
    curve = fit_curve(x, y, np.isfinite(x), resampler=resampler, seed=0)

    assert curve is not None
    assert curve.degree == degree


def test_the_curve_is_the_least_squares_polynomial_of_numpy():
    x, y, resampler = noisy(LAWS[3])
    curve = fit_curve(x, y, np.isfinite(x), resampler=resampler, seed=0)
    assert curve is not None
    oracle = Polynomial.fit(x, y, curve.degree)

    np.testing.assert_allclose(curve.y, oracle(np.array(curve.x)), atol=1e-9)
    np.testing.assert_allclose(
        Chebyshev(curve.coefficients, domain=curve.domain)(np.array(curve.x)), curve.y, atol=1e-9
    )
    assert curve.rmse == pytest.approx(np.sqrt(np.mean((y - oracle(x)) ** 2)), rel=1e-6)
    assert curve.domain == (x.min(), x.max())


def test_the_band_is_as_wide_as_theory_says():
    x, y, resampler = noisy(LAWS[1], n=800)
    curve = fit_curve(x, y, np.isfinite(x), resampler=resampler, seed=0)
    assert curve is not None
    centre = x.mean()
    spread = 0.05 * np.sqrt(1 / 800 + (np.array(curve.x) - centre) ** 2 / ((x - centre) ** 2).sum())
    width = np.array(curve.high) - np.array(curve.low)

    np.testing.assert_allclose(width, 2 * 1.96 * spread, rtol=0.25)


def test_the_band_nearly_always_contains_the_true_law():
    hits = []
    for seed in range(40):
        x, y, resampler = noisy(LAWS[2], n=150, seed=seed)
        curve = fit_curve(x, y, np.isfinite(x), resampler=resampler, seed=seed)
        assert curve is not None
        true = LAWS[2](np.array(curve.x))
        hits.append(np.mean((np.array(curve.low) <= true) & (true <= np.array(curve.high))))
    assert 0.88 <= np.mean(hits) <= 0.99


def test_repeated_rows_of_one_situation_do_not_narrow_the_band():
    x, y, resampler = noisy(LAWS[1], n=60)
    often = Resampler(np.repeat(np.arange(60), 9), seed=0, resamples=500)
    once = fit_curve(x, y, np.isfinite(x), resampler=resampler, seed=0)
    many = fit_curve(np.repeat(x, 9), np.repeat(y, 9), np.ones(540, bool), resampler=often, seed=0)

    assert once is not None
    assert many is not None
    assert many.n == 540
    assert many.situations == 60
    np.testing.assert_allclose(many.high, once.high, atol=1e-9)


def test_rows_with_gaps_are_left_out():
    x, y, resampler = noisy(LAWS[1])
    y[::3] = np.nan
    curve = fit_curve(x, y, np.ones(400, bool), resampler=resampler, seed=0)

    assert curve is not None
    assert curve.n == np.isfinite(y).sum()


def test_equal_seeds_give_equal_curves():
    x, y, resampler = noisy(LAWS[3])
    rows = np.isfinite(x)

    assert fit_curve(x, y, rows, resampler=resampler, seed=4) == fit_curve(x, y, rows, resampler=resampler, seed=4)


def test_a_single_x_has_no_curve():
    resampler = Resampler(np.arange(50), seed=0)
    assert fit_curve(np.full(50, 20.0), np.linspace(0, 1, 50), np.ones(50, bool), resampler=resampler, seed=0) is None


def test_few_situations_have_no_curve():
    x = np.arange(5.0)
    assert fit_curve(x, x / 5, x >= 0, resampler=Resampler(np.arange(5), seed=0), seed=0) is None


def test_two_values_of_x_have_at_most_a_line():
    x = np.tile([20.0, 30.0], 30)
    y = np.where(x > 25, 0.4, 0.8) + np.random.default_rng(0).normal(0, 0.02, 60)
    curve = fit_curve(x, y, x > 0, resampler=Resampler(np.arange(60), seed=0), seed=0)

    assert curve is not None
    assert curve.degree == 1
    assert (curve.y[0], curve.y[-1]) == pytest.approx((y[x < 25].mean(), y[x > 25].mean()))
