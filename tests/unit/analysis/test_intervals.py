import numpy as np
import pytest
from scipy import stats

from valerie.analysis.intervals import MAX_GROUPS, Resampler, quantiles, simultaneous, wilson


@pytest.mark.parametrize(("k", "n"), [(0, 5), (5, 5), (3, 40), (39, 40), (1, 1), (700, 1000)])
def test_wilson_agrees_with_scipy(k, n):
    interval = wilson(k, n)
    expected = stats.binomtest(k, n).proportion_ci(method="wilson")

    assert interval is not None
    assert interval.low == pytest.approx(expected.low, abs=1e-12)
    assert interval.high == pytest.approx(expected.high, abs=1e-12)


def test_a_share_of_nothing_has_no_wilson_interval():
    assert wilson(0, 0) is None


def everything(n):
    return np.ones(n, np.bool_)


def test_the_spread_of_the_mean_is_that_of_independent_situations():
    values = np.random.default_rng(1).normal(size=400)
    resampler = Resampler(np.arange(400), seed=0, resamples=4000)
    mean, replicates = resampler.mean(values, everything(400))

    assert mean == pytest.approx(values.mean())
    assert replicates.std() == pytest.approx(values.std() / 20, rel=0.06)


def test_repeated_rows_do_not_narrow_the_interval():
    values = np.random.default_rng(1).normal(size=100)
    once = Resampler(np.arange(100), seed=3)
    often = Resampler(np.repeat(np.arange(100), 12), seed=3)

    np.testing.assert_allclose(
        often.mean(np.repeat(values, 12), everything(1200))[1], once.mean(values, everything(100))[1], atol=1e-12
    )


def test_many_situations_in_random_groups_keep_the_spread():
    n = 3 * MAX_GROUPS
    values = np.random.default_rng(2).normal(size=n)
    resampler = Resampler(np.arange(n), seed=0, resamples=3000)

    assert resampler.groups == MAX_GROUPS
    assert resampler.mean(values, everything(n))[1].std() == pytest.approx(values.std() / np.sqrt(n), rel=0.1)


def test_the_seed_determines_the_draws_and_zero_is_a_seed():
    situations = np.arange(50)
    a, b, c = (Resampler(situations, seed=seed).weights for seed in (0, 0, 1))

    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)
    np.testing.assert_array_equal(a.sum(axis=1), 50)


def test_few_situations_give_no_interval():
    resampler = Resampler(np.arange(5), seed=0)
    values = np.arange(5.0)

    assert resampler.interval(resampler.mean(values, everything(5))[1], everything(5)) is None


def test_an_interval_of_ten_situations_has_its_stated_coverage():
    generator = np.random.default_rng(7)
    resampler = Resampler(np.arange(10), seed=0, resamples=1000)
    hits = 0
    for _ in range(400):
        values = generator.normal(size=10)
        interval = resampler.interval(resampler.mean(values, everything(10))[1], everything(10))
        assert interval is not None
        hits += interval.low <= 0 <= interval.high
    assert 0.91 <= hits / 400 <= 0.985


def test_quantiles_approach_the_plain_ones_with_many_units():
    assert quantiles(100_000)[0] == pytest.approx(0.025, abs=1e-4)
    assert quantiles(10)[0] < 0.015
    assert sum(quantiles(10)) == pytest.approx(1)


def test_simultaneous_intervals_of_forty_null_effects_rarely_leave_out_zero():
    generator = np.random.default_rng(11)
    false = 0
    for trial in range(100):
        data = generator.normal(size=(60, 40))
        resampler = Resampler(np.arange(60), seed=trial, resamples=800)
        estimates, replicates = data.mean(axis=0), resampler.weights @ data / 60
        half, _ = simultaneous(estimates, replicates, np.full(40, 60))
        false += bool((np.abs(estimates) > half).any())
    assert false <= 11  # 5 expected; P(> 11) is below 0.5 %


def test_a_single_comparison_gets_students_interval():
    values = np.random.default_rng(4).normal(size=30)
    resampler = Resampler(np.arange(30), seed=0, resamples=8000)
    mean, replicates = resampler.mean(values, everything(30))
    half, error = simultaneous(np.array([mean]), replicates[:, None], np.array([30]))
    expected = stats.t.ppf(0.975, 29) * stats.sem(values)

    assert half[0] == pytest.approx(expected, rel=0.06)
    assert error[0] == pytest.approx(stats.sem(values), rel=0.04)


def test_without_comparisons_there_are_no_intervals():
    half, error = simultaneous(np.zeros(0), np.zeros((10, 0)), np.zeros(0, int))
    assert len(half) == len(error) == 0
