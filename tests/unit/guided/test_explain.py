"""Minimal pairs on planted verdicts whose smallest change is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.guided.domain import Axis, Domain
from valerie.guided.explain import TOLERANCE, Explain, MinimalPair, Verdict
from valerie.guided.strategy import Strategy, pursue
from valerie.parameters.blocks import Variation
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Choice, Distribution, Homogeneous, Uniform
from valerie.testing.strategies import StrategyContract

Points = np.ndarray


def mixed(numbers: int, steps: int = 0, choices: int = 0, turns: int = 0) -> Domain:
    """A domain of numbers in 0…1, of four steps, of choices among three, and of angles, in this order."""
    kinds: list[tuple[str, Distribution]] = [
        *[("FLOAT", Uniform())] * numbers,
        *[("FLOAT", Homogeneous(minimum=0, maximum=0.75, step=0.25))] * steps,
        *[("CATEGORICAL", Choice(values=("a", "b", "c")))] * choices,
        *[("ANGLE", Uniform())] * turns,
    ]
    definitions = []
    for place, (kind, _) in enumerate(kinds):
        limits = {"choices": ("a", "b", "c"), "default": "a"} if kind == "CATEGORICAL" else {"default": 0}
        if kind == "FLOAT":
            limits |= {"minimum": 0, "maximum": 1}
        definitions.append(
            ParameterDefinition.model_validate(
                {"path": f"scene.p{place}", "type": kind, "affects": "geometry", **limits}
            )
        )
    return Domain(definitions, [Variation(f"p{place}", kind) for place, (_, kind) in enumerate(kinds)])


def explain(
    domain: Domain, score: Callable[[Points], Points], failing: Points, passing: Points, batch: int = 1
) -> MinimalPair:
    strategy = Explain(domain, failing, passing, at_least=0.5, batch=batch)
    pursue(strategy, score, budget=200, batch=batch)
    assert strategy.result is not None
    return strategy.result


@pytest.mark.parametrize("batch", [1, 3, 8])
def test_two_of_twelve_parameters_are_named_and_the_boundary_is_met(batch: int) -> None:
    domain = mixed(12)
    failing, passing = np.full(12, 0.9), np.full(12, 0.1)
    # The way from 0.1 to 0.9 crosses the boundary where both are at 0.613.
    pair = explain(domain, lambda x: np.where(x[:, 2] + x[:, 7] > 1.226, 0.0, 1.0), failing, passing, batch)
    assert pair.changed == (2, 7)
    assert 0.613 <= pair.failing[2] <= 0.613 + TOLERANCE
    assert 0.613 - TOLERANCE <= pair.inner[2] <= 0.613
    assert pair.inner_verdict is Verdict.PASS
    np.testing.assert_array_equal(np.delete(pair.failing, (2, 7)), 0.1)


def test_larger_batches_need_fewer_rounds() -> None:
    rounds = []
    for batch in (1, 4, 16):
        strategy = Explain(mixed(12), np.full(12, 0.9), np.full(12, 0.1), at_least=0.5, batch=batch)
        rounds.append(0)
        while len(points := strategy.ask(batch).points):
            strategy.tell(points, np.where(points[:, 3] > 0.6, 0.0, 1.0))
            rounds[-1] += 1
    assert rounds[0] > rounds[1] > rounds[2]


def planted(domain: Domain, seed: int) -> tuple[Callable[[Points], Points], Points, Points]:
    """A rule that fails where one to three parameters together go too far, with a failing and a passing point."""
    rng = np.random.default_rng(seed)
    causes = rng.choice(domain.dimensions, rng.integers(1, 4), replace=False)
    weights = rng.normal(size=len(causes))

    def load(points: Points) -> Points:
        return np.sin(3 * points[:, causes]) @ weights

    points = domain.snapped(rng.random((400, domain.dimensions)))
    bound = float(np.quantile(load(points), rng.uniform(0.6, 0.95)))
    fails = load(points) >= bound
    return lambda x: np.where(load(x) >= bound, 0.0, 1.0), points[fails][0], points[~fails][0]


def test_pairs_of_planted_rules_are_one_minimal_and_cost_at_most_twenty_evaluations_typically() -> None:
    domain = mixed(5, 3, 3, 1)
    evaluations = []
    for seed in range(150):
        score, failing, passing = planted(domain, seed)
        pair = explain(domain, score, failing, passing)
        assert score(pair.failing[None])[0] == 0.0
        assert score(pair.inner[None])[0] == 1.0
        for dimension in pair.changed:
            removed = pair.failing.copy()
            removed[dimension] = pair.passing[dimension]
            assert score(removed[None])[0] == 1.0
        continuous = np.array([axis is Axis.CONTINUOUS for axis in domain.axes])
        if any(continuous[list(pair.changed)]):
            assert np.abs(domain.steps(pair.inner, pair.failing))[continuous].max() <= TOLERANCE + 1e-12
        evaluations.append(pair.evaluations)
    assert np.median(evaluations) <= 15
    assert np.quantile(evaluations, 0.9) <= 20


def test_a_change_of_choice_alone_has_no_number_to_bisect() -> None:
    domain = mixed(3, choices=2)
    failing, passing = domain.snapped(np.array([[0.9, 0.9, 0.9, 0.5, 0.5], [0.1] * 5]))
    pair = explain(domain, lambda x: np.where((x[:, 3] > 0.4) & (x[:, 3] < 0.6), 0.0, 1.0), failing, passing)
    assert pair.changed == (3,)
    np.testing.assert_array_equal(pair.inner, passing)
    assert pair.evaluations <= 6


def test_an_angle_takes_the_shorter_way_round() -> None:
    domain = mixed(0, turns=1)

    def score(points: Points) -> Points:
        return np.where((points[:, 0] > 0.95) | (points[:, 0] < 0.05), 0.0, 1.0)

    pair = explain(domain, score, np.array([0.98]), np.array([0.1]))
    assert 0.04 <= pair.failing[0] < 0.05 <= pair.inner[0] <= 0.06


def test_a_failure_that_borders_on_undefined_scores_says_so() -> None:
    def score(points: Points) -> Points:
        return np.where(points[:, 0] > 0.7, 0.0, np.where(points[:, 0] > 0.4, np.nan, 1.0))

    pair = explain(mixed(2), score, np.array([0.9, 0.9]), np.array([0.1, 0.1]))
    assert pair.changed == (0,)
    assert pair.inner_verdict is Verdict.UNDEFINED
    assert 0.7 <= pair.failing[0] <= 0.7 + TOLERANCE


def test_a_change_is_dropped_where_the_variant_fails_without_it_on_the_way_back() -> None:
    """Near the passing variant the first parameter fails alone; further away it needs the second, too."""

    def score(points: Points) -> Points:
        alone = (points[:, 0] > 0.2) & (points[:, 0] < 0.5)
        together = (points[:, 0] >= 0.5) & (points[:, 1] > 0.3)
        return np.where(alone | together, 0.0, 1.0)

    pair = explain(mixed(4), score, np.full(4, 0.9), np.full(4, 0.1))
    assert pair.changed == (0,)
    assert 0.2 < pair.failing[0] <= 0.2 + TOLERANCE


def test_variants_that_do_not_differ_or_fit_are_refused() -> None:
    with pytest.raises(InvalidInput, match="do not differ"):
        Explain(mixed(0, choices=1), [0.1], [0.2], at_least=0.5)
    with pytest.raises(InvalidInput, match="not of this domain"):
        Explain(mixed(2), [0.1], [0.2], at_least=0.5)


class TestExplain(StrategyContract):
    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: Explain(mixed(3), [0.1, 0.1, 0.1], [0.8, 0.8, 0.8], at_least=0.5, batch=4)
