import numpy as np
import pytest

from valerie.statistics.calibration import calibration, quantile_shares


def test_the_error_is_the_weighted_distance_of_shares_from_probabilities():
    predicted = np.array([0.05, 0.05, 0.05, 0.05, 0.95, 0.95])
    happened = np.array([True, False, False, False, True, False])
    result = calibration(predicted, happened, np.arange(6))
    assert result.error == pytest.approx((4 * abs(0.25 - 0.05) + 2 * abs(0.5 - 0.95)) / 6)
    assert [(one.low, one.rows, one.observed) for one in result.bins] == [(0.0, 4, 0.25), (0.9, 2, 0.5)]


def test_chance_is_the_error_of_a_calibrated_model_and_grows_where_places_repeat_themselves():
    rng = np.random.default_rng(1)
    predicted = rng.uniform(0, 1, 400)
    happened = rng.uniform(0, 1, 400) < predicted
    alone = calibration(predicted, happened, np.arange(400))
    assert alone.error == pytest.approx(alone.chance, rel=0.4)
    repeated = calibration(np.repeat(predicted, 9), np.repeat(happened, 9), np.repeat(np.arange(400), 9))
    assert repeated.chance == pytest.approx(alone.chance)
    assert repeated.places == 400
    assert alone.places_for(alone.on_new_places / 2) == pytest.approx(1600, abs=1)


def test_a_true_distribution_has_its_levels_also_where_values_pile_up_and_a_shifted_one_has_not():
    rng = np.random.default_rng(2)
    values = np.clip(rng.uniform(-0.3, 1.4, 20_000), 0, 1)
    bounds, levels = np.array([0.01, 0.3, 0.6, 0.99]), (0.05, 0.25, 0.5, 0.75, 0.95)
    below = np.tile((bounds + 0.3) / 1.7, (len(values), 1))
    assert quantile_shares(below, bounds, values, levels) == pytest.approx(levels, abs=0.01)
    shifted = quantile_shares(below, bounds, np.clip(values + 0.3, 0, 1), levels)
    assert np.subtract(levels, shifted).min() > 0.02
