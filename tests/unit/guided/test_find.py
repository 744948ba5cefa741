"""Modes of failure on planted scores whose modes are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.find import Find, Modes
from valerie.guided.strategy import Strategy, pursue
from valerie.testing.strategies import StrategyContract

Points = np.ndarray
CENTRES = np.array([[0.2, 0.2], [0.8, 0.3], [0.5, 0.85]])
RADII = np.array([0.12, 0.08, 0.03])


def bowls(points: Points) -> Points:
    """Scores that fall below 0.5 within three circles of the first two parameters."""
    distances = np.sqrt(((points[:, None, :2] - CENTRES) ** 2).sum(axis=2)) - RADII
    return np.clip(0.5 + 2 * distances.min(axis=1), 0, 1)


def found(score: Callable[[Points], Points], budget: int = 500, **arguments: object) -> tuple[Find, Modes]:
    strategy = Find(Cube(4), at_least=0.5, seed=3, **arguments)  # type: ignore[arg-type]
    pursue(strategy, score, budget=budget, batch=50)
    assert strategy.result is not None
    return strategy, strategy.result


def test_three_modes_are_told_apart_likely_ones_first() -> None:
    _, modes = found(bowls, 800)
    nearest = [int(np.argmin(((mode.example[:2] - CENTRES) ** 2).sum(axis=1))) for mode in modes.modes]
    assert nearest == [0, 1, 2]
    assert modes.modes[0].probability == pytest.approx(np.pi * 0.12**2, rel=0.3)
    assert modes.modes[0].narrow == (0, 1)


def test_a_failure_that_does_not_repeat_is_no_failure() -> None:
    point_bytes: set[bytes] = set()

    def flaky(points: Points) -> Points:
        again = np.array([point.tobytes() in point_bytes for point in points])
        point_bytes.update(point.tobytes() for point in points)
        return np.where((points[:, 3] < 0.1) & ~again, 0.1, 0.9)

    _, modes = found(flaky)
    assert (modes.modes, modes.failures) == ((), 0)
    assert modes.unrepeated > 10


def test_a_repeat_without_a_score_is_neither_a_failure_nor_a_pass() -> None:
    counts: dict[bytes, int] = {}

    def lacking(points: Points) -> Points:
        times = []
        for point in points:
            counts[point.tobytes()] = counts.get(point.tobytes(), 0) + 1
            times.append(counts[point.tobytes()])
        # The first repeat has no score; in one half, no repeat has.
        undefined = (np.array(times) == 2) | ((np.array(times) > 1) & (points[:, 2] < 0.5))
        return np.where(points[:, 3] < 0.1, np.where(undefined, np.nan, 0.1), 0.9)

    _, modes = found(lacking)
    assert modes.unrepeated == 0
    assert modes.failures > 0
    assert modes.unscored > 0
    assert max(counts.values()) == 4


def test_the_smallest_mode_that_was_surely_met_follows_from_the_points_that_explored() -> None:
    _, modes = found(lambda points: np.full(len(points), 0.9), 300)
    assert (1 - modes.smallest) ** modes.explored == pytest.approx(0.05)
    assert not modes.modes
    assert modes.evaluations == 300


def test_a_descent_finds_a_mode_that_the_same_number_of_sobol_points_does_not() -> None:
    def small(points: Points) -> Points:
        distances = np.sqrt(((points - np.array([0.3, 0.7, 0.4, 0.6])) ** 2).sum(axis=1))
        return np.clip(0.45 + distances, 0, 1)  # fails within 3e-5 of the cube

    _, modes = found(small, 400, repeats=0)
    assert len(modes.modes) == 1
    assert modes.modes[0].explored == 0


def test_descents_get_few_points_where_they_reach_no_failure() -> None:
    _, rugged = found(lambda points: 0.85 + 0.1 * np.cos(9 * points.sum(axis=1)))
    _, slopes = found(bowls)
    assert rugged.explored > 0.9 * rugged.evaluations
    assert slopes.explored < 0.8 * slopes.evaluations


def test_covariates_join_the_failures_of_a_bent_mode() -> None:
    def radius(points: Points) -> Points:
        return np.sqrt(((points[:, :2] - 0.5) ** 2).sum(axis=1))[:, None]

    def ring(points: Points) -> Points:
        return np.where(np.abs(radius(points)[:, 0] - 0.4) < 0.04, 0.2, 0.9)

    assert len(found(ring, covariates=radius)[1].modes) < len(found(ring)[1].modes)


def test_only_legal_points_are_asked_for_and_covariates_may_help() -> None:
    cube = Cube(3, lambda points: points[:, 0] < 0.5)
    strategy = Find(cube, at_least=0.5, seed=0, covariates=lambda points: points[:, :1] + points[:, 1:2])
    for _ in range(6):
        points = strategy.ask(64).points
        assert cube.legal(points).all()
        strategy.tell(points, np.clip(points.sum(axis=1) / 1.2, 0, 1))
    assert strategy.result is not None
    assert strategy.result.modes


def test_arguments_and_scores_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidInput, match="at_least"):
        Find(Cube(2), at_least=0, seed=0)
    with pytest.raises(InvalidInput, match="repeats"):
        Find(Cube(2), at_least=0.5, seed=0, repeats=-1)
    strategy = Find(Cube(2), at_least=0.5, seed=0)
    with pytest.raises(InvalidInput, match="0…1"):
        strategy.tell(strategy.ask(1).points, [2.0])


class TestFind(StrategyContract):
    size = 64

    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Find(Cube(3), at_least=0.5, seed=0)
