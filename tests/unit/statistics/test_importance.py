from itertools import combinations
from math import comb

import numpy as np
import pytest
from scipy.special import ndtr
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_info, threadpool_limits

from valerie.errors import InvalidInput
from valerie.statistics.importance import MAX_ROWS, measured_importance, variance_shares
from valerie.statistics.observations import observe


def grid(*levels):
    return [axis.ravel() for axis in np.indices(levels)]


def shares(scores, factors):
    return {
        variance_share.factor: variance_share
        for variance_share in variance_shares(observe(scores, np.arange(len(scores)), factors))
    }


def test_shares_on_a_grid_are_those_of_the_analysis_of_variance():
    a, b, c = grid(4, 3, 5)
    scores = 0.1 * a + 0.05 * (2 * (a % 2) - 1) * (b - 1)
    variance = scores.var()
    by_hand = {"a": 0.01 * 15 / 12 / variance, "b": 0.0, "c": 0.0}
    interaction = 0.05**2 * 2 / 3 / variance

    results = shares(scores, {"a": a, "b": b, "c": c})
    for name, alone in by_hand.items():
        assert results[name].alone == pytest.approx(alone, abs=0.02)
    assert results["a"].total == pytest.approx(by_hand["a"] + interaction / 2, abs=0.02)
    assert results["b"].total == pytest.approx(interaction / 2, abs=0.02)
    assert results["c"].total == pytest.approx(0.0, abs=0.02)


def shapley_effects(scores, factors):
    """By definition (Owen 2014): the mean gain of the conditional mean's variance by a factor, over all subsets of the others."""

    def explained(names):
        cell = np.unique(np.column_stack([factors[name] for name in names]), axis=0, return_inverse=True)[1].ravel()
        return np.var((np.bincount(cell, scores) / np.bincount(cell))[cell])

    effects = {}
    for name in factors:
        others = [other for other in factors if other != name]
        subsets = [subset for size in range(len(others) + 1) for subset in combinations(others, size)]
        gains = [explained([*subset, name]) - (explained(subset) if subset else 0.0) for subset in subsets]
        weights = [1 / comb(len(others), len(subset)) / len(factors) for subset in subsets]
        effects[name] = float(np.dot(weights, gains)) / scores.var()
    return effects


def test_totals_are_shapley_effects_by_definition():
    a, b, c, _ = grid(4, 3, 2, 40)
    rng = np.random.default_rng(8)
    scores = rng.random(4)[a] + rng.random((4, 3))[a, b] + rng.random((3, 2))[b, c] + rng.random((4, 2))[a, c]
    factors = {"a": a, "b": b, "c": c}
    results = {name: share.total for name, share in shares(scores, factors).items()}
    assert results == pytest.approx(shapley_effects(scores, factors), abs=0.005)


def test_shares_of_the_ishigami_function_are_the_published_ones():
    """Ishigami and Homma 1990, a = 7, b = 0.1, on a grid of mid-quantiles; indices by Saltelli et al. 2008, Shapley from them."""
    levels = grid(24, 24, 24)
    one, two, three = (2 * np.pi * (level + 0.5) / 24 - np.pi for level in levels)
    scores = np.sin(one) + 7 * np.sin(two) ** 2 + 0.1 * three**4 * np.sin(one)
    results = shares(scores, dict(zip("123", levels, strict=True)))
    alone = {"1": 0.3139, "2": 0.4424, "3": 0.0}
    between = 0.2437  # of 1 and 3
    assert {name: share.alone for name, share in results.items()} == pytest.approx(alone, abs=0.01)
    totals = {"1": alone["1"] + between / 2, "2": alone["2"], "3": between / 2}
    assert {name: share.total for name, share in results.items()} == pytest.approx(totals, abs=0.01)


def test_noise_explains_nothing():
    a, b, _ = grid(6, 8, 10)
    noise = np.random.default_rng(1).standard_normal(len(a))
    assert all(share.total < 0.04 for share in shares(noise, {"a": a, "b": b}).values())


def test_scores_that_do_not_vary_have_no_shares():
    assert shares(np.ones(6), {"a": np.arange(6) % 2}) == {}


@pytest.mark.parametrize("hump", [False, True])
def test_of_columns_that_go_together_the_one_that_acts_is_named(hump):
    rng = np.random.default_rng(3)
    contrast = rng.standard_normal(200)
    decoys = 0.8 * contrast[:, None] + 0.6 * rng.standard_normal((200, 3))
    u = ndtr(contrast)
    scores = (np.exp(-(((u - 0.5) / 0.2) ** 2)) if hump else u) + 0.05 * rng.standard_normal(200)
    columns = {"a": decoys[:, 0], "b": decoys[:, 1], "contrast": contrast, "c": decoys[:, 2], "constant": np.ones(200)}

    results = measured_importance(scores, np.arange(200) // 2, columns)
    assert [result.column for result in results if result.named] == ["contrast"]
    assert {result.column for result in results} == {"a", "b", "c", "contrast"}


def test_columns_that_say_the_same_hide_each_other():
    x = np.random.default_rng(4).standard_normal(200)
    results = measured_importance(x, np.arange(200), {"metres": x, "feet": 3.28 * x})
    assert not any(result.named for result in results)


def test_losses_of_a_linear_gaussian_model_are_the_analytic_ones():
    """With a conditional draw instead of x, the error grows by slope² · 2 Var(x | others); one of 20 draws is the row's own."""
    rng = np.random.default_rng(9)
    covariance = np.array([[1.0, 0.7, 0.3], [0.7, 1.0, 0.5], [0.3, 0.5, 1.0]])
    slopes = np.array([1.0, 0.0, 0.6])
    x = rng.multivariate_normal(np.zeros(3), covariance, 4000)
    scores = x @ slopes + 0.5 * rng.standard_normal(4000)
    conditional = 1 / np.diag(np.linalg.inv(covariance))
    expected = 0.95 * slopes**2 * 2 * conditional / (slopes @ covariance @ slopes + 0.25)

    results = {
        one.column: one for one in measured_importance(scores, np.arange(4000), dict(zip("abc", x.T, strict=True)))
    }
    assert {name for name, one in results.items() if one.named} == {"a", "c"}
    for name, loss in zip("abc", expected, strict=True):
        assert results[name].loss == pytest.approx(loss, rel=0.08, abs=0.001)


def test_trees_take_one_thread_whatever_the_machine_offers(monkeypatch):
    threads = set()

    class Trees(HistGradientBoostingRegressor):
        def fit(self, *data):
            threads.update(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "openmp")
            return super().fit(*data)

    monkeypatch.setattr("sklearn.ensemble.HistGradientBoostingRegressor", Trees)
    generator = np.random.default_rng(5)
    with threadpool_limits(2, user_api="openmp"):
        measured_importance(generator.random(60), np.arange(60), {"a": generator.random(60)})
    assert threads == {1}


def test_few_places_are_not_tested():
    x = np.random.default_rng(5).standard_normal(190)
    assert measured_importance(x, np.arange(190) % 19, {"x": x}) == ()


def test_a_column_with_gaps_is_refused():
    with pytest.raises(InvalidInput, match="finite"):
        measured_importance([0.0, 1.0], [0, 1], {"x": [np.nan, 1.0]})


#: 120 places 3 m apart with four rows each, under two suns.
PLACE = np.repeat(np.arange(120), 4)
POSITIONS = 3.0 * np.column_stack(np.divmod(np.arange(120), 12))
SUN = np.tile([-1.0, -1.0, 1.0, 1.0], 120)


def field(reach_m, rng):
    """Standard normal figures of the places that correlate over some metres; 0: not at all."""
    distance = np.hypot(*(POSITIONS[:, None] - POSITIONS).transpose(2, 0, 1))
    cover = np.exp(-distance / reach_m) if reach_m else np.eye(120)
    return np.linalg.cholesky(cover + 1e-9 * np.eye(120)) @ rng.standard_normal(120)


def names_a_column(seed, *, places=0.0, suns=0.0, effect=0.0, guarded=True):
    """True if any column is named, where places and effects of the sun are alike over some metres, besides an effect."""
    rng = np.random.default_rng(seed)
    scores = (
        0.5 + 0.1 * field(places, rng)[PLACE] + 0.1 * SUN * field(suns, rng)[PLACE] + 0.05 * rng.standard_normal(480)
    )
    columns = {
        "distance": np.hypot(POSITIONS[:, 0] - 2, POSITIONS[:, 1] + 15)[PLACE],
        "light": SUN + 0.3 * rng.standard_normal(480),
        "hidden": rng.random(480),
    }
    scores -= effect * columns["hidden"]
    positions = POSITIONS[PLACE] if guarded else None
    return any(one.named for one in measured_importance(scores, PLACE, columns, seed=seed, positions=positions))


@pytest.mark.parametrize("alike", [{"places": 15.0}, {"suns": 15.0}])
def test_where_neighbouring_places_are_alike_no_column_is_named(alike):
    """No column acts over streets; without the positions, most runs name one."""
    assert np.mean([names_a_column(seed, **alike, guarded=False) for seed in range(8)]) > 0.3
    assert np.mean([names_a_column(seed, **alike) for seed in range(8)]) <= 0.125


def test_a_column_that_acts_at_independent_places_is_named():
    assert np.mean([names_a_column(seed, effect=0.2) for seed in range(8)]) >= 0.875


def test_of_many_rows_every_place_keeps_some(monkeypatch):
    seen, fitted = set(), []

    class Trees(HistGradientBoostingRegressor):
        def fit(self, x, *data):
            seen.update(x[:, 0].tolist())
            fitted.append(len(x))
            return super().fit(x, *data)

    monkeypatch.setattr("sklearn.ensemble.HistGradientBoostingRegressor", Trees)
    place = np.repeat(np.arange(30), 300)
    measured_importance(np.random.default_rng(6).random(9000), place, {"x": place})
    assert len(seen) == 30
    assert max(fitted) <= MAX_ROWS
