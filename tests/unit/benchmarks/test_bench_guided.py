"""Planted scores have the failure rate that they state, and misses are called misses."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import bench_guided, planted_modes, planted_scores


@pytest.mark.parametrize("family", [*planted_scores.FAMILIES, *planted_scores.HELD_OUT])
def test_a_planted_score_fails_as_often_as_it_says_and_follows_from_the_seed(family: str) -> None:
    planted, again = planted_scores.plant(family, 5, 0.02), planted_scores.plant(family, 5, 0.02)
    points = np.random.default_rng(9).random((50_000, planted.dimensions))
    scores = planted.score(points)
    np.testing.assert_array_equal(scores, again.score(points))
    share = np.mean(scores < planted_scores.AT_LEAST)
    assert abs(share - planted.rate) < 4 * np.sqrt(planted.rate / 50_000) + 4 * np.sqrt(planted.rate / 2**18)
    assert np.isnan(scores).any() == (family == "partly undefined")
    assert 0.015 < planted.rate <= 0.025


def test_a_coverage_far_below_the_goal_is_called_low() -> None:
    assert bench_guided.low([True] * 80 + [False] * 20)
    assert not bench_guided.low([True] * 94 + [False] * 6)
    assert not bench_guided.low([])


@pytest.mark.parametrize("family", ["slopes", "cliffs", "mixed"])
def test_planted_modes_hold_the_volumes_that_they_state_and_fail_under_any_seed(family: str) -> None:
    planted = planted_modes.Planted(family, 3)
    points = np.random.default_rng(0).random((50_000, planted.dimensions))
    inside = planted.modes(points)
    np.testing.assert_allclose(inside.mean(axis=0)[:3], planted_modes.VOLUMES[:3], rtol=0.25)
    some = inside.any(axis=1)
    fails = planted.score(points) < planted_modes.AT_LEAST
    assert fails[some].all()
    assert np.mean(fails[~some]) == pytest.approx(planted_modes.CHANCE, rel=0.3)
    assert not (fails & (planted.score(points, 1) < planted_modes.AT_LEAST))[~some].sum() > 10
