"""Maps of planted boundaries, against the planted verdicts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import binomtest

from benchmarks import planted_streets
from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.map import CONFIDENCE, WRONG, Call, Map, least_probability
from valerie.guided.strategy import Strategy, pursue
from valerie.testing.strategies import StrategyContract

Points = np.ndarray


def bent(points: Points) -> Points:
    return np.asarray(expit(6 * (points[:, 0] + points[:, 1] * points[:, 2] - 0.9)))


def mapped(score: Callable[[Points], Points], dimensions: int, budget: int) -> Map:
    strategy = Map(Cube(dimensions), at_least=0.5, seed=1)
    pursue(strategy, score, budget=budget, batch=48)
    return strategy


def test_a_smooth_boundary_is_right_nearly_everywhere_with_few_points() -> None:
    strategy = mapped(bent, 4, 192)
    points = np.random.default_rng(9).random((3000, 4))
    calls, fails = strategy.calls(points), bent(points) < 0.5
    known = calls != Call.NOT_KNOWN
    assert known.mean() > 0.97
    assert np.mean((calls == Call.FAIL)[known] != fails[known]) < 0.01
    result = strategy.result
    assert result is not None
    assert result.passing + result.failing + result.undefined + result.not_known == pytest.approx(1)
    assert np.abs(bent(result.nearest) - 0.5).max() < 0.1


def test_scores_that_nobody_can_predict_are_not_known() -> None:
    def noise(points: Points) -> Points:
        return np.where(np.sin(1e4 * points.sum(axis=1)) < 0, 0.2, 0.8)

    strategy = mapped(noise, 3, 192)
    assert strategy.result is not None
    assert strategy.result.not_known > 0.9


def test_noisy_scores_with_jumps_are_known_where_calls_are_right() -> None:
    planted = planted_streets.plant("street", 6)
    strategy = Map(planted.domain, at_least=0.5, seed=6)
    pursue(strategy, planted.score, budget=256, batch=64)
    points = np.random.default_rng(9).random((3000, planted.domain.dimensions))
    calls, fails = strategy.calls(points), planted.score(points) < 0.5
    known = calls != Call.NOT_KNOWN
    assert known.mean() > 0.5
    assert np.mean((calls == Call.FAIL)[known] != fails[known]) < WRONG
    result = strategy.result
    assert result is not None
    assert result.failing_unknown == pytest.approx(fails[~known].mean(), abs=4 * 0.5 / np.sqrt(256 * 0.2))


@pytest.mark.parametrize(("right", "wrong", "known"), [(44, 0, False), (45, 0, True), (75, 1, False), (76, 1, True)])
def test_a_verdict_needs_a_bound_below_the_allowed_share(right: int, wrong: int, known: bool) -> None:
    bound = binomtest(wrong, right + wrong, alternative="less").proportion_ci(CONFIDENCE).high
    assert (bound <= WRONG) == known
    probabilities = np.tile([0.9, 0.1, 0.0], (right + wrong, 1))
    assert (least_probability(probabilities, np.repeat([0, 1], [right, wrong])) <= 0.9) == known


def test_undefined_scores_are_a_region_of_their_own() -> None:
    strategy = mapped(lambda points: np.where(points[:, 3] > 0.7, np.nan, bent(points)), 4, 288)
    assert strategy.result is not None
    assert strategy.result.undefined == pytest.approx(0.3, abs=0.06)
    assert strategy.result.wrong <= WRONG


def test_legality_is_tried_on_few_more_points_than_are_asked_for() -> None:
    tried: list[Points] = []

    def legal(points: Points) -> Points:
        tried.extend(points)
        return points[:, 0] < 0.5

    strategy = Map(Cube(3, legal), at_least=0.5, seed=0)
    for _ in range(3):
        tried.clear()
        points = strategy.ask(64).points
        strategy.tell(points, bent(points))
    assert 64 <= len(tried) <= 4 * 64


def test_where_hardly_any_variant_is_legal_batches_are_whole_and_legal() -> None:
    cube = Cube(3, lambda points: points[:, 0] < 0.01)
    strategy = Map(cube, at_least=0.5, seed=0)
    for _ in range(3):
        points = strategy.ask(64).points
        assert len(np.unique(points, axis=0)) == 64
        assert cube.legal(points).all()
        strategy.tell(points, bent(points))


def test_a_result_is_the_same_whether_earlier_ones_were_asked_for_or_not() -> None:
    often, once = (Map(Cube(3), at_least=0.5, seed=3) for _ in range(2))
    for _ in range(9):  # across several fits of the kernel
        points = often.ask(40).points
        assert np.array_equal(once.ask(40).points, points)
        often.tell(points, bent(points))
        once.tell(points, bent(points))
        asked = often.result
    assert asked is not None
    result = once.result
    assert result is not None
    assert (asked.passing, asked.failing, asked.not_known) == (result.passing, result.failing, result.not_known)


def test_only_legal_points_are_asked_for_and_a_bound_out_of_range_is_refused() -> None:
    cube = Cube(2, lambda points: points[:, 0] < 0.5)
    strategy = Map(cube, at_least=0.5, seed=0)
    for _ in range(4):
        points = strategy.ask(32).points
        assert cube.legal(points).all()
        strategy.tell(points, np.clip(points.sum(axis=1), 0, 1))
    with pytest.raises(InvalidInput, match="at_least"):
        Map(cube, at_least=1, seed=0)


class TestMap(StrategyContract):
    size = 40
    batches = 3

    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Map(Cube(3), at_least=0.5, seed=0)
