"""Failure rates with intervals on planted scores, against the truth and against the formulas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import binomtest, chi2

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.estimate import Estimate
from valerie.guided.strategy import Strategy, pursue
from valerie.testing.strategies import StrategyContract

Points = np.ndarray


def smooth(points: Points) -> Points:
    """Scores of which 2 % fail: those with x + y > 1.8."""
    return expit(6 * (1.8 - points[:, 0] - points[:, 1]))


@cache
def told(score: Callable[[Points], Points], seed: int, budget: int = 384) -> Estimate:
    strategy = Estimate(Cube(4), at_least=0.5, seed=seed, first=128, pool=4000)
    pursue(strategy, score, budget=budget, batch=128)
    return strategy


def test_both_intervals_hold_the_rate_and_the_assisted_one_is_narrower_than_plain_monte_carlo() -> None:
    rates = [told(smooth, seed, 640).rate() for seed in range(8)]
    assert sum(rate.assumption_free.low <= 0.02 <= rate.assumption_free.high for rate in rates) >= 7
    assisted = [rate.assisted for rate in rates if rate.assisted is not None]
    assert len(assisted) == 8
    assert sum(interval.low <= 0.02 <= interval.high for interval in assisted) >= 7
    plain = 2 * 1.96 * np.sqrt(0.02 * 0.98 / 640)
    assert np.median([interval.high - interval.low for interval in assisted]) < 0.5 * plain
    estimates = np.array([interval.estimate for interval in assisted])
    assert abs(estimates.mean() - 0.02) < 3 * estimates.std() / np.sqrt(8)


def test_the_assumption_free_number_uses_uniform_points_in_a_number_fixed_in_advance() -> None:
    counted = []
    for seed in range(8):
        strategy = told(smooth, seed, 640)
        counted += [draws.points[: draws.counted] for draws in strategy.draws]
        assert [draws.counted for draws in strategy.draws] == [128, 64, 64, 64, 64]
        hits = sum(
            np.count_nonzero(scores[: draws.counted] < 0.5)
            for draws, scores in zip(strategy.draws, strategy.scores, strict=True)
        )
        assert strategy.rate().assumption_free.estimate == pytest.approx(hits / 384)
        assert strategy.rate().hidden_mode == pytest.approx(3 / 384, rel=0.01)
    points = np.concatenate(counted)
    for dimension in range(4):
        tenths = np.histogram(points[:, dimension], 10, (0, 1))[0]
        assert ((tenths - len(points) / 10) ** 2 / (len(points) / 10)).sum() < chi2(9).ppf(0.999)


def test_weights_are_the_density_ratio_so_that_their_mean_is_one() -> None:
    weights = [np.concatenate([draws.weights for draws in told(smooth, seed, 640).draws[1:]]) for seed in range(8)]
    means = [values.mean() for values in weights]
    assert abs(np.mean(means) - 1) < 4 * np.std(means) / np.sqrt(8)
    assert max(values.max() for values in weights) <= 1 / 0.5 + 1e-9


def test_failures_that_the_surrogate_does_not_expect_raise_the_operational_share() -> None:
    def surprising(points: Points) -> Points:
        return np.where(1000 * points[:, 0] % 1 < 0.02, 0.3, smooth(points))

    for seed in range(4):
        assert told(smooth, seed, 640).draws[-1].share < 0.65
        assert told(surprising, seed, 640).draws[-1].share > 0.8


def test_guided_batches_hold_more_failures_than_operational_ones() -> None:
    strategy = told(smooth, 3, 640)
    shares = [np.mean(scores < 0.5) for scores in strategy.scores]
    assert np.mean(shares[2:]) > 5 * 0.02


def test_scores_that_tell_nothing_of_failures_give_the_gamma_interval_and_are_not_calibrated() -> None:
    def hidden(points: Points) -> Points:
        return np.where(1000 * points[:, 0] % 1 < 0.008, 0.0, 0.9)

    rate = told(hidden, 1, 640).rate()
    assert rate.assisted is not None
    assert rate.assisted.method == "Fay and Feuer"
    assert rate.assisted.low <= 0.008 <= rate.assisted.high
    assert not rate.calibrated


@pytest.mark.parametrize(
    ("judged", "unforeseen", "usable"), [(0, 0, False), (4, 0, False), (5, 0, True), (7, 1, False), (8, 1, True)]
)
def test_few_operational_failures_do_not_show_that_the_model_knows_them(
    judged: int, unforeseen: int, usable: bool
) -> None:
    known = told(smooth, 0, 640).rate()
    rate = replace(known, unknown=0.0, judged=judged, unforeseen=unforeseen)
    assert rate.calibrated is usable
    exact = 1.0 if not judged else binomtest(unforeseen, judged, alternative="less").proportion_ci(0.95).high
    assert rate.hidden_share == pytest.approx(exact)


def test_the_judged_failures_are_those_of_operational_points_in_guided_batches() -> None:
    strategy = told(smooth, 3, 640)
    rate = strategy.rate()
    guided = [*zip(strategy.draws, strategy.scores, strict=True)][1:]
    failing = [(scores < 0.5)[: draws.operational] for draws, scores in guided]
    assert rate.judged == sum(map(np.count_nonzero, failing)) > 0
    low = [(draws.expected < 0.05)[: draws.operational] for draws, _ in guided]
    assert rate.unforeseen == sum(np.count_nonzero(f & u) for f, u in zip(failing, low, strict=True))


def test_without_any_failure_the_upper_bounds_are_those_of_no_event() -> None:
    strategy = told(lambda points: np.full(len(points), 0.9), 0)
    rate = strategy.rate()
    assert rate.assisted is not None
    assert (rate.assumption_free.estimate, rate.assisted.low) == (0.0, 0.0)
    exact = binomtest(0, 256).proportion_ci().high
    assert rate.assumption_free.high == pytest.approx(exact, rel=0.2)
    assert rate.assisted.high > -np.log(0.025) / 384


def test_undefined_scores_are_neither_failures_nor_passes() -> None:
    def partly(points: Points) -> Points:
        return np.where(points[:, 3] > 0.75, np.nan, smooth(points))

    rates = [told(partly, seed).rate() for seed in range(4)]
    assert np.mean([rate.undefined.estimate for rate in rates]) == pytest.approx(0.25, abs=0.06)
    assert sum(rate.assisted is not None and rate.assisted.low <= 0.015 <= rate.assisted.high for rate in rates) >= 3


def test_a_batch_rests_on_the_scores_told_so_far_while_another_is_open() -> None:
    strategy = Estimate(Cube(4), at_least=0.5, seed=0, first=64, pool=1000)
    first = strategy.ask(64).points
    assert len(strategy.ask(64)) == 0
    strategy.tell(first, smooth(first))
    second, third = strategy.ask(32).points, strategy.ask(32).points
    strategy.tell(second, smooth(second))
    strategy.tell(third, smooth(third))
    again = Estimate(Cube(4), at_least=0.5, seed=0, first=64, pool=1000)
    again.tell(again.ask(64).points, smooth(first))
    again.ask(32)
    np.testing.assert_array_equal(again.ask(32).points, third)


def test_a_bound_or_scores_outside_the_range_and_a_rate_without_scores_are_refused() -> None:
    with pytest.raises(InvalidInput, match="at_least"):
        Estimate(Cube(2), at_least=1.0, seed=0)
    with pytest.raises(InvalidInput, match="first"):
        Estimate(Cube(2), at_least=0.5, seed=0, first=5)
    strategy = Estimate(Cube(2), at_least=0.5, seed=0)
    with pytest.raises(InvalidInput, match="lack scores"):
        strategy.rate()
    points = strategy.ask(4).points
    with pytest.raises(InvalidInput, match="0…1"):
        strategy.tell(points, [0.5, 2.0, 0.5, 0.5])


class TestEstimate(StrategyContract):
    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Estimate(Cube(3), at_least=0.5, seed=0, first=32, pool=500)
