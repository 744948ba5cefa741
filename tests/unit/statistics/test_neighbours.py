"""Likeness of neighbouring places on planted fields, and what it forbids."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.statistics.confirmation import find, named
from valerie.statistics.contrasts import Matching, contrasts
from valerie.statistics.curves import departure, fit_curve, proven_changes
from valerie.statistics.gates import compare_versions
from valerie.statistics.neighbours import ALIKE, alike, level_of
from valerie.statistics.observations import Observations, observe

Floats = NDArray[np.float64]
X, Y = (axis.ravel() for axis in np.meshgrid(np.arange(10), np.arange(12), indexing="ij"))
POSITIONS: Floats = np.asarray(3.0 * np.column_stack([X, Y]), np.float64)
PLACE = np.repeat(np.arange(120), 2)
SUN = np.tile([0, 1], 120)
REACHES = (4.0, 15.0)


def field(reach_m: float, seed: int) -> Floats:
    """Standard normal figures of 120 places 3 m apart that correlate over ``reach_m``; 0: not at all."""
    rng = np.random.default_rng(seed)
    distance = np.hypot(*(POSITIONS[:, None] - POSITIONS).transpose(2, 0, 1))
    cover = np.exp(-distance / reach_m) if reach_m else np.eye(120)
    return np.asarray(np.linalg.cholesky(cover + 1e-9 * np.eye(120)) @ rng.standard_normal(120))


def scores(reach_m: float, seed: int) -> Floats:
    """Scores that differ from place to place, (240,)."""
    noise = 0.05 * np.random.default_rng(seed + 1000).standard_normal(240)
    return np.asarray(np.clip(0.5 + 0.1 * field(reach_m, seed)[PLACE] + noise, 0, 1))


def with_sun(reach_m: float, seed: int, effect: float = 0.0) -> Observations:
    """Places whose sun has an effect of its own at each; its mean over streets is ``effect``."""
    own = 0.1 * field(reach_m, seed + 2000)[PLACE] + effect
    return observe(scores(0.0, seed) + SUN * own, PLACE, {"x": X[PLACE], "y": Y[PLACE], "sun": SUN}, POSITIONS[PLACE])


def claims_a_trend(reach_m: float, seed: int, positions: Floats | None) -> bool:
    changes = proven_changes(Y[PLACE], scores(reach_m, seed), PLACE, seed=seed, positions=positions)
    assert changes is not None
    return changes.low > 0 or changes.high < 0 or changes.falls or changes.rises


def confirms(observations: Observations, seed: int) -> bool:
    return any(item.confirmed for item in find(observations, seed=seed).items)


@pytest.mark.parametrize("within", [False, True])
def test_independent_places_count_as_alike_as_rarely_as_stated(within: bool) -> None:
    at = level_of(120, within=within)
    found = [alike(field(0.0, seed)[:, None], POSITIONS, within=within)[0] for seed in range(200)]
    # Three standard errors of 200 repetitions.
    assert np.mean(found) == pytest.approx(at, abs=3 * np.sqrt(at * (1 - at) / 200))


@pytest.mark.parametrize("reach_m", REACHES)
def test_a_smooth_field_is_detected_beside_a_slope(reach_m: float) -> None:
    slope: Floats = np.column_stack([np.ones(120), Y]).astype(np.float64)
    found = [alike((field(reach_m, seed) + Y)[:, None], POSITIONS, slope, within=True)[0] for seed in range(40)]
    assert np.mean(found) > 0.9


def test_a_slope_that_is_fitted_is_no_likeness() -> None:
    slope: Floats = np.column_stack([np.ones(120), Y]).astype(np.float64)
    found = [alike((field(0.0, seed) + 3 * Y)[:, None], POSITIONS, slope)[0] for seed in range(100)]
    assert np.mean(found) == pytest.approx(level_of(120, within=False), abs=0.09)


def test_few_places_and_equal_figures_are_not_alike_and_places_without_figures_do_not_count() -> None:
    assert not alike(np.full((120, 1), 0.5), POSITIONS)[0]
    assert not alike(np.arange(3.0)[:, None], POSITIONS[:3])[0]
    assert [level_of(places, within=True) for places in (12, 120, 10_000)] == [ALIKE, 300 / 120**2, 0.01]
    figures = np.column_stack([field(15.0, 1), field(15.0, 1)])
    figures[60:, 0] = np.nan
    assert alike(figures, POSITIONS).tolist() == [True, True]


def test_places_that_are_alike_prove_no_trend() -> None:
    """Without the positions, every third run claims a trend that no street has."""
    places = POSITIONS[PLACE]
    for reach_m in REACHES:
        assert np.mean([claims_a_trend(reach_m, seed, None) for seed in range(20)]) > 0.2
        assert np.mean([claims_a_trend(reach_m, seed, places) for seed in range(20)]) <= 0.1
    values = scores(15.0, 3)
    changes = proven_changes(Y[PLACE], values, PLACE, seed=0, positions=places)
    assert changes is not None
    assert changes.alike
    assert (changes.low, changes.high, changes.most) == (-np.inf, np.inf, np.inf)
    curve = fit_curve(Y[PLACE], values, PLACE, seed=0, positions=places)
    assert curve is not None
    assert (curve.low, curve.high) == ((), ())
    assert departure(curve, 0.05).not_before is departure(curve, 0.05).at_latest is None


def test_an_effect_that_is_alike_among_neighbours_is_not_confirmed() -> None:
    """Without the positions, half of the runs confirm an effect of the sun whose mean over streets is 0."""
    for reach_m in REACHES:
        runs = [with_sun(reach_m, seed) for seed in range(20)]
        blind = [observe(one.values, one.place, one.factors) for one in runs]
        assert np.mean([confirms(one, seed) for seed, one in enumerate(blind)]) > 0.2
        assert np.mean([confirms(one, seed) for seed, one in enumerate(runs)]) <= 0.1
    one = with_sun(15.0, 0, 0.3)
    (item,) = (item for item in find(one, seed=0).items if [c.factor for c in item.candidate.changes] == ["sun"])
    assert item.alike
    assert (item.confirmed, item.contrast, item.low, item.high) == (False, None, -np.inf, np.inf)
    assert not any(item.candidate.changes[0].factor == "sun" for item in named(one))
    sun = next(item for item in contrasts(one, interactions=False) if item.changes[0].factor == "sun")
    assert sun.alike
    assert sun.interval() == (-np.inf, np.inf)
    assert not sun.excludes_0(0.95)
    assert sun.reversed.alike


def test_an_effect_within_independent_places_keeps_its_power_beside_places_that_are_alike() -> None:
    def confirmed(seed: int) -> bool:
        values = scores(15.0, seed) + 0.1 * SUN
        factors = {"x": X[PLACE], "y": Y[PLACE], "sun": SUN}
        items = find(observe(values, PLACE, factors, POSITIONS[PLACE]), seed=seed).items
        assert not any(item.confirmed and item.candidate.matching is Matching.MODEL for item in items)
        return any(item.confirmed and item.candidate.changes[0].factor == "sun" for item in items)

    assert np.mean([confirmed(seed) for seed in range(40)]) >= 0.85


@pytest.mark.parametrize("reach_m", REACHES)
def test_versions_whose_differences_are_alike_are_not_compared(reach_m: float) -> None:
    whole, verdicts = {"all": np.ones(240, np.bool_)}, []
    for seed in range(20):
        before = scores(0.0, seed)
        after = before + 0.1 * field(reach_m, seed + 2000)[PLACE]
        (blind,) = compare_versions(before, after, PLACE, whole).slices
        (seen,) = compare_versions(before, after, PLACE, whole, positions=POSITIONS[PLACE]).slices
        verdicts.append((blind.worse, seen.worse))
    assert np.mean(verdicts, axis=0) == pytest.approx([0.4, 0.0], abs=0.25)
    assert seen.alike
    assert (seen.low, seen.high, seen.p_value, seen.places_needed, seen.too_few) == (None, None, 1.0, None, True)
    assert seen.difference == pytest.approx(blind.difference)
