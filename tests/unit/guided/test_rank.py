"""Rankings on a score whose indices are known, and estimates from two engines."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numpy as np
import pytest
from scipy.stats import kurtosis, sobol_indices, uniform
from scipy.stats import t as student

from valerie.errors import InvalidInput
from valerie.guided.cascade import Cascade
from valerie.guided.domain import Cube
from valerie.guided.rank import Rank, Ranking, indices, shares
from valerie.guided.strategy import Strategy, Why, pursue
from valerie.testing.strategies import StrategyContract

Points = np.ndarray


def planted(points: Points) -> Points:
    """Shares alone 0.6, 0, 0; in total 0.6, 0.4, 0.4; with half of the interaction 0.6, 0.2, 0.2; the others 0."""
    centred = np.sqrt(12) * (points - 0.5)
    return np.sqrt(0.6) * centred[:, 0] + np.sqrt(0.4) * centred[:, 1] * centred[:, 2]


def ranked(score: Callable[[Points], Points], budget: int = 3000) -> Ranking:
    strategy = Rank(Cube(5), seed=0)
    pursue(strategy, score, budget=budget, batch=70)
    assert strategy.result is not None
    return strategy.result


def test_intervals_hold_the_planted_shares_and_what_does_nothing_is_screened_out() -> None:
    ranking = ranked(planted)
    assert ranking.screened_out == (3, 4)
    truth = {0: (0.6, 0.6, 0.6), 1: (0.0, 0.4, 0.2), 2: (0.0, 0.4, 0.2), None: (0.0, 0.0, 0.0)}
    assert {effect.dimension for effect in ranking.effects} == set(truth)
    for effect in ranking.effects:
        for share, true in zip((effect.alone, effect.total, effect.shapley), truth[effect.dimension], strict=True):
            assert share is not None
            assert share.low - 0.02 <= true <= share.high + 0.02


@pytest.mark.parametrize("others", [(3,), (3, 4)])
def test_what_the_screening_missed_is_readmitted(others: tuple[int, ...]) -> None:
    def score(points: Points) -> Points:
        """The others matter only in a corner that no walk of the screening enters."""
        corner = (points[:, 1] > 0.9) & (points[:, 2] > 0.55)
        return 0.3 * points[:, 0] + 0.05 * points[:, 1:3].sum(axis=1) + corner * (points[:, others] > 0.5).sum(axis=1)

    strategy = Rank(Cube(3 + len(others)), seed=1)
    pursue(strategy, score, budget=70, batch=70)
    assert strategy.result is not None
    assert strategy.result.screened_out == others
    pursue(strategy, score, budget=2800, batch=70)
    assert strategy.result.screened_out == ()
    found = {effect.dimension: effect.total for effect in strategy.result.effects}
    for dimension in others:
        total = found[dimension]
        assert total is not None
        assert total.low > 0.02
    assert strategy.result.blocks >= 200


def test_shapley_effects_are_those_of_all_orders() -> None:
    """Against the definition: the growth of the explained variance, over all orders of three independent parameters."""

    def score(points: Points) -> Points:
        x, y, z = (points - 0.5).T
        return x + 4 * x * y + 12 * x * y * z + y**2

    fine = (np.arange(24) + 0.5) / 24
    grid = np.array(np.meshgrid(fine, fine, fine, indexing="ij"))
    values = score(grid.reshape(3, -1).T).reshape(24, 24, 24)

    def explained(group: tuple[int, ...]) -> float:
        return float(values.mean(axis=tuple(i for i in range(3) if i not in group)).var())

    orders = list(permutations(range(3)))
    growths = [
        [explained(order[: order.index(i) + 1]) - explained(order[: order.index(i)]) for i in range(3)]
        for order in orders
    ]
    truth = np.mean(growths, axis=0) / values.var()
    strategy = Rank(Cube(3), seed=0)
    pursue(strategy, score, budget=20_000, batch=1000)
    assert strategy.result is not None
    shapley = {effect.dimension: effect.shapley for effect in strategy.result.effects}
    estimates = np.array([share.estimate for _, share in sorted(shapley.items()) if share])  # type: ignore[type-var]
    # Three standard errors of the mean of some 3,000 blocks, whose growths spread by less than one variance.
    np.testing.assert_allclose(estimates, truth, atol=3 / np.sqrt(3000))
    assert estimates.sum() == pytest.approx(1, abs=3 / np.sqrt(3000))


def blocks_of(score: Callable[[Points], Points], count: int) -> tuple[Points, Points]:
    """Return the scores of blocks of three parameters, and their paths: the parameters in turn."""
    first, second = np.random.default_rng(0).random((2, count, 3))
    mixed = np.where(np.eye(3, dtype=bool)[:, None], second, first)
    between = np.where([True, True, False], second, first)
    return np.column_stack([score(first), score(second), *map(score, mixed), score(between)]), np.tile(
        [0, 1, 2], (count, 1)
    )


def test_the_indices_are_those_of_scipy() -> None:
    table, paths = blocks_of(planted, 1024)
    ours = indices(table, paths)
    functions = {
        "f_A": table[:, 0][None],
        "f_B": table[:, 1][None],
        "f_AB": table[:, 2:5].T[:, None],
    }
    theirs = sobol_indices(func=functions, n=1024, dists=[uniform()] * 3)
    np.testing.assert_allclose(ours[0], theirs.first_order.ravel(), atol=0.03)
    np.testing.assert_allclose(ours[1], theirs.total_order.ravel(), atol=0.03)


def test_intervals_are_those_of_a_jackknife() -> None:
    """Against the definition: the indices without each block."""
    table, paths = blocks_of(planted, 40)
    without = np.array([indices(np.delete(table, i, 0), np.delete(paths, i, 0)) for i in range(40)])
    known = shares(table, paths)
    assert known is not None
    for kind, (scale, lowest) in enumerate(((np.positive, -np.inf), (np.cbrt, 0), (np.positive, -np.inf))):
        middle, others = scale(indices(table, paths)[kind]), scale(without[:, kind])
        spread, degrees = np.sqrt(39 * others.var(axis=0)), 80 / (kurtosis(others, fisher=False) - 1)
        for place, share in enumerate(of_group[kind] for of_group in known):
            ends = middle[place] + np.array([-1, 1]) * student.ppf(0.975, min(degrees[place], 39)) * spread[place]
            np.testing.assert_allclose(scale([share.low, share.high]), np.maximum(ends, lowest), atol=1e-9)


def test_there_are_no_shares_if_one_block_decides_them() -> None:
    table, paths = blocks_of(lambda points: np.ones(len(points)), 40)
    table[7, 0] = 0
    assert shares(table, paths) is None
    table[8, 0] = 0
    assert shares(table, paths) is not None


def test_a_block_that_lacks_a_score_is_left_out_whole_and_many_are_refused() -> None:
    some = ranked(lambda points: np.where(points[:, 3] > 0.99, np.nan, planted(points)))
    assert 0 < some.broken < 0.2 * some.blocks
    total = next(effect.total for effect in some.effects if effect.dimension == 0)
    assert total is not None
    assert total.low < 0.6 < total.high
    many = ranked(lambda points: np.where(points[:, 0] > 0.8, np.nan, planted(points)))
    assert many.refused
    assert all(effect.total is None for effect in many.effects)


def test_blocks_wait_for_the_screening_and_one_parameter_is_no_ranking() -> None:
    strategy = Rank(Cube(2), seed=0)
    points = strategy.ask(100).points
    assert len(points) == 30
    assert len(strategy.ask(10)) == 0
    with pytest.raises(InvalidInput, match="two parameters"):
        Rank(Cube(1), seed=0)


def engines(points: Points, level: int) -> Points:
    cheap = 0.2 + 0.6 * points[:, 0]
    return cheap if level == 0 else cheap + 0.1 * points[:, 1]


def cascaded(score: Callable[[Points, int], Points], batches: int = 30, **arguments: object) -> Cascade:
    strategy = Cascade(Cube(2), costs=(1, 25), **arguments)  # type: ignore[arg-type]
    for _ in range(batches):
        proposal = strategy.ask(60)
        strategy.tell(proposal.points, score(proposal.points, proposal.level))
    return strategy


def test_two_engines_that_agree_need_few_costly_points_and_the_interval_holds() -> None:
    results = [cascaded(engines, seed=seed).result for seed in range(20)]
    held = 0
    for result in results:
        assert result is not None
        assert result.cheap > 5 * result.costly
        assert result.saved > 0.8
        held += result.low <= 0.55 <= result.high
    assert held >= 17


def test_rare_failures_are_stratified_and_hold_the_rate_that_the_cheap_engine_misses() -> None:
    def score(points: Points, level: int) -> Points:
        return np.where(points[:, 0] < (0.05 if level == 0 else 0.08), 0.1, 0.9)

    results = [cascaded(score, 40, seed=seed, at_least=0.5).result for seed in range(10)]
    for result in results:
        assert result is not None
        assert result.low <= 0.08 <= result.high
        assert result.low > 0
    disagree = results[0].disagree if results[0] else np.empty((0, 2))
    assert ((disagree[:, 0] >= 0.05) & (disagree[:, 0] < 0.08)).all()


def test_costs_and_bounds_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidInput, match="costs"):
        Cascade(Cube(2), seed=0, costs=(0, 1))
    with pytest.raises(InvalidInput, match="at_least"):
        Cascade(Cube(2), seed=0, costs=(1, 2), at_least=2)


def test_a_parameter_whose_jumps_have_no_score_is_unknown_and_not_negligible() -> None:
    strategy = Rank(Cube(3), seed=0)
    points = strategy.ask(40).points
    jumps = np.abs(np.diff(points.reshape(10, 4, 3), axis=1))
    scores = 0.5 + 0.3 * points[:, 0].reshape(10, 4)
    for walk in range(10):
        # Neither side of the third parameter's jump has a score.
        place = int(np.argmax(jumps[walk, :, 2]))
        scores[walk, place] = np.nan
    strategy.tell(points, scores.ravel())
    assert strategy.result is not None
    assert 2 not in strategy.result.screened_out
    assert 1 in strategy.result.screened_out
    assert np.isnan(next(e.elementary for e in strategy.result.effects if e.dimension == 2))


def test_a_domain_in_which_most_blocks_are_illegal_ends_the_ranking_before_the_budget_is_spent() -> None:
    strategy = Rank(Cube(3, lambda points: points.sum(axis=1) < 1.5), seed=0)
    spent = pursue(strategy, lambda points: points[:, 0], budget=2000, batch=50)
    assert spent == 40
    reason = strategy.ask(50).reason
    assert reason.name == Why.ILLEGAL_BLOCKS
    assert reason.numbers["illegal"] > 0.4 * reason.numbers["drawn"]
    assert strategy.result is not None
    assert strategy.result.refused


class TestRank(StrategyContract):
    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Rank(Cube(3), seed=0)


class TestCascade(StrategyContract):
    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Cascade(Cube(3), seed=0, costs=(1, 25))
