"""The gate against scipy's tests, all sign choices, and planted versions."""

from itertools import product

import numpy as np
import pytest
from scipy import stats

from valerie.errors import InvalidInput
from valerie.statistics.gates import combine, compare_versions, flip_test, places_for_gate, signed_rank_test, t_test

EVERYWHERE = {"all": np.ones(4, bool)}


@pytest.mark.parametrize("count", [5, 12, 25])
def test_the_signed_rank_test_of_few_places_is_scipys_exact_one(count):
    differences = np.random.default_rng(count).normal(-0.3, 1, count)
    oracle = stats.wilcoxon(differences, alternative="less", method="exact").pvalue
    assert signed_rank_test(differences) == pytest.approx(oracle)


def test_the_signed_rank_test_of_many_places_is_scipys_normal_one():
    differences = np.round(np.random.default_rng(1).normal(-0.1, 1, 200), 1)
    nonzero = differences[differences != 0]
    oracle = stats.wilcoxon(nonzero, alternative="less", method="asymptotic", correction=False).pvalue
    assert signed_rank_test(differences) == pytest.approx(oracle, rel=0.01)


def test_with_ties_and_zeros_all_signs_are_counted():
    differences = np.array([-0.3, -0.3, 0.1, -0.1, 0.0, 0.2, -0.2, -0.2, 0.0])
    nonzero = differences[differences != 0]
    ranks = stats.rankdata(np.abs(nonzero))
    sums = [ranks @ np.array(signs) for signs in product([0, 1], repeat=len(nonzero))]
    assert signed_rank_test(differences) == pytest.approx(np.mean(np.array(sums) <= ranks[nonzero > 0].sum() + 1e-9))


def test_the_t_test_is_scipys():
    differences = np.random.default_rng(2).normal(-0.2, 1, 15)
    assert t_test(differences) == pytest.approx(stats.ttest_1samp(differences, 0, alternative="less").pvalue)


def test_the_flip_test_is_the_exact_binomial_of_places():
    net = np.array([-3, -1, -1, 0, 2, -1, -2, 0, -1])
    assert flip_test(net) == pytest.approx(stats.binomtest(1, 7, alternative="less").pvalue)


def test_the_combination_of_equal_p_values_is_theirs_and_what_is_missing_does_not_count():
    assert combine([0.013] * 3) == pytest.approx(0.013)
    assert combine([0.013, np.nan, 0.013]) == pytest.approx(0.013)
    assert combine([np.nan] * 3) == 1.0
    statistic = np.mean(np.tan((0.5 - np.array([0.01, 0.2, 0.6])) * np.pi))
    assert combine([0.01, 0.2, 0.6]) == pytest.approx(stats.cauchy.sf(statistic))
    assert combine([1e-30, 0.5, 0.5]) == pytest.approx(3e-30)


def versions(rng, places, drop=0.0):
    """20 slices of 4 frames a place; the first three become worse by ``drop``."""
    baseline = np.clip(
        0.7 + 0.2 * rng.standard_normal((20, places, 1)) + 0.05 * rng.standard_normal((20, places, 4)), 0, 1
    )
    version = baseline + 0.05 * rng.standard_normal((20, places, 1)) + 0.02 * rng.standard_normal(baseline.shape)
    version[:3] -= drop
    code = np.repeat(np.arange(20 * places), 4)
    slices = {f"slice-{k}": code // places == k for k in range(20)}
    return baseline.ravel(), version.ravel(), code, slices


def test_slices_that_became_worse_are_named_and_hardly_any_other():
    rng, named, false = np.random.default_rng(3), 0, []
    for _ in range(60):
        worse = set(compare_versions(*versions(rng, 40, 0.05)).worse)
        true = worse & {"slice-0", "slice-1", "slice-2"}
        named += len(true)
        false.append((len(worse) - len(true)) / max(len(worse), 1))
    assert named > 0.95 * 180
    assert np.mean(false) < 0.08


def test_without_change_hardly_a_run_names_a_slice():
    rng, runs = np.random.default_rng(4), 100
    alarms = sum(bool(compare_versions(*versions(rng, 15)).worse) for _ in range(runs))
    assert stats.binomtest(alarms, runs, 0.05, alternative="greater").pvalue > 1e-3


def test_a_better_version_is_not_worse():
    assert compare_versions(*versions(np.random.default_rng(5), 40, -0.2)).worse == ()


def test_few_large_flips_are_found_where_most_frames_become_a_little_better():
    rng = np.random.default_rng(6)
    baseline = np.full((200, 2), 0.8) + 0.01 * rng.random((200, 2))
    version = baseline + 0.005
    version[:24, 0] = 0.1
    gate = compare_versions(
        baseline.ravel(), version.ravel(), np.repeat(np.arange(200), 2), {"all": np.ones(400, bool)}
    )
    (only,) = gate.slices
    assert only.worse
    assert (only.lost, only.gained) == (24, 0)
    assert only.flip_p < 1e-6 < only.rank_p
    assert set(only.flips) <= set(range(0, 48, 2))


def test_differences_are_means_of_places_and_gaps_are_counted():
    baseline = np.array([0.9, 0.7, 0.8, np.nan, 0.5])
    version = np.array([0.7, 0.7, 0.9, 0.4, np.nan])
    gate = compare_versions(baseline, version, np.array([0, 0, 1, 1, 2]), {"all": np.ones(5, bool)})
    (only,) = gate.slices
    assert only.difference == pytest.approx((-0.1 + 0.1) / 2)
    assert (only.places, only.pairs, gate.unpaired) == (2, 3, 2)
    assert only.flips == (0,)


def test_a_slice_without_rows_or_change_is_not_worse():
    scores = np.array([0.2, 0.8, 0.6, 0.4])
    slices = {"same": np.ones(4, bool), "nowhere": np.zeros(4, bool)}
    same, nowhere = compare_versions(scores, scores, np.arange(4), slices).slices
    assert (same.p_value, same.worse, same.difference) == (1.0, False, 0.0)
    assert (nowhere.p_value, nowhere.places, nowhere.places_needed) == (1.0, 0, None)
    assert np.isnan(nowhere.difference)


def test_as_many_places_as_asked_for_find_the_drop():
    rng = np.random.default_rng(7)
    places = places_for_gate(0.03, float(np.hypot(0.05, 0.01)), 20)
    named = [
        len({"slice-0", "slice-1", "slice-2"} & set(compare_versions(*versions(rng, places, 0.03)).worse))
        for _ in range(60)
    ]
    assert np.mean(named) / 3 >= 0.85


@pytest.mark.parametrize("slices", [1, 8])
def test_places_that_change_equally_are_enough_only_once_their_number_alone_can_show_a_drop(slices):
    def first(places):
        scores, masks = np.full(places + 1, 0.9), {"all": np.arange(places + 1) < places}
        # The other slices do not change.
        masks |= {f"slice-{k}": np.arange(places + 1) == places for k in range(slices - 1)}
        return compare_versions(scores, scores - 0.1 * masks["all"], np.arange(places + 1), masks).slices[0]

    needed = first(3).places_needed
    assert needed == places_for_gate(0.05, 0.0, slices)
    for places in (2, 3, needed - 1):
        assert (first(places).worse, first(places).too_few) == (False, True)
    assert (first(needed).worse, first(needed).too_few) == (True, False)
    # A spread that is only almost 0 does not need fewer.
    assert places_for_gate(0.05, 1e-6, slices) == needed


def test_bad_input_is_refused_by_name():
    scores, places = np.array([0.2, 0.8, 0.6, 0.4]), np.arange(4)
    with pytest.raises(InvalidInput, match="version"):
        compare_versions(scores, scores[:3], places, EVERYWHERE)
    with pytest.raises(InvalidInput, match="night"):
        compare_versions(scores, scores, places, {"night": np.ones(3, bool)})
    with pytest.raises(InvalidInput, match="effect"):
        compare_versions(scores, scores, places, EVERYWHERE, effect=0.0)
