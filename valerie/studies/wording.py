"""Sentences about the reasons and results of strategies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Final

import numpy as np

from valerie.guided.cascade import TwoEngines
from valerie.guided.compare import Difference
from valerie.guided.domain import shown
from valerie.guided.estimate import FailureRate
from valerie.guided.explain import MinimalPair, Verdict
from valerie.guided.find import Mode, Modes
from valerie.guided.map import TESTED, WRONG, Boundary, Call
from valerie.guided.rank import Effect, Ranking
from valerie.guided.strategy import Reason, Result, Why
from valerie.guided.verify import Verification
from valerie.parameters.samplers import UnitPoints
from valerie.runs.study.study_document import CascadeGoal, CompareGoal, VerifyGoal
from valerie.statistics.intervals import Interval
from valerie.studies.resolved import ResolvedStudy


def result_sentences(known: Result, study: ResolvedStudy) -> tuple[str, ...]:
    """Return the result of a study in words, the most important sentence first."""
    match known:
        case FailureRate():
            return _failure_rate(known)
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
    raise TypeError(f"no words for {type(known).__name__}")


def reason_text(reason: Reason, names: Sequence[str]) -> str:
    """Return the reason for a batch, or for no more points, in one sentence.

    Args:
        reason: as a strategy states it; one that is none of `Why` is shown by its name and numbers.
        names: names of the parameters, by dimension.
    """
    numbers, about = reason.numbers, ", ".join(names[dimension] for dimension in reason.parameters)
    match reason.name:
        case Why.OPERATIONAL:
            return f"{numbers['points']} points as they occur in operation{_decide(numbers)}."
        case Why.DOUBTFUL:
            return (
                f"{numbers['operational']} points as they occur in operation, and {numbers['doubtful']} where the model of "
                f"the earlier scores is unsure whether they fail; it expects {numbers['expected']:.1%} failures."
            )
        case Why.SEARCH:
            descents = f", {numbers['descending']} descend from {numbers['low']} low scores"
            checks = f", {numbers['checking']} check whether failures repeat and are connected"
            more = (descents if numbers["descending"] else "") + (checks if numbers["checking"] else "")
            return f"{numbers['exploring']} points explore the operational domain{more}."
        case Why.BORDER:
            doubtful = f", {numbers['doubtful']} lie where pass and fail are least sure" if numbers["doubtful"] else ""
            return f"{numbers['exploring']} points explore{doubtful}."
        case Why.SCREENING:
            return f"{numbers['walks']} walks screen {numbers['parameters']} parameters."
        case Why.BLOCKS:
            return f"Blocks for the indices of {numbers['groups']} parameters or groups of them."
        case Why.CHEAP | Why.COSTLY:
            ratio = numbers["ratio"]
            pairs = f"about {ratio:.1f} cheap points for each costly one" if isfinite(ratio) else "the first pairs"
            return f"{numbers['points']} {reason.name}: {pairs}."
        case Why.NO_PAIR:
            scores = f"{numbers['failing']:.3g} and {numbers['passing']:.3g}"
            return f"The given variants do not fail and pass: their scores are {scores}, and {numbers['at_least']:g} passes."
        case Why.BOUNDARY:
            return f"How far must {about} change before the verdict flips?"
        case Why.REMOVAL:
            return f"Does the variant still fail without one of the changes of {about}?"
    if reason.name in _REASONS:
        return _REASONS[Why(reason.name)]
    listed = ", ".join(f"{name} {value:g}" for name, value in numbers.items())
    return f"{reason.name}: {listed}." if listed else f"{reason.name}."


def _decide(numbers: Mapping[str, float]) -> str:
    if "cheapest" in numbers:
        return f"; without any failure, {numbers['cheapest']:,} would decide"
    return f"; about {numbers['further']:,} more decide if the estimate is right" if "further" in numbers else ""


#: Sentences without numbers.
_REASONS: Final = {
    Why.FIRST_SCORES: "The first points have to be scored before guided ones.",
    Why.SCREENING_SCORES: "The blocks follow from screening scores that are missing.",
    Why.DECIDED: "The requirement is decided.",
    Why.NARROW: "The interval is narrow enough.",
    Why.DRAWN: "Variants as they occur in operation, until one fails and one passes.",
    Why.GIVEN: "The two given variants: does one fail, and does the other pass?",
    Why.VERDICTS: "The next variants follow from verdicts that are missing.",
    Why.NEEDED: "Which of the changed parameters are needed for the failure?",
    Why.MINIMAL: "The pair is minimal.",
}


def _failure_rate(known: FailureRate) -> tuple[str, ...]:
    free = f"Of the legal variants, {_between(known.assumption_free)} fail, by operational points alone."
    hidden = f"A mode of failures that no operational point hit has a probability of at most {known.hidden_mode:.2%}."
    undefined = f"The score of {_between(known.undefined)} is undefined." if known.undefined.estimate else ""
    assisted = ""
    if known.assisted is not None:
        use = "" if known.calibrated else ", but do not use it: too many failures lay where the model expected none"
        assisted = f"With the model's help it is {_between(known.assisted)}{use}."
    return tuple(filter(None, (free, assisted, undefined, hidden)))


def _modes(known: Modes, study: ResolvedStudy) -> tuple[str, ...]:
    return (
        f"{_counted(len(known.modes), 'mode')} in {_counted(known.failures, 'repeated failure')}.",
        f"Not placed yet: {_counted(known.unplaced, 'failure')}. Not repeated: {known.unrepeated}.",
        *(_mode(number, mode, known, study) for number, mode in enumerate(known.modes, 1)),
        f"A mode that holds at least {100 * known.smallest:.2g} % of the operational domain was met with 95 % probability.",
    )


def _mode(number: int, mode: Mode, known: Modes, study: ResolvedStudy) -> str:
    # Failures that are not placed yet may belong to it.
    share = f"{'at least' if known.unplaced else 'about'} {100 * mode.probability:.2g} % of the domain"
    share = share if mode.explored else "met by a descent alone"
    near = [
        f"{study.domain.names[i]} near {value}" for i, value in _shown(mode.example, study).items() if i in mode.narrow
    ]
    return f"Mode {number}: {', '.join((share, _counted(mode.failures, 'failure'), *near))}."


def _boundary(known: Boundary) -> tuple[str, ...]:
    shares = {
        Call.PASS: known.passing,
        Call.FAIL: known.failing,
        Call.UNDEFINED: known.undefined,
        Call.NOT_KNOWN: known.not_known,
    }
    return (
        ", ".join(f"{call}: {100 * share:.1f} %" for call, share in shares.items()) + " of the operational domain.",
        f"Of {known.tested} points called before their scores were told, {100 * known.wrong:.1f} % were called wrongly."
        if known.tested
        else f"No verdict yet: {TESTED} points must be called before their scores are told, {100 * WRONG:g} % wrongly at most.",
    )


def _minimal_pair(known: MinimalPair, study: ResolvedStudy) -> tuple[str, ...]:
    domain = study.domain
    units = [f" {definition.unit}" if definition.unit else "" for definition in domain.definitions]
    before, last, after = (_shown(point, study) for point in (known.passing, known.inner, known.failing))
    changes = [f"{domain.names[i]} from {before[i]} to {after[i]}{units[i]}" for i in known.changed]
    flips = f"The verdict flips with {' and '.join(changes)}, everything else equal."
    if np.array_equal(known.inner, known.passing):
        return (flips,)
    inner, failing = (list(domain.values(point).values()) for point in (known.inner, known.failing))
    still = [f"{domain.names[i]} {last[i]}{units[i]}" for i in known.changed if inner[i] != failing[i]]
    verdict = "passes" if known.inner_verdict is Verdict.PASS else "has no score"
    return flips, f"The variant still {verdict} at {' and '.join(still)}."


def _verification(known: Verification, study: ResolvedStudy) -> tuple[str, ...]:
    goal = study.document.goal
    of_share = isinstance(goal, VerifyGoal) and goal.share is not None
    what = f"share of scores of at least {study.measure.at_least:g}" if of_share else "mean score"
    sentences = [f"{known.outcome.capitalize()}: the {what} is {known.estimate:.3f}, {known.bound:g} required."]
    if known.decided_after is not None:
        sentences.append(f"{known.decided_after:,} scores decided.")
    elif known.further is not None:
        sentences.append(f"About {known.further:,} further scores decide if the estimate is right.")
    else:
        sentences.append("The estimate is too close to the bound for any affordable number of scores.")
    if known.undefined:
        sentences.append(f"{known.undefined:,} scores are undefined and left out.")
    return tuple(sentences)


def _difference(known: Difference, study: ResolvedStudy) -> tuple[str, ...]:
    goal, functions = study.document.goal, study.document.spec.functions
    what = "share of passing scores" if isinstance(goal, CompareGoal) and goal.of == "share" else "mean score"
    interval = f"{known.estimate:+.3f} ({known.low:+.3f} … {known.high:+.3f})"
    return (
        f"The {what} of {functions[1]} less that of {functions[0]}: {interval}.",
        "It is undecided which is better." if known.better is None else f"Better: {functions[known.better]}.",
    )


def _ranking(known: Ranking, study: ResolvedStudy) -> tuple[str, ...]:
    sentences = [_effect(effect, study) for effect in known.effects]
    if known.refused:
        of = known.blocks + known.broken
        sentences.append(f"{known.broken} of {of} blocks lack a score, so there are no shares of variance.")
    elif known.broken:
        sentences.append(f"{known.broken} blocks that lack a score are left out.")
    return tuple(sentences)


def _effect(effect: Effect, study: ResolvedStudy) -> str:
    name = "The others together" if effect.dimension is None else study.domain.names[effect.dimension]
    if effect.total is None or effect.alone is None:
        return f"{name}: mean elementary effect {effect.elementary:.3f}."
    return (
        f"{name}: {100 * effect.total.estimate:.0f} % of the variance with interactions "
        f"({100 * effect.total.low:.0f} … {100 * effect.total.high:.0f}), {100 * effect.alone.estimate:.0f} % alone."
    )


def _two_engines(known: TwoEngines, study: ResolvedStudy) -> tuple[str, ...]:
    goal = study.document.goal
    what = "failure rate" if isinstance(goal, CascadeGoal) and goal.of == "rate" else "mean score"
    interval = f"{known.estimate:.4f} ({known.low:.4f} … {known.high:.4f})"
    return (
        f"The {what} by the costly engine is {interval}: {known.method}.",
        f"{known.costly:,} costly and {known.cheap:,} cheap points; the engines correlate with {known.correlation:.2f}.",
    )


def _shown(point: UnitPoints, study: ResolvedStudy) -> dict[int, str]:
    """Return the values of a point, (dimensions,), as text by dimension."""
    return {dimension: shown(value) for dimension, value in enumerate(study.domain.values(point).values())}


def _between(interval: Interval) -> str:
    return f"{interval.estimate:.2%} ({interval.low:.2%} to {interval.high:.2%}, {interval.level:.0%})"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
