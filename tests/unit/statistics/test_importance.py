import numpy as np
import pytest
from scipy.special import ndtr
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_info, threadpool_limits

from valerie.errors import InvalidInput
from valerie.statistics.importance import measured_importance, variance_shares
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
