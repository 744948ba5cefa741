import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from valerie.analysis.trends.regression import fit_polynomial


def noisy(law, n=400, noise=0.05, seed=0):
    generator = np.random.default_rng(seed)
    x = generator.uniform(15, 40, n)
    return x, np.clip(law(x) + noise * generator.standard_normal(n), 0, 1), np.arange(n)


LAWS = {
    0: lambda x: 0.7 + 0 * x,
    1: lambda x: 1.1 - 0.02 * x,
    2: lambda x: 0.9 - 0.002 * (x - 25) ** 2,
    3: lambda x: 0.6 + 0.0004 * (x - 20) * (x - 27) * (x - 36),
}


@pytest.mark.parametrize("degree", sorted(LAWS))
def test_cross_validation_finds_the_degree_of_the_law(degree):
    x, y, places = noisy(LAWS[degree])
    curve = fit_polynomial(x, y, places, seed=0)

    assert curve is not None
    assert curve.degree == degree


def test_the_curve_is_the_least_squares_polynomial_of_numpy():
    x, y, places = noisy(LAWS[3])
    curve = fit_polynomial(x, y, places, seed=0)
    assert curve is not None
    oracle = Polynomial.fit(x, y, curve.degree)

    np.testing.assert_allclose(curve.y, oracle(np.array(curve.x)), atol=1e-9)
    np.testing.assert_allclose(
        Chebyshev(curve.coefficients, domain=curve.domain)(np.array(curve.x)), curve.y, atol=1e-9
    )
    assert curve.rmse == pytest.approx(np.sqrt(np.mean((y - oracle(x)) ** 2)), rel=1e-6)
    assert curve.domain == (x.min(), x.max())


def test_repeated_rows_of_one_place_do_not_change_the_choice():
    x, y, places = noisy(LAWS[2], n=60)
    once, many = (fit_polynomial(np.repeat(x, k), np.repeat(y, k), np.repeat(places, k), seed=0) for k in (1, 9))

    assert once is not None
    assert many is not None
    assert (many.n, many.places) == (540, 60)
    assert many.degree == once.degree
    np.testing.assert_allclose(many.y, once.y, atol=1e-9)


def test_the_law_itself_is_not_contradicted_and_a_flat_line_through_a_cliff_is():
    x, y, places = noisy(LAWS[2])
    cliff = np.where(x < 30, 0.9, 0.2)
    fitted = fit_polynomial(x, y, places, seed=0)
    flat = fit_polynomial(x, cliff, places, seed=0, max_degree=0)

    assert fitted is not None
    assert flat is not None
    assert not fitted.contradicted
    assert flat.contradicted


def test_rows_with_gaps_are_left_out():
    x, y, places = noisy(LAWS[1])
    y[::3] = np.nan
    curve = fit_polynomial(x, y, places, seed=0)

    assert curve is not None
    assert curve.n == np.isfinite(y).sum()


def test_equal_seeds_give_equal_curves():
    x, y, places = noisy(LAWS[3])

    assert fit_polynomial(x, y, places, seed=4) == fit_polynomial(x, y, places, seed=4)


def test_a_single_x_has_no_curve():
    assert fit_polynomial(np.full(50, 20.0), np.linspace(0, 1, 50), np.arange(50), seed=0) is None


def test_few_places_have_no_polynomial():
    x = np.arange(15.0)
    assert fit_polynomial(x, x / 15, np.arange(15) % 5, seed=0) is None


def test_two_values_of_x_have_at_most_a_line():
    x = np.tile([20.0, 30.0], 30)
    y = np.where(x > 25, 0.4, 0.8) + np.random.default_rng(0).normal(0, 0.02, 60)
    curve = fit_polynomial(x, y, np.arange(60), seed=0)

    assert curve is not None
    assert curve.degree == 1
    assert (curve.y[0], curve.y[-1]) == pytest.approx((y[x < 25].mean(), y[x > 25].mean()))
