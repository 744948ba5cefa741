"""Intervals of means, against textbook intervals, exact enumeration and simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from valerie.errors import InvalidInput
from valerie.statistics.intervals import Interval, Refusal, Shortfall, mean_interval
from valerie.statistics.replicates import replicates
from valerie.statistics.units import Estimand, Units, sampling_units


def drawn(count: int, rows: int = 1) -> Units:
    """Units of a random design with ``rows`` rows each."""
    return sampling_units("random", np.repeat(np.arange(count), rows))


def interval_of(values: object, units: Units, **options: object) -> Interval:
    interval = mean_interval(values, units, **options)  # type: ignore[arg-type]
    assert isinstance(interval, Interval), interval
    return interval


def mild(count: int, seed: int = 0) -> NDArray[np.float64]:
    return np.asarray(np.random.default_rng(seed).uniform(0.2, 0.85, count))


@pytest.mark.parametrize("level", [0.8, 0.95, 0.99])
def test_mild_scores_of_independent_variants_have_the_interval_of_students_t(level: float) -> None:
    values = mild(12)
    expected = stats.ttest_1samp(values, 0.5).confidence_interval(level)
    interval = interval_of(values, drawn(12), level=level)
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high))
    assert interval.estimate == pytest.approx(values.mean())
    assert (interval.units, interval.level, interval.estimand) == (12, level, Estimand.DESIGN_BOX)


def test_rows_of_one_unit_count_as_one_observation() -> None:
    values = mild(12)[:, None] + np.array([-0.1, 0.0, 0.07])
    expected = stats.ttest_1samp(values.mean(axis=1), 0.5).confidence_interval(0.95)
    interval = interval_of(values.ravel(), drawn(12, rows=3))
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high))


@pytest.mark.parametrize("count", [6, 9, 20, 75])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_a_share_of_independent_rows_has_clopper_and_pearsons_bounds(count: int, level: float) -> None:
    for hits in {0, 1, count // 3, count - 2, count}:
        interval = interval_of(np.arange(count) < hits, drawn(count), level=level)
        shift = 0.2 * (2 * hits / count - 1)
        test = stats.binomtest(hits, count)
        # proportion_ci takes the same error on both sides.
        low = test.proportion_ci(1 - (1 - level) * (1 + shift)).low
        high = test.proportion_ci(1 - (1 - level) * (1 - shift)).high
        assert (interval.low, interval.high) == pytest.approx((low, high), abs=1e-9)


@pytest.mark.parametrize("count", [6, 8, 11, 18, 40])
def test_an_interval_of_a_share_covers_every_share_enough(count: int) -> None:
    """By enumeration of every outcome, on a fine grid and beside every bound, where coverage is least."""
    ends = [interval_of(np.arange(count) < hits, drawn(count)) for hits in range(count + 1)]
    low, high = np.array([(interval.low, interval.high) for interval in ends]).T
    beside = np.concatenate([end + step for end in (low, high) for step in (-1e-9, 1e-9)])
    shares = np.concatenate([np.linspace(0, 1, 501), beside[(beside > 0) & (beside < 1)]])
    probability = stats.binom.pmf(np.arange(count + 1)[:, None], count, shares)
    coverage = (probability * ((low[:, None] <= shares) & (shares <= high[:, None]))).sum(axis=0)
    assert coverage.min() >= 0.942


def test_a_unit_whose_rows_all_agree_is_one_trial() -> None:
    hits = np.random.default_rng(1).random(30) < 0.9
    assert interval_of(np.repeat(hits, 5), drawn(30, rows=5)) == interval_of(hits, drawn(30))


@pytest.mark.parametrize(
    "values",
    [
        np.r_[np.linspace(0.95, 1, 18), 0.0, 0.3],
        np.linspace(0.95, 1, 20),
        np.r_[np.zeros(6), np.ones(10), 0.2, 0.9, 0.95, 0.4],
        np.full(20, 0.6),
        np.r_[np.linspace(0, 0.1, 40), 0.5, 1.0],
    ],
    ids=["two failures", "none", "piled at both ends", "all alike", "near 0"],
)
def test_where_little_is_seen_the_bounds_are_gaffkes_or_a_little_wider(values: NDArray[np.float64]) -> None:
    """Quantiles of the mean under random weights from the simplex, one of them for an unseen unit at the far end."""
    weights = np.random.default_rng(2).dirichlet(np.ones(len(values) + 1), 200_000)
    shift = 0.2 * (2 * values.mean() - 1)
    low = np.quantile(weights @ np.r_[values, 0.0], 0.025 * (1 + shift))
    high = np.quantile(weights @ np.r_[values, 1.0], 1 - 0.025 * (1 - shift))
    interval = interval_of(values, drawn(len(values)))
    for excess in (low - interval.low, interval.high - high):
        assert -0.015 < excess / (high - low) < 0.08


def test_a_few_failures_far_from_alike_scores_are_no_case_for_students_t() -> None:
    values = np.r_[np.linspace(0.75, 0.9, 97), np.zeros(3)]
    expected = stats.ttest_1samp(values, 0.5).confidence_interval(0.95)
    interval = interval_of(values, drawn(100))
    assert interval.low < expected.low
    assert interval.method == "beta with an unseen unit"


def test_twenty_perfect_variants_do_not_make_a_perfect_network() -> None:
    """Nineteen of twenty perfect draws: a mean of 0.86 would show them in 5 % of cases."""
    interval = interval_of(np.ones(20), drawn(20))
    assert 0.83 < interval.low < 0.86
    assert interval.high == 1


scores = st.lists(st.floats(0, 1), min_size=8, max_size=30)


@settings(max_examples=60, deadline=None)
@given(scores)
def test_an_interval_holds_its_estimate_and_stays_in_the_range(values: list[float]) -> None:
    interval = interval_of(values, drawn(len(values)))
    assert 0 <= interval.low <= interval.estimate <= interval.high <= 1
    assert interval.estimate == pytest.approx(np.mean(values))


@settings(max_examples=60, deadline=None)
@given(scores, st.randoms())
def test_the_order_of_rows_and_the_numbers_of_units_mean_nothing(values: list[float], random: object) -> None:
    order = list(range(len(values)))
    random.shuffle(order)  # type: ignore[attr-defined]
    labels = np.array([7919 * number % 104729 for number in order])
    interval = interval_of(values, drawn(len(values)))
    other = interval_of(np.array(values)[order], sampling_units("random", labels))
    assert (other.low, other.high) == pytest.approx((interval.low, interval.high), abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(scores)
def test_failures_have_the_mirrored_interval_of_successes(values: list[float]) -> None:
    # The same numbers on both sides of a bound of the choice of method.
    values = [round(value, 3) for value in values]
    interval = interval_of(values, drawn(len(values)))
    mirrored = interval_of(1 - np.array(values), drawn(len(values)))
    if mirrored.method == interval.method:
        assert (1 - mirrored.high, 1 - mirrored.low) == pytest.approx((interval.low, interval.high), abs=1e-9)


def test_a_higher_confidence_gives_a_wider_interval() -> None:
    for values in (mild(15), np.r_[np.ones(14), 0.1]):
        intervals = [interval_of(values, drawn(15), level=level) for level in (0.5, 0.8, 0.95, 0.999)]
        widths = [interval.high - interval.low for interval in intervals]
        assert widths == sorted(widths)
        assert len(set(widths)) == 4


def test_a_ratio_of_sums_weighs_rows_by_its_denominators() -> None:
    rng = np.random.default_rng(3)
    pixels, pacc = rng.integers(50, 500, 40), mild(40)
    interval = interval_of(pacc, drawn(20, rows=2), weights=pixels)
    assert interval.estimate == pytest.approx((pixels * pacc).sum() / pixels.sum())
    assert interval.low < interval.estimate < interval.high
    scaled = interval_of(pacc, drawn(20, rows=2), weights=pixels * 1000.0)
    assert (scaled.low, scaled.high) == pytest.approx((interval.low, interval.high))


def test_equal_weights_are_no_weights() -> None:
    values = mild(12)
    assert interval_of(values, drawn(12), weights=np.full(12, 8.0)) == interval_of(values, drawn(12))


def test_rows_without_weight_are_no_data() -> None:
    values, weights = np.r_[mild(12), 0.0, 0.0], np.r_[np.ones(12), 0.0, 0.0]
    interval = interval_of(values, drawn(14), weights=weights)
    assert interval.units == 12
    assert interval.estimate == pytest.approx(values[:12].mean())


def test_replicates_of_an_even_design_are_its_observations() -> None:
    values = mild(64)
    units = sampling_units("sobol", np.arange(64), replicate=replicates(64))
    expected = stats.ttest_1samp(values.reshape(8, 8).mean(axis=0), 0.5).confidence_interval(0.95)
    interval = interval_of(values, units)
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high))
    assert interval.units == 64
    assert "8 replicates" in interval.method


def test_an_even_design_of_single_points_is_a_random_one() -> None:
    units = sampling_units("latin_hypercube", np.arange(12), replicate=replicates(12))
    assert interval_of(mild(12), units) == interval_of(mild(12), drawn(12))


def test_an_even_design_in_one_piece_is_taken_as_random_and_says_so() -> None:
    interval = interval_of(mild(64), sampling_units("sobol", np.arange(64)))
    random = interval_of(mild(64), drawn(64))
    assert (interval.low, interval.high) == (random.low, random.high)
    assert "as if drawn independently" in interval.method


def test_rare_failures_in_replicates_are_never_bounded_more_tightly_than_the_unseen_allow() -> None:
    units = sampling_units("sobol", np.arange(80), replicate=replicates(80))
    interval = interval_of(np.ones(80), units)
    assert (interval.low, interval.high) == pytest.approx((0.03 ** (1 / 80), 1))


def test_a_listed_grid_has_no_sampling_error_and_the_refusal_says_what_would() -> None:
    refusal = mean_interval(mild(48), sampling_units("grid", np.arange(48)))
    assert isinstance(refusal, Refusal)
    assert refusal.estimand is Estimand.LISTED_GRID
    assert (refusal.reason, refusal.more_units) == (Shortfall.LISTED, 5)
    sites = np.repeat(np.arange(1 + refusal.more_units), 48)
    variants = np.arange(len(sites))
    assert isinstance(mean_interval(mild(len(sites)), sampling_units("grid", variants, sites=sites)), Interval)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_too_few_units_are_refused_with_how_many_more_would_do(count: int) -> None:
    refusal = mean_interval(mild(count), drawn(count))
    assert isinstance(refusal, Refusal)
    assert refusal.estimate == pytest.approx(mild(count).mean())
    assert refusal.reason is Shortfall.FEW
    enough = count + refusal.more_units
    assert isinstance(mean_interval(mild(enough), drawn(enough)), Interval)
    assert isinstance(mean_interval(mild(enough - 1), drawn(enough - 1)), Refusal)


def test_one_unit_that_outweighs_all_others_is_refused() -> None:
    weights = np.r_[np.ones(19), 200.0]
    refusal = mean_interval(mild(20), drawn(20), weights=weights)
    assert isinstance(refusal, Refusal)
    assert (refusal.reason, refusal.units) == (Shortfall.UNEQUAL, 20)
    assert refusal.worth == pytest.approx(weights.sum() ** 2 / (weights**2).sum())
    count = 20 + refusal.more_units
    alike = np.tile(weights, -(-count // 20))
    assert isinstance(mean_interval(mild(len(alike)), drawn(len(alike)), weights=alike), Interval)


def test_no_rows_have_no_interval_and_no_estimate() -> None:
    refusal = mean_interval(np.zeros(0), drawn(0))
    assert isinstance(refusal, Refusal)
    assert (refusal.estimate, refusal.units, refusal.more_units) == (None, 0, 6)


@pytest.mark.parametrize(
    ("values", "options", "field"),
    [
        (np.full(8, np.nan), {}, "values"),
        (np.full(8, 1.5), {}, "values"),
        (np.full(8, -0.1), {}, "values"),
        (np.full(7, 0.5), {}, "values"),
        (np.full(8, 0.5), {"weights": np.full(8, -1.0)}, "weights"),
        (np.full(8, 0.5), {"weights": np.full(8, np.inf)}, "weights"),
        (np.full(8, 0.5), {"weights": np.ones(3)}, "weights"),
        (np.full(8, 0.5), {"level": 95.0}, "level"),
        (np.full(8, 0.5), {"level": 0.0}, "level"),
    ],
)
def test_bad_input_is_refused_with_its_field(values: object, options: dict[str, object], field: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        mean_interval(values, drawn(8), **options)  # type: ignore[arg-type]
    assert caught.value.field == field
