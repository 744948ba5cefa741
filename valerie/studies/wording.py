"""Sentences about the results of strategies."""

from __future__ import annotations

import math
from dataclasses import replace
from math import isfinite
from typing import Final

import numpy as np

from valerie.analysis.wording import counted, percent
from valerie.guided.cascade import TwoEngines
from valerie.guided.compare import Difference
from valerie.guided.domain import shown
from valerie.guided.estimate import MOST_UNKNOWN, FailureRate
from valerie.guided.explain import MinimalPair, Verdict
from valerie.guided.find import Mode, Modes
from valerie.guided.map import CONFIDENCE, WRONG, Boundary, Call
from valerie.guided.rank import FEWEST, Effect, Ranking, Share
from valerie.guided.strategy import Result
from valerie.guided.verify import Verification
from valerie.measures import TableRow
from valerie.parameters.definitions import TURN, ParameterType
from valerie.parameters.samplers import UnitPoints
from valerie.runs.moments import duration
from valerie.runs.study.study_document import CascadeGoal, CompareGoal, FindGoal, VerifyGoal
from valerie.statistics.intervals import Interval
from valerie.studies.resolved import ResolvedStudy

#: When an interval for a fixed number of variants holds.
_AT_BUDGET: Final = "when the budget is spent, not for a study that someone stops because of"


def in_quantity(known: Result, study: ResolvedStudy) -> Result:
    """Return a result with its means of scores as means of the bounded quantity, of which a score is 1 less with ``<=``."""
    goal = study.document.goal
    if study.measure.statistic.sign == ">=":
        return known
    match known:
        case Verification() if isinstance(goal, VerifyGoal) and goal.share is None:
            return replace(known, estimate=1 - known.estimate, bound=1 - known.bound)
        case Difference() if isinstance(goal, CompareGoal) and goal.of == "mean":
            return replace(known, estimate=-known.estimate, low=-known.high, high=-known.low)
        case TwoEngines() if isinstance(goal, CascadeGoal) and goal.of == "mean":
            return replace(known, estimate=1 - known.estimate, low=1 - known.high, high=1 - known.low)
    return known


def result_sentences(known: Result, study: ResolvedStudy) -> tuple[str, ...]:
    """Return a result of `in_quantity` in words, the most important sentence first."""
    match known:
        case FailureRate():
            return _failure_rate(known, study)
        case Modes():
            return _modes(known, study)
        case Boundary():
            return _boundary(known)
        case MinimalPair():
            return _minimal_pair(known, study)
        case Verification():
            return _verification(known, study)
        case Difference():
            return _difference(known, study)
        case Ranking():
            return _ranking(known, study)
        case TwoEngines():
            return _two_engines(known, study)
    return known.sentences(study.domain.names)


def _failure_rate(known: FailureRate, study: ResolvedStudy) -> tuple[str, ...]:
    free = known.assumption_free
    sentences = [f"Of the legal variants, {_between(free)} fail, by {free.units:,} operational points alone."]
    if known.assisted is not None and free.units == known.evaluations:
        sentences.append("No batch had enough scores for a model.")
    elif known.assisted is not None:
        sentences.append(f"With the model's help it is {_between(known.assisted)}{_misuse(known)}.")
    if known.undefined.estimate:
        sentences.append(f"The score of {_between(known.undefined)} is undefined: they neither fail nor pass.")
    sentences.append(
        "With 95 % confidence, a given mode of failures that no operational point hit has a probability of at most "
        f"{100 * known.hidden_mode:.2f} %."
    )
    sentences.append(
        f"The intervals hold {_AT_BUDGET} them."
        if study.document.stop.width is None
        else "The confidence of each interval is high enough for all planned looks to hold together with 95 %."
    )
    return tuple(sentences)


def _misuse(known: FailureRate) -> str:
    """Return the reason why the model-assisted interval must not be used; empty if it may be."""
    if known.calibrated:
        return ""
    if known.unknown > MOST_UNKNOWN:
        return ", but do not use it: too many failures lay where the model expected none"
    few = counted(known.judged, "failure")
    return f", but do not use it: {few} at operational points of guided batches cannot show that the model expects most failures"


def _modes(known: Modes, study: ResolvedStudy) -> tuple[str, ...]:
    goal = study.document.goal
    repeated = "failure" if isinstance(goal, FindGoal) and not goal.repeats else "repeated failure"
    unscored = f" Without a score when repeated: {known.unscored}." if known.unscored else ""
    idle = "Nothing is random here, so every failure repeats: `repeats: 0` saves these variants."
    return (
        f"{counted(len(known.modes), 'mode')} in {counted(known.failures, repeated)}."
        if known.failures
        else f"No {repeated} so far.",
        f"Not placed yet: {counted(known.unplaced, 'failure')}. Not repeated: {known.unrepeated}.{unscored}",
        *(_mode(number, mode, known, study) for number, mode in enumerate(known.modes, 1)),
        "Failures are one mode if the variant halfway fails, so a bent mode may count as several, and touching ones as one.",
        *((idle,) if isinstance(goal, FindGoal) and goal.repeats and not study.is_random else ()),
        f"A given mode that holds at least {100 * known.smallest:.2g} % of the domain was hit with 95 % probability.",
    )


def _mode(number: int, mode: Mode, known: Modes, study: ResolvedStudy) -> str:
    # Failures that are not placed yet may belong to it.
    share = f"{'at least' if known.unplaced else 'about'} {100 * mode.probability:.2g} % of the domain"
    share += f" ({mode.explored} of {known.explored:,} exploring points)"
    share = share if mode.explored else "met by a descent alone"
    near = [
        f"{study.domain.names[i]} near {value}" for i, value in _shown(mode.example, study).items() if i in mode.narrow
    ]
    return f"Mode {number}: {', '.join((share, counted(mode.failures, 'failure'), *near))}."


def _boundary(known: Boundary) -> tuple[str, ...]:
    shares = {
        Call.PASS: known.passing,
        Call.FAIL: known.failing,
        Call.UNDEFINED: known.undefined,
        Call.NOT_KNOWN: known.not_known,
    }
    calls = ", ".join(f"{call}: {100 * share:.1f} %" for call, share in shares.items())
    sentences = [
        f"{calls} of the operational domain, by the calls of the map.",
        f"Without their own scores, {100 * known.wrong:.1f} % of the {known.tested} exploring points with a verdict would be "
        f"called wrongly; with {100 * CONFIDENCE:g} % confidence, at most {100 * WRONG:g} % of all verdicts are wrong."
        if known.tested
        else f"No verdict anywhere: more than {100 * WRONG:g} % might be wrong.",
        "A region without points gets the verdict of its surroundings, so an island of failures there stays unseen.",
    ]
    if isfinite(known.failing_unknown):
        sentences.insert(
            2, f"Where the verdict is not known, {100 * known.failing_unknown:.0f} % of the exploring points failed."
        )
    return tuple(sentences)


def _minimal_pair(known: MinimalPair, study: ResolvedStudy) -> tuple[str, ...]:
    domain = study.domain
    units = [f" {definition.unit}" if definition.unit else "" for definition in domain.definitions]
    before, last, after = (_shown(point, study) for point in (known.passing, known.inner, known.failing))
    ways = _ways(known, study)
    changes = [f"{domain.names[i]} from {before[i]} to {after[i]}{units[i]}{ways[i]}" for i in known.changed]
    flips = f"The verdict flips with {' and '.join(changes)}, everything else equal."
    if np.array_equal(known.inner, known.passing):
        return (flips,)
    inner, failing = (list(domain.values(point).values()) for point in (known.inner, known.failing))
    still = [f"{domain.names[i]} {last[i]}{units[i]}" for i in known.changed if inner[i] != failing[i]]
    verdict = "passes" if known.inner_verdict is Verdict.PASS else "has no score"
    return flips, f"The variant still {verdict} at {' and '.join(still)}."


def _ways(known: MinimalPair, study: ResolvedStudy) -> list[str]:
    """Return the size of each change in words, by dimension; empty for what is no number."""
    ways = []
    values = (study.domain.values(point).values() for point in (known.passing, known.failing))
    for definition, start, end in zip(study.domain.definitions, *values, strict=True):
        unit = f" {definition.unit}" if definition.unit else ""
        if isinstance(start, str | bool) or isinstance(end, str | bool):
            ways.append("")
        elif definition.type is ParameterType.ANGLE:
            ways.append(f" (turned by {shown(abs(math.remainder(end - start, TURN)))}{unit})")
        else:
            ways.append(f" ({shown(abs(end - start))}{unit} {'more' if end > start else 'less'})")
    return ways


def conditions_text(row: TableRow) -> str | None:
    """Return the measures of a failing row's person in words; None where the truth has none."""
    numbers = (("distance_m", 1, "m away"), ("occlusion_rate", 100, "% hidden"), ("shadow_share", 100, "% in shadow"))
    known = [
        f"{scale * value:.3g} {words}" for name, scale, words in numbers if isinstance(value := row.get(name), float)
    ]
    who = row.get("character") or "the person"
    return f"When it fails, {who} is {', '.join(known)} ({row['camera']})." if known else None


def _verification(known: Verification, study: ResolvedStudy) -> tuple[str, ...]:
    goal, measure = study.document.goal, study.measure
    if isinstance(goal, VerifyGoal) and goal.share is not None:
        what, estimate, required = f"share of variants with {measure.text}", known.estimate, f"at least {known.bound:g}"
    else:
        what, estimate = f"mean of {measure.quantity} over the variants", known.estimate
        required = f"{'at least' if measure.statistic.sign == '>=' else 'at most'} {measure.statistic.bound:g}"
    shown_estimate = f"{estimate:.3f}" if isfinite(estimate) else "not known"
    sentences = [f"{known.outcome.capitalize()}: the {what} is {shown_estimate}, {required} required."]
    if known.decided_after is not None:
        sentences.append(
            f"{counted(known.decided_after, 'score')} decided; the chance of a false verdict is at most "
            f"{1 - known.confidence:.2g}, whenever the study is read."
        )
    elif known.further is None and known.evaluations > known.undefined:
        sentences.append("The estimate is too close to the bound for any affordable number of scores.")
    if known.undefined:
        sentences.append(f"{counted(known.undefined, 'score')} of {known.evaluations:,} undefined and left out.")
    return tuple(sentences)


def _difference(known: Difference, study: ResolvedStudy) -> tuple[str, ...]:
    goal, (first, second) = study.document.goal, study.document.spec.functions
    assert isinstance(goal, CompareGoal), "a comparison has two functions"
    estimate, low, high = known.estimate, known.low, known.high
    what = f"share of variants with {study.measure.text}"
    if goal.of == "mean":
        what = f"mean of {study.measure.quantity}"
    if known.further is None:
        interval = f"{estimate:+.3f} over {counted(known.pairs, 'pair')}, too few for an interval"
    else:
        interval = f"{estimate:+.3f} ({low:+.3f} … {high:+.3f}, {confidence_text(goal.level)} confidence)"
    wide = f"It is known to ± {known.half_width:.3f}; ± {known.within:g} was requested."
    undefined = f"{counted(known.undefined, 'variant')} without a score of both left out."
    return (
        f"The {what} of {second} less that of {first}: {interval}.",
        "It is undecided which is better." if known.better is None else f"Better: {(first, second)[known.better]}.",
        *((wide,) if known.further is not None and known.half_width > known.within else ()),
        *((undefined,) if known.undefined else ()),
        (
            f"The interval holds nearly when the study ends by itself, at ± {known.within:g} (Chow and Robbins) or with its "
            "budget, not for a study that someone stops because of it; which function is better holds at any time."
        ),
    )


def _ranking(known: Ranking, study: ResolvedStudy) -> tuple[str, ...]:
    sentences = [_effect(effect, study) for effect in known.effects]
    if known.refused:
        of = known.blocks + known.broken
        sentences.append(f"{known.broken} of {of} blocks lack a score, so there are no shares of variance.")
    elif known.broken:
        sentences.append(f"{counted(known.broken, 'block')} without all scores left out.")
    if not known.refused and known.blocks < FEWEST:
        sentences.append(f"Shares of variance need {FEWEST} whole blocks; {known.blocks} so far.")
    elif not known.refused and known.effects[0].total is None:
        sentences.append("Apart from at most one block, all scores are equal, so there are no shares of variance.")
    if any(effect.shapley for effect in known.effects):
        sentences.append("A Shapley effect has an even part of each interaction; all of them add up to the variance.")
    return tuple(sentences)


def _effect(effect: Effect, study: ResolvedStudy) -> str:
    name = "The others together" if effect.dimension is None else study.domain.names[effect.dimension]
    if effect.total is None or effect.alone is None or effect.shapley is None:
        known = isfinite(effect.elementary)
        return f"{name}: mean elementary effect {f'{effect.elementary:.3f}' if known else 'not known'}."
    return (
        f"{name}: {_share(effect.total, ', 95 % confidence')} of the variance with interactions, "
        f"{_share(effect.alone)} alone, Shapley effect {_share(effect.shapley)}."
    )


def _share(share: Share, of: str = "") -> str:
    estimate, low, high = (percent(end, 0) for end in (share.estimate, share.low, share.high))
    return f"{estimate} % ({low} … {high}{of})"


def _two_engines(known: TwoEngines, study: ResolvedStudy) -> tuple[str, ...]:
    goal, measure = study.document.goal, study.measure
    estimate, low, high = known.estimate, known.low, known.high
    what = "failure rate"
    if isinstance(goal, CascadeGoal) and goal.of == "mean":
        what = f"mean of {measure.quantity}"
    correlation = (
        f"the engines correlate with {known.correlation:.2f}"
        if isfinite(known.correlation)
        else "the correlation of the engines is not known, since the scores of one are constant"
    )
    undefined = f"{counted(known.undefined, 'costly point')} without a score left out."
    cheap, costly = known.costs
    prices = f"A point costs {cheap:.3g} s of CPU time by the cheap and {costly:.3g} s by the costly engine"
    split = f": {known.ratio:.1f} cheap points for each costly one narrow the interval at the lowest price"
    saved = f"The cheap engine takes {percent(known.saved, 0)} % off the variance that the costly points alone have."
    return (
        f"The {what} by the costly engine is {estimate:.4f} ({low:.4f} … {high:.4f}, 95 % confidence): {known.method}.",
        f"{known.costly:,} costly and {known.cheap:,} cheap points; {correlation}.",
        *((prices + (split if isfinite(known.ratio) else "") + ".",) if isfinite(cheap + costly) else ()),
        *((saved,) if isfinite(known.saved) else ()),
        *((undefined,) if known.undefined else ()),
        f"The interval holds nearly {_AT_BUDGET} it.",
    )


def outlook_text(further: int, left: int, seconds: float | None) -> str:
    """Return in words what a study lacks for its goal.

    Args:
        further: expected number of further variants.
        left: variants left in its budget.
        seconds: their CPU time; None where no variant has a price.
    """
    price = "" if seconds is None else f", {duration(seconds)} of CPU time,"
    over = f"; the budget has {left:,} left" if further > left else ""
    return f"About {counted(further, 'further variant')}{price} are expected to reach the goal{over}."


def _shown(point: UnitPoints, study: ResolvedStudy) -> dict[int, str]:
    """Return the values of a point, (dimensions,), as text by dimension."""
    return {dimension: shown(value) for dimension, value in enumerate(study.domain.values(point).values())}


def _between(interval: Interval) -> str:
    estimate, low, high = 100 * interval.estimate, 100 * interval.low, 100 * interval.high
    return f"{estimate:.2f} % ({low:.2f} to {high:.2f}, {confidence_text(interval.level)} confidence)"


def confidence_text(level: float) -> str:
    """Return a confidence as text; one below 1 never reads as 100 %."""
    return f"{100 * level:.4g} %" if level < 0.9999 else f"{100 * level:.6g} %"
