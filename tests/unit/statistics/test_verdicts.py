"""Verdicts: exact error rates by enumerating every course of a test, and counting."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq

from valerie.errors import InvalidInput
from valerie.parameters.samplers import SAMPLERS
from valerie.statistics.intervals import mean_interval
from valerie.statistics.replicates import replicates
from valerie.statistics.units import sampling_units
from valerie.statistics.verdicts import (
    Basis,
    Outcome,
    judge_even,
    judge_grid,
    judge_sample,
    units_to_decide,
)


def draw(share, units, seed):
    return (np.random.default_rng(seed).random(units) < share).astype(float)


@pytest.fixture(scope="module")
def courses():
    """The outcome of every course of nine units that pass or fail, by the number of passes."""
    every = list(product([0.0, 1.0], repeat=9))
    return [(sum(course), judge_sample(course, np.arange(9), at_least=0.5, confidence=0.6).outcome) for course in every]


@pytest.mark.parametrize(("truth", "false"), [(0.5, Outcome.NOT_MET), (0.499999, Outcome.MET), (0.7, Outcome.NOT_MET)])
def test_false_verdicts_of_every_course_of_a_test_are_rarer_than_the_level(courses, truth, false):
    chance = sum(truth**passes * (1 - truth) ** (9 - passes) for passes, outcome in courses if outcome is false)
    # Half of the level is for the other verdict.
    assert 0 < chance <= 0.2


def test_looking_after_every_unit_gives_the_verdict_of_looking_once():
    bound, values = 0.9, draw(0.7, 300, 0)
    whole = judge_sample(values, np.arange(300), at_least=bound)
    looks = [judge_sample(values[:n], np.arange(n), at_least=bound).outcome for n in range(1, 301)]
    assert whole.outcome is Outcome.NOT_MET
    assert whole.decided_after == next(n for n, outcome in enumerate(looks, 1) if outcome is not Outcome.UNDECIDED)
    assert set(looks[whole.decided_after - 1 :]) == {Outcome.NOT_MET}


def test_the_p_value_reaches_its_half_of_the_level_when_the_test_ends():
    bound, values = 0.95, draw(0.85, 400, 1)
    end = judge_sample(values, np.arange(400), at_least=bound).decided_after
    at_end = judge_sample(values[:end], np.arange(end), at_least=bound)
    before = judge_sample(values[: end - 1], np.arange(end - 1), at_least=bound)
    assert at_end.p_not_met <= 0.025 < before.p_not_met
    assert at_end.p_met > 0.025


def test_rows_of_one_unit_count_as_one():
    bound = 0.9
    few, many = np.arange(30), np.repeat(np.arange(30), 24)
    alike = np.repeat(draw(0.6, 30, 2), 24)
    assert judge_sample(alike, many, at_least=bound) == judge_sample(alike[::24], few, at_least=bound)


def test_a_unit_scores_the_share_of_its_rows():
    bound = 0.8
    verdict = judge_sample([1.0, 0.0, 1.0, 1.0, 1.0, np.nan], [3, 3, 3, 3, 8, 8], at_least=bound)
    assert verdict.estimate == pytest.approx((3 / 4 + 1) / 2)
    assert (verdict.units, verdict.undefined) == (2, 1)


def test_a_mean_with_little_spread_is_decided_sooner_than_a_share():
    values = np.clip(0.85 + 0.05 * np.random.default_rng(3).standard_normal(400), 0, 1)
    mean = judge_sample(values, np.arange(400), at_least=0.7)
    share = judge_sample(draw(0.85, 400, 3), np.arange(400), at_least=0.7)
    assert mean.outcome is share.outcome is Outcome.MET
    assert mean.decided_after < share.decided_after


def test_an_undecided_test_says_how_many_units_more_would_decide():
    bound, values = 0.95, np.tile([1.0] * 9 + [0.0], 12)
    verdict = judge_sample(values, np.arange(120), at_least=bound)
    assert verdict.outcome is Outcome.UNDECIDED
    assert verdict.further is not None
    # Going on with the same share decides after about that many.
    going_on = np.concatenate([values, np.tile(values, 20)])
    end = judge_sample(going_on, np.arange(len(going_on)), at_least=bound).decided_after
    assert end - 120 == pytest.approx(verdict.further, abs=40)


def test_at_the_bound_no_number_of_units_decides():
    values = np.tile([1.0] * 19 + [0.0], 10)
    verdict = judge_sample(values, np.arange(200), at_least=0.95)
    assert (verdict.outcome, verdict.further) == (Outcome.UNDECIDED, None)
    assert units_to_decide(0.95, at_least=0.95) is None


@pytest.mark.parametrize("truth", [0.9, 0.98, 0.99])
def test_the_number_of_units_said_before_is_the_number_needed_on_average(truth):
    bound = 0.95
    ends = [judge_sample(draw(truth, 2000, seed), np.arange(2000), at_least=bound).decided_after for seed in range(60)]
    assert np.mean(ends) == pytest.approx(units_to_decide(truth, at_least=bound), rel=0.3)


def test_many_units_are_judged_block_by_block_as_at_once():
    values = draw(0.9495, 10_000, 6)
    whole = judge_sample(values, np.arange(10_000), at_least=0.95)
    assert whole.units == 10_000
    log = 0.0
    # One alternative alone, by hand: the sum of all bets cannot have fallen below it by more than their number.
    for stake, score in ((-0.02 / (0.95 * 0.05), value) for value in values):
        log += np.log1p(stake * (score - 0.95))
    assert -np.log(whole.p_not_met) > log - np.log(48) - 1


def test_no_rows_are_undecided():
    verdict = judge_sample([np.nan, np.nan], [0, 1], at_least=0.5)
    assert (verdict.outcome, verdict.units, verdict.undefined, verdict.further) == (Outcome.UNDECIDED, 0, 2, None)
    assert np.isnan(verdict.estimate)


@pytest.mark.parametrize(("passing", "outcome"), [(91, Outcome.MET), (90, Outcome.MET), (89, Outcome.NOT_MET)])
def test_a_listed_grid_is_decided_by_counting(passing, outcome):
    verdict = judge_grid([1.0] * passing + [0.0] * (100 - passing) + [np.nan], at_least=0.9)
    assert (verdict.outcome, verdict.basis, verdict.units, verdict.undefined) == (outcome, Basis.GRID, 100, 1)
    assert verdict.further is None


def test_a_grid_without_rows_is_undecided():
    verdict = judge_grid([np.nan], at_least=0.5)
    assert (verdict.outcome, verdict.undefined) == (Outcome.UNDECIDED, 1)
    assert judge_grid([], at_least=0.5).outcome is Outcome.UNDECIDED


def test_a_bound_of_a_grid_is_reached_by_equality_whatever_the_rounding():
    scores = [0.1] * 3
    assert sum(scores) / 3 != 0.1  # 0.30000000000000004 / 3
    assert judge_grid(scores, at_least=0.1).outcome is Outcome.MET
    assert judge_grid([1 - score for score in scores], at_least=0.9).outcome is Outcome.MET
    assert judge_grid([1.0] * 9, at_least=1.0).outcome is Outcome.MET


@pytest.mark.parametrize("bound", [0.0, 1.0, float("nan")])
def test_a_bound_that_no_sample_can_show_is_refused(bound):
    with pytest.raises(InvalidInput, match="at_least: has to lie between 0 and 1"):
        judge_sample([1.0], [0], at_least=bound)
    with pytest.raises(InvalidInput, match="at_least: has to lie between 0 and 1"):
        units_to_decide(0.9, at_least=bound)


def test_bad_input_is_refused_by_name():
    with pytest.raises(InvalidInput, match=r"scores: has to lie between 0 and 1; got 1.5"):
        judge_sample([0.2, 1.5], [0, 1], at_least=0.5)
    with pytest.raises(InvalidInput, match="units"):
        judge_sample([0.2, 0.5], [0], at_least=0.5)
    with pytest.raises(InvalidInput, match="confidence"):
        judge_sample([0.2], [0], at_least=0.5, confidence=1.0)


def even(share, units, seed):
    """Pass or fail of Sobol' points in replicates: failing is a corner of the box."""
    points = SAMPLERS["sobol"](dimensions=2, count=units, seed=seed).points(0, units)
    return (1 - points.prod(axis=1) >= 1 - _corner(share)).astype(float)


def _corner(share):
    """Return c with P(u v <= c) = share for independent uniform u, v: c (1 - log c) = share."""
    return brentq(lambda c: c * (1 - np.log(c)) - share, 1e-12, 1 - 1e-12)


@pytest.mark.parametrize(("truth", "outcome"), [(0.97, Outcome.MET), (0.83, Outcome.NOT_MET), (0.9, Outcome.UNDECIDED)])
def test_an_even_design_is_judged_by_its_replicates_at_its_number_of_units(truth, outcome):
    scores = even(truth, 512, 3)
    assert scores.mean() == pytest.approx(truth, abs=0.01)
    verdict = judge_even(scores, np.arange(512), replicates(512), at_least=0.9)
    units = sampling_units("sobol", np.arange(512), replicate=replicates(512))
    interval = mean_interval(scores, units, level=0.965)
    assert verdict.outcome is outcome
    assert verdict.units == 512
    assert verdict.decided_after is None
    assert (interval.low >= 0.9, interval.high < 0.9) == (outcome is Outcome.MET, outcome is Outcome.NOT_MET)


def test_a_false_verdict_on_an_even_design_is_rare():
    outcomes = [
        judge_even(even(0.9, 128, seed), np.arange(128), replicates(128), at_least=0.9).outcome for seed in range(300)
    ]
    # At the bound, met is right; 2.5 % of 300 are 7.5, and 17 or more have a chance of 1 in 500.
    assert outcomes.count(Outcome.NOT_MET) <= 16


def test_an_undecided_even_design_says_about_how_many_units_more_would_do():
    first = judge_even(even(0.93, 64, 1), np.arange(64), replicates(64), at_least=0.9)
    assert first.outcome is Outcome.UNDECIDED
    assert first.further is not None
    many = 8 * (64 + first.further)
    decided = judge_even(even(0.93, many, 1), np.arange(many), replicates(many), at_least=0.9)
    assert decided.outcome is Outcome.MET
    assert judge_even([np.nan], [0], [0], at_least=0.9).outcome is Outcome.UNDECIDED
    few = judge_even(np.ones(3), np.arange(3), np.arange(3), at_least=0.9)
    assert (few.outcome, few.further) == (Outcome.UNDECIDED, 3)
