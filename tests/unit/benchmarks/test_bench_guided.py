"""Planted scores have the failure rate that they state, and misses are called misses."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks import bench_guided, guided_goals, guided_peers, planted_modes, planted_scores


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


def test_the_true_shares_of_a_sum_and_of_a_product_are_their_known_ones() -> None:
    # 2 x0 + x1 has variances 4/12 and 1/12; x2 does nothing.
    added = planted_scores.Planted("sum", 3, lambda points: points @ [2.0, 1.0, 0.0], 0.1)
    for shares in guided_peers.true_shares(added, 0):
        np.testing.assert_allclose(shares, [0.8, 0.2, 0.0], atol=0.02)
    # (x0 - 1/2) (x1 - 1/2) is all interaction: each takes part in all of it, and gets half.
    product = planted_scores.Planted("product", 2, lambda points: (points - 0.5).prod(axis=1), 0.1)
    alone, total, shapley = guided_peers.true_shares(product, 0)
    np.testing.assert_allclose(alone, [0.0, 0.0], atol=0.05)
    np.testing.assert_allclose(total, [1.0, 1.0], atol=0.05)
    np.testing.assert_allclose(shapley, [0.5, 0.5], atol=0.05)


def test_peers_that_are_not_installed_are_named_once_and_leave_their_figures_empty(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(guided_peers, "find_spec", lambda name: None)
    asked_first = cache(guided_peers.package.__wrapped__)
    for module in (guided_peers, guided_goals):
        monkeypatch.setattr(module, "package", asked_first)
    rates = guided_peers.measure_rates("smooth", seed=1, repetitions=2, rate=0.1, budget=256, draws=2)
    rank = guided_peers.measure_rank("smooth", seed=1, repetitions=1, draws=1, rows=128)
    pairs = guided_peers.measure_pairs("smooth", seed=1, repetitions=2)
    find = guided_goals.measure_find("slopes", seed=1, repetitions=1, budgets=(100,))
    assert [row.method for row in rates] == ["plain", "Sobol'"]
    assert rates[0].width == 1.0
    assert rank.coverage_peer is None
    assert all(0.7 <= held <= 1 for held in (rank.coverage, rank.coverage_alone, rank.coverage_shapley))
    assert pairs.evaluations_peer is None
    assert 1 <= pairs.changes <= 12
    assert (find.evolution, find.elites) == ((), ())
    named = capsys.readouterr().out
    assert all(
        named.count(f"the package {name} is not") == 1 for name in ("openturns", "SALib", "picire", "cma", "ribs")
    )
