"""Search in one half of the places, confirmation in the other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from valerie.errors import InvalidInput
from valerie.statistics.confirmation import confirm, find, fresh_places, halves, holm, named, search
from valerie.statistics.contrasts import Change, contrasts
from valerie.statistics.observations import Observations, observe
from valerie.statistics.power import places_needed, power


def _run(rng: np.random.Generator, places: int = 24, effect: float = 0.0, *, spread: float = 0.1) -> Observations:
    """Places on a grid of 4, two suns, two cameras; the second sun lowers the score."""
    place, sun, camera = (axis.ravel() for axis in np.meshgrid(np.arange(places), [0, 1], [0, 1], indexing="ij"))
    values = 0.6 + 0.2 * rng.standard_normal(places)[place] + spread * rng.standard_normal(len(place)) - effect * sun
    return observe(values, place, {"x": place % 4, "sun": sun, "camera": camera})


def test_a_planted_effect_is_confirmed_with_an_interval_that_holds_it() -> None:
    findings = find(_run(np.random.default_rng(0), effect=0.2), seed=0)
    (finding, *others) = findings.items
    assert finding.confirmed
    assert finding.candidate.changes == (Change("sun", 0, 1),)
    assert finding.low < -0.2 < finding.high < 0
    assert not any(other.confirmed for other in others)
    assert (findings.places_searched, findings.places_confirming) == (12, 12)
    assert findings.comparisons == len(contrasts(_run(np.random.default_rng(0))))


def test_few_runs_without_effect_have_a_confirmed_finding() -> None:
    rng = np.random.default_rng(1)
    runs = 250
    false = sum(any(item.confirmed for item in find(_run(rng), seed=k).items) for k in range(runs))
    assert stats.binomtest(false, runs, 0.05, alternative="greater").pvalue > 1e-3


def test_places_that_search_do_not_confirm() -> None:
    observations = _run(np.random.default_rng(2), effect=0.2)
    searching = halves(observations.places, seed=0)
    candidates = search(observations.of_places(searching))
    values = np.where(searching[observations.place], observations.values, 0.5)
    blind = observe(values, observations.place, observations.factors)
    findings = confirm(candidates, blind.of_places(~searching))
    assert [item.candidate for item in findings.items] == list(candidates.candidates)
    assert not any(item.confirmed for item in findings.items)


def test_a_fresh_run_confirms_what_a_small_one_suggests() -> None:
    rng = np.random.default_rng(3)
    small = find(_run(rng, places=8, effect=0.2), seed=0)
    (suggestion, *_) = small.items
    assert (small.places_searched, small.places_confirming) == (8, 0)
    assert not any(item.confirmed for item in small.items)
    assert suggestion.candidate.changes == (Change("sun", 0, 1),)
    assert suggestion.low == -np.inf
    assert suggestion.places_needed is not None
    candidates = search(_run(np.random.default_rng(3), places=8, effect=0.2))
    fresh = confirm(candidates, _run(rng, places=suggestion.places_needed, effect=0.2))
    assert fresh.items[0].confirmed


def test_an_effect_that_turns_round_is_not_confirmed() -> None:
    rng = np.random.default_rng(4)
    candidates = search(_run(rng, effect=0.3))
    findings = confirm(candidates, _run(rng, effect=-0.3))
    turned = next(item for item in findings.items if item.candidate.changes == (Change("sun", 0, 1),))
    assert turned.adjusted_p < 1e-6
    assert not turned.confirmed


def test_a_candidate_that_other_places_cannot_show_stays_open() -> None:
    rng = np.random.default_rng(5)
    candidates = search(_run(rng, effect=0.3))
    one_sun = _run(rng, effect=0.3)
    rows = one_sun.factors["sun"] == 0
    factors = {name: codes[rows] for name, codes in one_sun.factors.items()}
    findings = confirm(candidates, observe(one_sun.values[rows], one_sun.place[rows], factors))
    open_one = next(item for item in findings.items if item.candidate.changes == (Change("sun", 0, 1),))
    assert (open_one.contrast, open_one.confirmed, open_one.adjusted_p) == (None, False, 1.0)


def test_a_confirmed_interval_never_holds_zero() -> None:
    rng = np.random.default_rng(6)
    for seed in range(60):
        for item in find(_run(rng, effect=0.08), seed=seed).items:
            assert not (item.confirmed and item.places_for_size is None and item.low <= 0 <= item.high)


def test_few_places_confirm_a_difference_but_not_its_size() -> None:
    rng = np.random.default_rng(11)
    (finding, *_) = find(_run(rng, places=12, effect=0.2, spread=0.02), seed=1).items
    assert finding.confirmed
    assert finding.contrast is not None
    assert (finding.low, finding.high) == (-np.inf, np.inf)
    assert finding.places_for_size is not None
    assert finding.places_for_size > finding.contrast.places
    (larger, *_) = find(_run(rng, places=2 * finding.places_for_size, effect=0.2, spread=0.02), seed=1).items
    assert larger.places_for_size is None
    assert larger.low < -0.2 < larger.high < 0


def test_halves_take_one_of_each_two_neighbours() -> None:
    chosen = halves(11, seed=5)
    assert (chosen[:10].reshape(5, 2).sum(axis=1) == 1).all()
    assert not chosen[10]
    assert not np.array_equal(chosen, halves(11, seed=6))


def test_a_run_without_varied_factors_has_no_findings() -> None:
    findings = find(observe(np.random.default_rng(7).random(40), np.arange(40), {}), seed=0)
    assert (findings.items, findings.comparisons) == ((), 0)


def test_a_level_outside_of_0_to_1_is_refused() -> None:
    observations = _run(np.random.default_rng(8))
    with pytest.raises(InvalidInput, match="level: has to lie between 0 and 1; got 95"):
        confirm(search(observations), observations, level=95)


def test_holm_adjusts_as_in_the_help_of_r() -> None:
    # Its p.adjust gives these for 0.01, 0.02 … 0.05.
    assert holm([0.05, 0.01, 0.03, 0.02, 0.04]) == pytest.approx([0.09, 0.05, 0.09, 0.08, 0.09])
    assert len(holm([])) == 0


@pytest.mark.parametrize(
    ("effect", "wanted", "places"), [(0.5, 0.8, 34), (0.5, 0.9, 44), (0.2, 0.8, 199), (0.8, 0.8, 15)]
)
def test_places_needed_are_those_of_the_published_tables(effect: float, wanted: float, places: int) -> None:
    # Paired t-test, two-sided 5 %: G*Power 3.1 (Faul et al. 2007, doi:10.3758/BF03193146).
    assert places_needed(effect, 1.0, power_wanted=wanted) == places


def test_the_power_is_that_of_simulated_t_tests() -> None:
    rng = np.random.default_rng(9)
    data = rng.normal(0.6, 1.0, (20_000, 12))
    rejected_share = (stats.ttest_1samp(data, 0, axis=1, alternative="greater").pvalue <= 0.025).mean()
    assert power(12, 0.6, 1.0, alpha=0.025) == pytest.approx(rejected_share, abs=0.012)


def test_no_affordable_number_of_places_is_none() -> None:
    assert places_needed(1e-6, 1.0) is None
    assert places_needed(0.1, 0.0) == 2
    with pytest.raises(InvalidInput, match="effect"):
        places_needed(0.0, 1.0)


def test_fresh_places_follow_from_how_much_places_differ() -> None:
    observations = _run(np.random.default_rng(10), places=400, spread=0.1)
    sun = next(item for item in contrasts(observations) if item.changes == (Change("sun", 0, 1),))
    # The mean of two differences of rows, each with a spread of 0.1 √2.
    assert sun.deviation == pytest.approx(0.1, rel=0.1)
    assert fresh_places(sun, 0.05) == places_needed(0.05, sun.deviation)


def test_all_places_at_once_name_what_halves_of_few_places_cannot_see() -> None:
    observations = _run(np.random.default_rng(6), places=20, effect=0.4)
    (finding, *_) = named(observations)
    looked_at = contrasts(observations, interactions=False)
    (contrast,) = [candidate for candidate in looked_at if candidate.changes == (Change("sun", 0, 1),)]
    assert finding.contrast == contrast
    assert (finding.low, finding.high) == contrast.interval(1 - 0.05 / len(looked_at))
    assert finding.adjusted_p == holm([candidate.p_value for candidate in looked_at])[looked_at.index(contrast)] <= 0.05
    assert not finding.confirmed
    (few, *_) = named(_run(np.random.default_rng(6), places=8, effect=0.2))
    assert (few.low, few.high) == (-np.inf, np.inf)
    assert few.places_for_size is not None
    assert few.places_for_size > 8


def test_few_runs_without_effect_are_named() -> None:
    rng = np.random.default_rng(7)
    false = sum(bool(named(_run(rng, places=12))) for _ in range(250))
    assert stats.binomtest(false, 250, 0.05, alternative="greater").pvalue > 1e-3


def test_a_search_may_be_limited_to_some_changes() -> None:
    observations = _run(np.random.default_rng(8), effect=0.2)
    only = ((Change("camera", 0, 1),),)
    findings = find(observations, seed=0, only=only)
    assert [item.candidate.changes for item in findings.items] == list(only)
    assert findings.comparisons == 1
    assert [item.contrast.changes for item in named(observations, only=((Change("sun", 0, 1),),)) if item.contrast] == [
        (Change("sun", 0, 1),)
    ]
