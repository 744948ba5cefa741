"""Requirements decided, and two functions compared, on planted scores."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.guided.compare import Compare, Difference
from valerie.guided.domain import Cube
from valerie.guided.strategy import Reason, Strategy, Why, pursue
from valerie.guided.verify import Verify
from valerie.statistics.verdicts import Outcome
from valerie.testing.strategies import StrategyContract

Points = np.ndarray


def fails(share: float) -> Callable[[Points], Points]:
    return lambda points: np.where(points[:, 0] < share, 0.1, 0.9)


@pytest.mark.parametrize(("share", "outcome"), [(0.02, Outcome.MET), (0.25, Outcome.NOT_MET)])
def test_a_requirement_ends_the_sampling_once_it_is_decided(share: float, outcome: Outcome) -> None:
    strategy = Verify(Cube(2), bound=0.9, at_least=0.5, seed=0)
    spent = pursue(strategy, fails(share), budget=2000, batch=50)
    assert spent < 1000
    assert strategy.result is not None
    assert strategy.result.outcome is outcome
    assert strategy.result.decided_after is not None
    assert strategy.ask(50).reason == Reason(Why.DECIDED)


def test_an_undecided_requirement_says_what_it_still_costs_and_leaves_undefined_scores_out() -> None:
    strategy = Verify(Cube(2), bound=0.9, at_least=0.5, seed=0)
    points = strategy.ask(100).points
    strategy.tell(points, np.where(points[:, 1] < 0.5, np.nan, fails(0.08)(points)))
    result = strategy.result
    assert result is not None
    assert result.outcome is Outcome.UNDECIDED
    assert result.further is not None
    assert result.undefined == np.count_nonzero(points[:, 1] < 0.5)
    assert strategy.ask(10).reason.numbers["further"] == result.further


def test_a_mean_score_is_a_requirement_too() -> None:
    strategy = Verify(Cube(2), bound=0.3, at_least=None, seed=0)
    pursue(strategy, lambda points: points[:, 0], budget=1000, batch=50)
    assert strategy.result is not None
    assert strategy.result.outcome is Outcome.MET


def both(points: Points) -> Points:
    return np.column_stack([points[:, 0], np.clip(points[:, 0] + 0.1 * points[:, 1], 0, 1)])


def difference(within: float, seed: int = 0) -> Difference:
    strategy = Compare(Cube(2), within=within, seed=seed)
    pursue(strategy, both, budget=20_000, batch=50)
    assert strategy.result is not None
    return strategy.result


def test_two_functions_are_compared_as_closely_as_asked_and_no_closer() -> None:
    wide, narrow = difference(0.05), difference(0.01)
    assert 0.01 < wide.half_width <= 0.05
    assert narrow.half_width <= 0.01
    assert wide.pairs < narrow.pairs
    truth = float(np.mean(np.diff(both(np.random.default_rng(5).random((10**6, 2))))))
    assert narrow.low <= truth <= narrow.high
    assert narrow.better == 1
    assert not len(narrow.falls)
    np.testing.assert_array_less(0.09, np.diff(both(narrow.rises))[:, 0])


def test_rare_flips_are_not_stopped_on_before_they_are_seen() -> None:
    held = 0
    for seed in range(30):
        strategy = Compare(Cube(1), within=0.005, seed=seed)
        pursue(
            strategy,
            lambda points: np.column_stack([np.ones(len(points)), points[:, 0] > 0.005]),
            budget=9000,
            batch=300,
        )
        result = strategy.result
        assert result is not None
        assert result.half_width <= 0.005
        held += result.low <= -0.005 <= result.high
    assert held >= 27


def test_a_point_without_one_of_its_scores_is_no_pair() -> None:
    strategy = Compare(Cube(2), within=0.1, seed=0)
    points = strategy.ask(80).points
    scores = both(points)
    scores[:20, 1] = np.nan
    strategy.tell(points, scores)
    assert strategy.result is not None
    assert (strategy.result.pairs, strategy.result.undefined) == (60, 20)


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidInput, match="bound"):
        Verify(Cube(2), bound=1.0, at_least=0.5, seed=0)
    with pytest.raises(InvalidInput, match="within"):
        Compare(Cube(2), within=0.0, seed=0)


class TestVerify(StrategyContract):
    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Verify(Cube(3), bound=0.9, at_least=0.5, seed=0)


class TestCompare(StrategyContract):
    columns = 2

    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Compare(Cube(3), within=0.01, seed=0)
