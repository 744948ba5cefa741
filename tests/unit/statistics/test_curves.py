"""Curves against scikit-learn's isotonic regression, and bands on planted truth."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit
from sklearn.isotonic import IsotonicRegression

from valerie.errors import InvalidInput
from valerie.statistics.curves import GRID, Shape, contradicted_bins, departure, fit_curve, proven_changes


def scores(curve, places, seed, rows=6):
    """Rows of a place are alike; each sees its own x in 0…40."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, 40, (places, rows))
    noise = 0.08 * rng.standard_normal((places, 1)) + 0.08 * rng.standard_normal((places, rows))
    return x.ravel(), np.clip(curve(x) + noise, 0, 1).ravel(), np.repeat(np.arange(places), rows)


def sigmoid(x):
    return 0.1 + 0.8 * expit((22 - x) / 3)


def cliff(x):
    return np.where(x < 22, 0.6, 0.2)


def hump(x):
    return 0.2 + 0.6 * np.exp(-(((x - 20) / 6) ** 2))


def test_a_falling_curve_is_the_isotonic_regression_of_its_bins():
    x, values, places = scores(sigmoid, 100, 0)
    curve = fit_curve(x, values, places, seed=0)
    oracle = IsotonicRegression(increasing=False).fit(curve.bins.centre, curve.bins.mean, sample_weight=curve.bins.rows)
    assert curve.shape is Shape.FALLING
    inside = (np.array(curve.x) >= curve.bins.centre[0]) & (np.array(curve.x) <= curve.bins.centre[-1])
    np.testing.assert_allclose(np.array(curve.y)[inside], oracle.predict(curve.x)[inside], atol=1e-9)
    assert (np.diff(curve.y) <= 1e-12).all()


def test_the_bins_are_averages_of_their_rows():
    x, values, places = scores(sigmoid, 60, 1)
    values[5] = np.nan
    curve = fit_curve(x, values, places, seed=0)
    for low, high, mean, rows in zip(curve.bins.low, curve.bins.high, curve.bins.mean, curve.bins.rows, strict=True):
        member = (x >= low) & (x <= high) & np.isfinite(values)
        assert rows == member.sum()
        assert mean == pytest.approx(values[member].mean())
    assert (curve.rows, curve.undefined, curve.places) == (359, 1, 60)
    assert len(curve.x) == GRID


@pytest.mark.parametrize("level", [0.0, 0.004, 0.5, 0.996, 1.0])
def test_curve_and_band_stay_between_0_and_1(level):
    x, values, places = scores(lambda x: np.full_like(x, level), 20, 2)
    curve = fit_curve(x, values, places, seed=0)
    assert 0 <= min(curve.low) <= max(curve.high) <= 1
    assert all(low <= y <= high for low, y, high in zip(curve.low, curve.y, curve.high, strict=True))


def test_where_bins_drop_from_60_to_20_the_curve_does_not_fall_to_0():
    x, values, places = scores(cliff, 60, 3)
    curve = fit_curve(x, values, places, seed=0)
    at = np.array(curve.x)
    assert np.array(curve.y)[at < 18] == pytest.approx(0.6, abs=0.08)
    assert np.array(curve.y)[at > 27] == pytest.approx(0.2, abs=0.08)


def test_a_hump_is_neither_level_nor_monotone():
    curve = fit_curve(*scores(hump, 60, 4), seed=0)
    assert curve.shape is Shape.FREE
    assert set(curve.y) == set(curve.bins.mean)


def test_nothing_but_noise_is_a_level():
    curves = [fit_curve(*scores(lambda x: np.full_like(x, 0.6), 30, seed), seed=seed) for seed in range(20)]
    assert sum(curve.shape is Shape.LEVEL for curve in curves) >= 16
    assert np.ptp(next(c.y for c in curves if c.shape is Shape.LEVEL)) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("truth", [lambda x: np.full_like(x, 0.6), lambda x: 0.85 - 0.012 * x, sigmoid, cliff])
def test_the_band_holds_the_whole_true_curve(truth):
    misses, runs = 0, 100
    for seed in range(runs):
        curve = fit_curve(*scores(truth, 48, seed), seed=seed)
        at, low, high = np.array(curve.x), np.array(curve.low), np.array(curve.high)
        # A free curve speaks of averages over its bins; the cliff lies inside of one.
        apart = np.abs(at - 22) > (4 if curve.shape is Shape.FREE else 0)
        true = truth(at)
        misses += bool((((true < low - 1e-9) | (true > high + 1e-9)) & apart).any())
    assert stats.binomtest(misses, runs, 0.05, alternative="greater").pvalue > 1e-3


def test_a_polynomial_that_falls_to_0_is_contradicted_by_its_bins():
    x, values, places = scores(cliff, 60, 5)
    cubic = np.clip(np.polyval(np.polyfit(x, values, 1), x) - 0.3 * (x > 30), 0, 1)
    assert contradicted_bins(cubic, x, values, places)
    assert contradicted_bins(cliff(x), x, values, places) == ()


def test_the_fitted_curve_is_contradicted_by_no_bin():
    for seed in range(10):
        for truth in (sigmoid, cliff, hump):
            x, values, places = scores(truth, 48, seed)
            curve = fit_curve(x, values, places, seed=0)
            if curve.shape is not Shape.FREE:
                assert contradicted_bins(np.interp(x, curve.x, curve.y), x, values, places, seed=0) == ()


def test_rows_of_few_places_make_no_narrow_band():
    rng = np.random.default_rng(6)
    x, places = rng.uniform(0, 40, 6000), np.repeat(np.arange(6), 1000)
    values = np.clip(0.5 + 0.3 * rng.standard_normal(6)[places] + 0.01 * rng.standard_normal(6000), 0, 1)
    curve = fit_curve(x, values, places, seed=0)
    assert np.mean(np.array(curve.high) - np.array(curve.low)) > 0.3


def test_places_are_put_into_groups_without_changing_the_width():
    x, values, _ = scores(lambda x: np.full_like(x, 0.6), 3000, 7, rows=1)
    curve = fit_curve(x, values, np.arange(3000), seed=0)
    middle = np.array(curve.high)[GRID // 2] - np.array(curve.low)[GRID // 2]
    # Half of the rows on each side, joint over all averages: between 2 and 4 standard errors each way.
    error = values.std() / np.sqrt(1500)
    assert 2 * 2 * error < middle < 2 * 5 * error
    assert curve.places == 3000


def test_one_x_or_one_place_gives_no_curve():
    rng = np.random.default_rng(8)
    assert fit_curve(np.ones(60), rng.random(60), np.arange(60), seed=0) is None
    assert fit_curve(rng.random(60), rng.random(60), np.zeros(60, np.int64), seed=0) is None
    assert fit_curve([], [], np.zeros(0, np.int64), seed=0) is None


def test_bad_input_is_refused_by_name():
    with pytest.raises(InvalidInput, match=r"values: has to lie between 0 and 1; got -0.2"):
        fit_curve([1.0, 2.0], [0.5, -0.2], [0, 1], seed=0)
    with pytest.raises(InvalidInput, match="length"):
        fit_curve([1.0, 2.0], [0.5], [0], seed=0)


def test_a_departure_holds_the_true_one_in_nearly_every_run():
    """Scores are level up to 0.4 and then fall by 1 per unit: they are 0.1 lower from 0.5 on."""
    generator, held, known = np.random.default_rng(5), 0, 0
    for seed in range(40):
        places = np.repeat(np.arange(150), 6)
        x = generator.random(900)
        noise = 0.05 * generator.standard_normal(150)[places] + 0.05 * generator.standard_normal(900)
        curve = fit_curve(x, np.clip(0.8 - np.maximum(x - 0.4, 0) + noise, 0, 1), places, seed=seed)
        assert curve is not None
        left = departure(curve, 0.1)
        known += left.at_latest is not None
        held += (left.not_before or 0.0) <= 0.5 <= (left.at_latest or 1.0)
    assert held >= 38
    assert known >= 38


def test_a_level_is_never_left():
    places = np.repeat(np.arange(100), 4)
    curve = fit_curve(np.random.default_rng(1).random(400), np.full(400, 0.5), places, seed=0)
    assert curve is not None
    assert departure(curve, 0.1).estimate is None
    assert departure(curve, 0.1).at_latest is None


def test_places_that_choose_the_shape_have_no_part_in_curve_and_band():
    x, values, places = scores(sigmoid, 100, 3)
    choosing = places % 2 == 0
    curve = fit_curve(x, values, places, seed=0, choosing=choosing)
    other = fit_curve(x, np.where(choosing, 1 - values, values), places, seed=0, choosing=choosing)
    assert (curve.shape, curve.places) == (Shape.FALLING, 50)
    # Places that rise choose a rising curve, which the places that fall contradict.
    assert other.shape is Shape.FREE
    assert other.bins == curve.bins


def test_a_fall_is_proven_where_the_data_fall_and_nothing_rises():
    x, values, places = scores(sigmoid, 60, 4)
    changes = proven_changes(x, values, places, seed=0)
    assert (changes.falls, changes.rises) == (True, False)
    ordered = np.argsort(x)
    assert changes.difference == pytest.approx(values[ordered[-120:]].mean() - values[ordered[:120]].mean())
    assert changes.low < changes.difference < changes.high < 0
    mirrored = proven_changes(-x, values, places, seed=0)
    assert (mirrored.falls, mirrored.rises) == (False, True)
    assert proven_changes(x[:12], values[:12], places[:12], seed=0) is None
    x, values, places = scores(lambda x: np.full_like(x, 0.5), 200, 5)
    level = proven_changes(x, values, places, seed=0)
    assert (level.falls, level.rises) == (False, False)
    assert level.most < 0.2
