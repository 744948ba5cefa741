"""Blocked contrasts against scipy's tests and plain loops."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from valerie.errors import InvalidInput
from valerie.statistics.contrasts import Change, Contrast, Matching, contrasts, largest_flips
from valerie.statistics.observations import Observations, bin_codes, observe


def _grid(*sizes: int) -> list[NDArray[np.int64]]:
    return [axis.ravel() for axis in np.meshgrid(*map(np.arange, sizes), indexing="ij")]


def _only(observations: Observations, *changes: Change) -> Contrast:
    (contrast,) = contrasts(observations, only=[changes])
    return contrast


def test_a_main_effect_is_the_paired_t_test_of_the_places_means() -> None:
    place, sun, camera = _grid(9, 3, 2)
    values = np.random.default_rng(0).random(len(place))
    contrast = _only(observe(values, place, {"sun": sun, "camera": camera}), Change("sun", 0, 2))
    means = values.reshape(9, 3, 2).mean(axis=2)
    oracle = stats.ttest_rel(means[:, 2], means[:, 0])
    assert contrast.matching is Matching.BLOCKS
    assert (contrast.places, contrast.pairs, contrast.degrees) == (9, 18, 8)
    assert contrast.p_value == pytest.approx(oracle.pvalue, rel=1e-9)
    low, high = contrast.interval(0.9)
    assert low < oracle.confidence_interval(0.9).low < oracle.confidence_interval(0.9).high < high
    assert contrast.reversed.interval(0.9) == pytest.approx((-high, -low))


def test_with_rows_missing_a_difference_is_taken_only_where_both_sides_of_a_block_are_there() -> None:
    place, sun, camera = _grid(8, 2, 3)
    rng = np.random.default_rng(1)
    values = rng.random(len(place))
    values[rng.random(len(place)) < 0.25] = np.nan
    observations = observe(values, place, {"sun": sun, "camera": camera})
    contrast = _only(observations, Change("sun", 0, 1))
    table, means, pairs = values.reshape(8, 2, 3), [], 0
    for row in table:
        differences = [row[1, k] - row[0, k] for k in range(3) if np.isfinite(row[:, k]).all()]
        pairs += len(differences)
        means += [np.mean(differences)] if differences else []
    assert observations.undefined == np.count_nonzero(np.isnan(values))
    assert (contrast.pairs, contrast.places) == (pairs, len(means))
    assert contrast.estimate == pytest.approx(np.mean(means))
    assert contrast.p_value == pytest.approx(stats.ttest_1samp(means, 0).pvalue)


def test_an_interaction_is_the_difference_of_differences_within_blocks() -> None:
    place, sun, character, camera = _grid(7, 3, 2, 2)
    values = np.random.default_rng(2).random(len(place))
    observations = observe(values, place, {"sun": sun, "character": character, "camera": camera})
    contrast = _only(observations, Change("sun", 1, 2), Change("character", 0, 1))
    table = values.reshape(7, 3, 2, 2)
    effect = table[:, 2] - table[:, 1]
    doubled = (effect[:, 1] - effect[:, 0]).mean(axis=1)
    assert contrast.estimate == pytest.approx(doubled.mean())
    assert contrast.p_value == pytest.approx(stats.ttest_1samp(doubled, 0).pvalue)


def test_a_factor_of_places_is_compared_by_the_wider_of_pooled_and_welch_t() -> None:
    rng = np.random.default_rng(3)
    level = np.repeat([0, 1], [9, 6])
    for spread in (0.1, 1.0, 3.0):
        values = rng.normal(0, 1, 15) * np.where(level == 1, spread, 1)
        contrast = _only(observe(values, np.arange(15), {"y": level}), Change("y", 0, 1))
        sides = values[level == 1], values[level == 0]
        oracle = max(stats.ttest_ind(*sides, equal_var=equal).pvalue for equal in (True, False))
        assert contrast.p_value == pytest.approx(oracle)
        assert contrast.estimate == pytest.approx(sides[0].mean() - sides[1].mean())


def test_between_places_the_other_factor_of_places_is_held_equal() -> None:
    x, y = _grid(4, 5)
    values = 0.5 * x + 0.1 * y + np.random.default_rng(4).normal(0, 0.001, 20)
    contrast = _only(observe(values, np.arange(20), {"x": x, "y": y}), Change("y", 0, 4))
    # Without x in the model the error would be that of a spread of 0.5.
    assert contrast.estimate == pytest.approx(0.4, abs=0.005)
    assert contrast.error < 0.005
    assert (contrast.pairs, contrast.places, contrast.parameters) == (4, 20, 8)


def test_a_place_whose_hard_rows_are_missing_does_not_look_easy() -> None:
    place, camera = _grid(12, 3)
    far = (np.arange(12) >= 6).astype(np.int64)
    values = 0.9 - 0.4 * (camera == 2) + 0.001 * np.random.default_rng(13).standard_normal(36)
    values[(camera == 2) & (far[place] == 1) & (place != 6)] = np.nan
    contrast = _only(observe(values, place, {"camera": camera, "far": far[place]}), Change("far", 0, 1))
    assert contrast.estimate == pytest.approx(0, abs=0.002)


def test_the_effect_of_a_sun_that_depends_on_the_place_is_an_interaction() -> None:
    place, sun = _grid(12, 2)
    far = (np.arange(12) >= 6).astype(np.int64)
    values = np.random.default_rng(5).random(24) * 0.1 - 0.4 * (sun * far[place])
    contrast = _only(observe(values, place, {"sun": sun, "far": far[place]}), Change("sun", 0, 1), Change("far", 0, 1))
    differences = np.diff(values.reshape(12, 2)).ravel()
    assert contrast.estimate == pytest.approx(differences[6:].mean() - differences[:6].mean())
    assert contrast.p_value < 1e-6


def test_two_functions_are_compared_on_the_same_frames() -> None:
    place, camera, function = _grid(10, 3, 2)
    rng = np.random.default_rng(6)
    frame = rng.random((10, 3, 1)) + np.array([0.0, 0.02])
    values = (frame + rng.normal(0, 0.001, frame.shape)).ravel()
    contrast = _only(observe(values, place, {"camera": camera, "function": function}), Change("function", 0, 1))
    assert contrast.estimate == pytest.approx(0.02, abs=0.001)
    assert contrast.p_value < 1e-9


def test_every_two_levels_and_every_two_factors_are_compared() -> None:
    place, sun, character, camera = _grid(12, 4, 2, 3)
    factors = {"x": place // 4, "sun": sun, "character": character, "camera": camera}
    observations = observe(np.random.default_rng(7).random(len(place)), place, factors)
    assert len(contrasts(observations, interactions=False)) == 3 + 6 + 1 + 3
    within, doubles = 6 + 1 + 3, 6 * 1 + 6 * 3 + 1 * 3
    assert len(contrasts(observations)) == 3 + within + doubles + within * 3


def test_factors_drawn_for_each_row_are_compared_within_places() -> None:
    rng = np.random.default_rng(8)
    place = np.repeat(np.arange(40), 6)
    factors = {f"factor-{k}": rng.integers(0, 3, 240) for k in range(5)}
    values = rng.random(40)[place] * 10 + 0.5 * (factors["factor-0"] == 2) + rng.random(240) * 0.1
    contrast = _only(observe(values, place, factors), Change("factor-0", 0, 2))
    assert contrast.matching is Matching.PLACES
    assert contrast.estimate == pytest.approx(0.5, abs=0.05)


def test_places_that_all_agree_have_the_p_value_of_exchanging_levels() -> None:
    place, sun = _grid(6, 2)
    contrast = _only(observe(sun.astype(float), place, {"sun": sun}), Change("sun", 0, 1))
    assert (contrast.estimate, contrast.error) == (1.0, 0.0)
    assert contrast.p_value == pytest.approx(2 * 0.5**6)
    nothing = _only(observe(np.ones(12), place, {"sun": sun}), Change("sun", 0, 1))
    assert (nothing.estimate, nothing.p_value) == (0.0, 1.0)


def test_an_interval_allows_for_the_places_that_fail_where_none_of_those_seen_does() -> None:
    place, sun = _grid(12, 2)
    contrast = _only(observe(np.full(24, 0.9), place, {"sun": sun}), Change("sun", 0, 1))
    low, high = contrast.interval()
    # With this share of failing places, 12 seen ones hold none in one run of 40; such a place loses or gains 0.9.
    share = 1 - 0.025 ** (1 / 12)
    assert (low, high) == pytest.approx((-0.9 * share, 0.9 * share), rel=1e-6)
    many = _only(observe(np.full(2400, 0.9), np.arange(2400) // 2, {"sun": np.arange(2400) % 2}), Change("sun", 0, 1))
    assert many.interval()[1] < 0.003


def test_between_places_of_passes_and_failures_each_side_has_its_clopper_pearson_bound() -> None:
    level = np.repeat([0, 1], [20, 30])
    values = np.concatenate([np.arange(20) < 12, np.arange(30) < 6]).astype(float)
    contrast = _only(observe(values, np.arange(50), {"y": level}), Change("y", 0, 1))
    before, after = (stats.binomtest(k, n).proportion_ci() for k, n in ((12, 20), (6, 30)))
    down = np.hypot(0.2 - after.low, before.high - 0.6)
    up = np.hypot(after.high - 0.2, 0.6 - before.low)
    assert contrast.interval() == pytest.approx((-0.4 - down, -0.4 + up))
    low, high = contrast.interval()
    assert contrast.reversed.interval() == pytest.approx((-high, -low))


def test_with_as_many_places_as_said_the_interval_excludes_0() -> None:
    place, sun = _grid(8, 2)
    values = 0.5 + 0.1 * np.cos(place) - 0.1 * sun * (1 + np.sin(place))
    contrast = _only(observe(values, place, {"sun": sun}), Change("sun", 0, 1))
    needed = contrast.places_for_interval(0.95)
    assert needed is not None
    assert needed > 8
    times = -(-needed // 8)
    rows = [np.concatenate([one + 8 * k if one is place else one for k in range(times)]) for one in (place, sun)]
    repeated = _only(observe(np.tile(values, times), rows[0], {"sun": rows[1]}), Change("sun", 0, 1))
    assert contrast.interval()[1] > 0 > repeated.interval()[1]


def test_one_place_a_side_tells_nothing() -> None:
    contrast = _only(observe([0.2, 0.9, 0.5, 0.6], [0, 1, 2, 3], {"y": np.array([0, 1, 2, 2])}), Change("y", 0, 1))
    assert (contrast.degrees, contrast.p_value) == (0, 1.0)
    assert contrast.interval() == (-np.inf, np.inf)


@pytest.mark.parametrize("change", [Change("sun", 0, 1), Change("x", 1, 2)])
def test_the_largest_flips_are_rows_that_differ_in_the_change_alone(change: Change) -> None:
    x, y, sun, camera = _grid(3, 4, 2, 3)
    rng = np.random.default_rng(9)
    factors = {"x": x, "y": y, "sun": sun, "camera": camera}
    values = rng.random(len(x)) - 0.3 * (factors[change.factor] == change.after)
    values[rng.random(len(x)) < 0.1] = np.nan
    observations = observe(values, x * 4 + y, factors)
    contrast = _only(observations, change)
    flips = largest_flips(observations, contrast, 4)
    others = [name for name in factors if name != change.factor]
    drops = []
    for a, b in product(range(len(x)), repeat=2):
        equal = all(factors[name][a] == factors[name][b] for name in others)
        if equal and (factors[change.factor][a], factors[change.factor][b]) == (change.before, change.after):
            drops.append(values[a] - values[b])
    assert contrast.pairs == np.count_nonzero(np.isfinite(drops))
    assert contrast.estimate < 0
    np.testing.assert_allclose(
        values[flips[:, 0]] - values[flips[:, 1]], np.sort(np.array(drops)[np.isfinite(drops)])[:-5:-1]
    )


def test_the_largest_flips_of_an_interaction_are_fours() -> None:
    place, sun, character = _grid(5, 2, 2)
    values = np.random.default_rng(10).random(20)
    observations = observe(values, place, {"sun": sun, "character": character})
    contrast = _only(observations, Change("sun", 0, 1), Change("character", 0, 1))
    (four,) = largest_flips(observations, contrast, 1)
    assert list(zip(sun[four], character[four], strict=True)) == [(0, 0), (1, 0), (0, 1), (1, 1)]
    table = values.reshape(5, 2, 2)
    doubled = table[:, 1, 1] - table[:, 0, 1] - table[:, 1, 0] + table[:, 0, 0]
    sign = np.sign(contrast.estimate)
    assert values[four] @ [1, -1, -1, 1] * sign == pytest.approx((doubled * sign).max())


def test_rows_that_do_not_match_have_no_flips() -> None:
    rng = np.random.default_rng(11)
    factors = {f"factor-{k}": bin_codes(rng.random(60), 3) for k in range(6)}
    observations = observe(rng.random(60), np.arange(60), factors)
    contrast = _only(observations, Change("factor-0", 0, 1))
    assert contrast.pairs == 0
    assert largest_flips(observations, contrast).shape == (0, 2)


def test_codes_of_any_size_and_chosen_places_keep_their_names_and_rows() -> None:
    place, sun = _grid(4, 2)
    azimuth = np.array([140, 2_000_000_000])[sun]
    values = np.where(place == 0, np.nan, np.arange(8.0))
    observations = observe(values, place * 1000 - 7, {"azimuth": azimuth})
    half = observations.of_places(np.array([False, True, True]))
    assert half.rows.tolist() == [4, 5, 6, 7]
    contrast = _only(half, Change("azimuth", 140, 2_000_000_000))
    assert (contrast.estimate, contrast.places) == (1.0, 2)


def test_bins_hold_about_equally_many_and_equal_numbers_share_one() -> None:
    codes = bin_codes(np.random.default_rng(12).random(300), 3)
    assert np.bincount(codes).tolist() == [100, 100, 100]
    assert bin_codes([1.0, 1.0, 1.0, 2.0], 2).tolist() == [1, 1, 1, 1]


def test_bad_columns_are_refused_by_name() -> None:
    with pytest.raises(InvalidInput, match="sun"):
        observe([0.1, 0.2], [0, 1], {"sun": [0, 1, 2]})
    with pytest.raises(InvalidInput, match=r"sun: needs whole numbers"):
        observe([0.1, 0.2], [0, 1], {"sun": [0.5, 1.5]})
    with pytest.raises(InvalidInput, match=r"too many levels; got 40; limit: 32"):
        observe(np.zeros(40), np.zeros(40, np.int64), {"x": np.arange(40)})


def test_designs_side_by_side_are_compared_within_each_where_all_else_is_equal() -> None:
    """Two blocks of a run: four suns at one heading; two suns, another heading and a material. Each has its own places."""
    rng = np.random.default_rng(4)
    first = np.array(list(product(range(30), range(4), [0], [0])))
    second = np.array(list(product(range(30, 40), (0, 2), [1], (1, 2))))
    places, sun, heading, material = np.concatenate([first, second]).T
    wobble = 0.3 * rng.standard_normal(40)[places]
    values = 0.5 + wobble - 0.1 * (sun == 2) - 0.05 * (material == 2) + 0.001 * rng.standard_normal(len(sun))
    observations = observe(values, places, {"sun": sun, "heading": heading, "material": material})
    lower = _only(observations, Change("sun", 0, 2))
    assert lower.matching is Matching.BLOCKS
    assert (lower.places, lower.pairs) == (40, 30 + 2 * 10)
    assert lower.estimate == pytest.approx(-0.1, abs=0.002)
    assert _only(observations, Change("material", 1, 2)).estimate == pytest.approx(-0.05, abs=0.002)
    # No place shows the material of the first block beside one of the second.
    assert not contrasts(observations, interactions=False, only=[(Change("material", 0, 1),)])
