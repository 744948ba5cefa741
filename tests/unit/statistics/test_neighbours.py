"""Likeness of neighbouring places on planted fields."""

import numpy as np
import pytest

from valerie.statistics.confirmation import confirm, find, search
from valerie.statistics.contrasts import Matching
from valerie.statistics.neighbours import ALIKE, places_alike
from valerie.statistics.observations import observe

X, Y = (axis.ravel() for axis in np.meshgrid(np.arange(6), np.arange(8), indexing="ij"))
POSITIONS = 3.0 * np.column_stack([X, Y])


def field(reach_m, seed):
    """Scores of 48 places 3 m apart, two rows each; places correlate over ``reach_m``, 0: not at all."""
    rng = np.random.default_rng(seed)
    distance = np.hypot(*(POSITIONS[:, None] - POSITIONS).transpose(2, 0, 1))
    cover = np.exp(-distance / reach_m) if reach_m else np.eye(48)
    of_place = np.linalg.cholesky(cover + 1e-9 * np.eye(48)) @ rng.standard_normal(48)
    return np.repeat(of_place, 2) + 0.1 * rng.standard_normal(96)


def observed(values):
    place = np.repeat(np.arange(48), 2)
    return observe(values, place, {"x": X[place], "y": Y[place], "sun": np.tile([0, 1], 48)})


def share_alike(reach_m, repetitions):
    positions = np.repeat(POSITIONS, 2, axis=0)
    tests = [places_alike(observed(field(reach_m, seed)), positions, seed=seed) for seed in range(repetitions)]
    return np.mean(tests)


def test_independent_places_count_as_alike_as_rarely_as_stated():
    # Three standard errors of 200 repetitions.
    assert share_alike(0.0, 200) == pytest.approx(ALIKE, abs=0.085)


@pytest.mark.parametrize("reach_m", [4.0, 15.0])
def test_a_smooth_field_is_detected(reach_m):
    assert share_alike(reach_m, 60) > 0.75


def test_few_places_and_equal_scores_are_not_alike():
    positions = np.repeat(POSITIONS, 2, axis=0)
    assert not places_alike(observed(np.full(96, 0.5)), positions, seed=0)
    few = observe([0.1, 0.2, 0.3], [0, 1, 2], {})
    assert not places_alike(few, POSITIONS[:3], seed=0)


def test_a_difference_between_alike_places_is_neither_confirmed_nor_has_an_interval():
    observations = observed(3.0 * np.repeat(X, 2) + 0.1 * np.random.default_rng(1).standard_normal(96))
    (confirmed, *_) = find(observations, seed=0).items
    assert confirmed.confirmed
    assert confirmed.candidate.matching is Matching.MODEL
    refused = find(observations, seed=0, between=False)
    assert not any(item.confirmed for item in refused.items)
    assert {item.candidate.changes for item in refused.items} >= {confirmed.candidate.changes}
    assert all(np.isinf(item.low) for item in refused.items if item.candidate.matching is Matching.MODEL)


def test_a_difference_within_alike_places_is_still_confirmed():
    place = np.repeat(np.arange(48), 2)
    observations = observed(field(15.0, 2) + np.tile([0.0, 0.5], 48))
    sun = [change.factor for item in find(observations, seed=0, between=False).items if item.confirmed
           for change in item.candidate.changes]  # fmt: skip
    assert sun == ["sun"]
    half = observations.of_places(place[::2] % 2 == 0)
    assert confirm(search(half), observations.of_places(place[::2] % 2 == 1), between=False).items[0].confirmed
