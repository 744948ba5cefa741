"""Verdicts: exact error rates by enumerating every course of a test, and counting."""

from itertools import product

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.statistics.verdicts import (
    Basis,
    Outcome,
    judge_grid,
    judge_sample,
    mean_of,
    quantile_of,
    share_of,
    units_to_decide,
)


def draw(share, units, seed):
    return (np.random.default_rng(seed).random(units) < share).astype(float)


@pytest.fixture(scope="module")
def courses():
    """The outcome of every course of nine units that pass or fail, by the number of passes."""
    requirement = share_of(0.5, 0.5, confidence=0.6)
    every = list(product([0.0, 1.0], repeat=9))
    return [(sum(course), judge_sample(requirement, course, np.arange(9)).outcome) for course in every]


@pytest.mark.parametrize(("truth", "false"), [(0.5, Outcome.NOT_MET), (0.499999, Outcome.MET), (0.7, Outcome.NOT_MET)])
def test_false_verdicts_of_every_course_of_a_test_are_rarer_than_the_level(courses, truth, false):
    chance = sum(truth**passes * (1 - truth) ** (9 - passes) for passes, outcome in courses if outcome is false)
    # Half of the level is for the other verdict.
    assert 0 < chance <= 0.2


def test_looking_after_every_unit_gives_the_verdict_of_looking_once():
    requirement, values = share_of(0.5, 0.9), draw(0.7, 300, 0)
    whole = judge_sample(requirement, values, np.arange(300))
    looks = [judge_sample(requirement, values[:n], np.arange(n)).outcome for n in range(1, 301)]
    assert whole.outcome is Outcome.NOT_MET
    assert whole.decided_after == next(n for n, outcome in enumerate(looks, 1) if outcome is not Outcome.UNDECIDED)
    assert set(looks[whole.decided_after - 1 :]) == {Outcome.NOT_MET}


def test_the_p_value_reaches_its_half_of_the_level_when_the_test_ends():
    requirement, values = share_of(0.5, 0.95), draw(0.85, 400, 1)
    end = judge_sample(requirement, values, np.arange(400)).decided_after
    at_end = judge_sample(requirement, values[:end], np.arange(end))
    before = judge_sample(requirement, values[: end - 1], np.arange(end - 1))
    assert at_end.p_not_met <= 0.025 < before.p_not_met
    assert at_end.p_met > 0.025


def test_rows_of_one_unit_count_as_one():
    requirement = share_of(0.5, 0.9)
    few, many = np.arange(30), np.repeat(np.arange(30), 24)
    alike = np.repeat(draw(0.6, 30, 2), 24)
    assert judge_sample(requirement, alike, many) == judge_sample(requirement, alike[::24], few)


def test_a_unit_scores_the_share_of_its_rows():
    requirement = share_of(0.5, 0.8)
    verdict = judge_sample(requirement, [0.9, 0.1, 0.7, 0.6, 0.5, np.nan], [3, 3, 3, 3, 8, 8])
    assert verdict.estimate == pytest.approx((3 / 4 + 1) / 2)
    assert (verdict.units, verdict.undefined) == (2, 1)


def test_a_mean_with_little_spread_is_decided_sooner_than_a_share():
    values = np.clip(0.85 + 0.05 * np.random.default_rng(3).standard_normal(400), 0, 1)
    mean = judge_sample(mean_of(0.7), values, np.arange(400))
    share = judge_sample(share_of(0.5, 0.7), draw(0.85, 400, 3), np.arange(400))
    assert mean.outcome is share.outcome is Outcome.MET
    assert mean.decided_after < share.decided_after


def test_a_quantile_is_a_share_of_rows():
    values = np.random.default_rng(4).beta(8, 1, 500)
    quantile = judge_sample(quantile_of(0.05, 0.6), values, np.arange(500))
    share = judge_sample(share_of(0.6, 0.95), values, np.arange(500))
    assert quantile == share
    grid = judge_grid(quantile_of(0.05, float(np.quantile(values, 0.05)) - 1e-9), values)
    assert grid.outcome is Outcome.MET


def test_an_undecided_test_says_how_many_units_more_would_decide():
    requirement, values = share_of(0.5, 0.95), np.tile([1.0] * 9 + [0.0], 12)
    verdict = judge_sample(requirement, values, np.arange(120))
    assert verdict.outcome is Outcome.UNDECIDED
    assert verdict.further is not None
    # Going on with the same share decides after about that many.
    going_on = np.concatenate([values, np.tile(values, 20)])
    end = judge_sample(requirement, going_on, np.arange(len(going_on))).decided_after
    assert end - 120 == pytest.approx(verdict.further, abs=40)


def test_at_the_bound_no_number_of_units_decides():
    values = np.tile([1.0] * 19 + [0.0], 10)
    verdict = judge_sample(share_of(0.5, 0.95), values, np.arange(200))
    assert (verdict.outcome, verdict.further) == (Outcome.UNDECIDED, None)
    assert units_to_decide(share_of(0.5, 0.95), 0.95) is None


@pytest.mark.parametrize("truth", [0.9, 0.98, 0.99])
def test_the_number_of_units_said_before_is_the_number_needed_on_average(truth):
    requirement = share_of(0.5, 0.95)
    ends = [judge_sample(requirement, draw(truth, 2000, seed), np.arange(2000)).decided_after for seed in range(60)]
    assert np.mean(ends) == pytest.approx(units_to_decide(requirement, truth), rel=0.3)


def test_many_units_are_judged_block_by_block_as_at_once():
    values = draw(0.9495, 10_000, 6)
    whole = judge_sample(share_of(0.5, 0.95), values, np.arange(10_000))
    assert whole.units == 10_000
    log = 0.0
    # One alternative alone, by hand: the sum of all bets cannot have fallen below it by more than their number.
    for stake, score in ((-0.02 / (0.95 * 0.05), value) for value in values):
        log += np.log1p(stake * (score - 0.95))
    assert -np.log(whole.p_not_met) > log - np.log(48) - 1


def test_no_rows_are_undecided():
    verdict = judge_sample(mean_of(0.5), [np.nan, np.nan], [0, 1])
    assert (verdict.outcome, verdict.units, verdict.undefined, verdict.further) == (Outcome.UNDECIDED, 0, 2, None)
    assert np.isnan(verdict.estimate)


@pytest.mark.parametrize(
    ("passing", "failing", "missing", "outcome"),
    [
        (90, 10, 0, Outcome.MET),
        (89, 11, 0, Outcome.NOT_MET),
        (90, 0, 10, Outcome.MET),
        (89, 0, 11, Outcome.UNDECIDED),
        (0, 10, 90, Outcome.UNDECIDED),
        (0, 11, 89, Outcome.NOT_MET),
    ],
)
def test_a_listed_grid_is_decided_by_counting(passing, failing, missing, outcome):
    verdict = judge_grid(share_of(0.5, 0.9), [0.8] * passing + [0.2] * failing, missing=missing)
    assert (verdict.outcome, verdict.basis, verdict.units) == (outcome, Basis.GRID, passing + failing)
    assert verdict.further == (missing if outcome is Outcome.UNDECIDED else None)


def test_a_grid_without_rows_is_undecided():
    verdict = judge_grid(mean_of(0.5), [np.nan], missing=3)
    assert (verdict.outcome, verdict.further, verdict.undefined) == (Outcome.UNDECIDED, 3, 1)
    assert judge_grid(mean_of(0.5), []).outcome is Outcome.UNDECIDED


@pytest.mark.parametrize("make", [lambda: mean_of(1.0), lambda: share_of(0.5, 0.0), lambda: quantile_of(0.0, 0.5)])
def test_a_bound_that_no_sample_can_show_is_refused(make):
    with pytest.raises(InvalidInput, match="at_least: has to lie between 0 and 1"):
        make()


def test_bad_input_is_refused_by_name():
    with pytest.raises(InvalidInput, match=r"values: has to lie between 0 and 1; got 1.5"):
        judge_sample(mean_of(0.5), [0.2, 1.5], [0, 1])
    with pytest.raises(InvalidInput, match="units"):
        judge_sample(mean_of(0.5), [0.2, 0.5], [0])
    with pytest.raises(InvalidInput, match="confidence"):
        share_of(0.5, 0.5, confidence=1.0)
