"""Sentences about the reasons of strategies: what was known, what is uncertain, and what a batch decides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Final

from valerie.analysis.wording import counted
from valerie.guided.strategy import Reason, Why

_Numbers = Mapping[str, float]


def reason_text(reason: Reason, names: Sequence[str]) -> str:
    """Return the reason for a batch in three sentences, or the reason for no more points in one.

    Args:
        reason: as a strategy states it; one that is none of `Why` is shown by its name and numbers.
        names: names of the parameters, by dimension.
    """
    numbers, about = reason.numbers, ", ".join(names[dimension] for dimension in reason.parameters)
    match reason.name:
        case Why.FIRST | Why.UNMODELLED:
            return _first(numbers, modelled=reason.name == Why.FIRST)
        case Why.DOUBTFUL:
            return _doubtful(numbers)
        case Why.SEARCH:
            return _search(numbers)
        case Why.BORDER:
            return _border(numbers)
        case Why.SCREENING:
            return _screening(numbers)
        case Why.BLOCKS:
            return _blocks(numbers)
        case Why.JUDGING:
            return _judging(numbers)
        case Why.PAIRING:
            return _pairing(numbers)
        case Why.CHEAP | Why.COSTLY:
            return _engine(numbers, costly=reason.name == Why.COSTLY)
        case Why.DRAWN:
            return (
                f"{_known(numbers)} A pair needs one variant that fails and one that passes. "
                f"{_points(numbers)}, drawn as they occur in operation, should contain what is missing."
            )
        case Why.GIVEN:
            return (
                "Two variants are given. Their verdicts are not known yet. "
                "This batch shows whether one fails and the other passes."
            )
        case Why.NEEDED:
            return (
                f"A failing and a passing variant differ in {about}. Some of these changes may not be needed for the failure. "
                f"{_points(numbers)} with only a part of the changes: if one fails, the other changes are dropped."
            )
        case Why.BOUNDARY:
            return (
                f"The failure needs the changes of {about}. The place where the verdict flips on the way is not known. "
                f"{_points(numbers)} on the way between pass and fail narrow it down."
            )
        case Why.REMOVAL:
            return (
                f"The variant fails with the changes of {about}. One of them may be superfluous by now. "
                f"{_points(numbers)} undo one change each: a change without which it still fails is dropped."
            )
        case Why.NO_PAIR:
            scores = " and ".join(
                f"{numbers[name]:.3g}" if isfinite(numbers[name]) else "undefined" for name in ("failing", "passing")
            )
            return f"The given variants do not fail and pass: their scores are {scores}, and {numbers['at_least']:g} passes."
        case Why.ILLEGAL_BLOCKS:
            return (
                f"{numbers['illegal']} of {numbers['drawn']} blocks have illegal variants, so there will be no shares of "
                "variance: widen the ranges or relax the constraints."
            )
    if reason.name in _WITHOUT_POINTS:
        return _WITHOUT_POINTS[Why(reason.name)]
    listed = ", ".join(f"{name} {value:g}" for name, value in numbers.items())
    return f"{reason.name}: {listed}." if listed else f"{reason.name}."


#: Sentences about no points.
_WITHOUT_POINTS: Final = {
    Why.FIRST_SCORES: "The first points have to be scored before guided ones.",
    Why.SCREENING_SCORES: "The blocks follow from screening scores that are missing.",
    Why.DECIDED: "The requirement is decided.",
    Why.NARROW: "The interval is narrow enough.",
    Why.VERDICTS: "The next variants follow from verdicts that are missing.",
    Why.MINIMAL: "The pair is minimal.",
}


def _points(numbers: _Numbers, name: str = "points") -> str:
    return counted(int(numbers[name]), "point")


def _known(numbers: _Numbers) -> str:
    if not numbers["scored"]:
        return "No score is known yet."
    return f"{numbers['failed']:,} of {counted(int(numbers['scored']), 'score')} fail."


def _first(numbers: _Numbers, *, modelled: bool) -> str:
    model = f"which starts after the first {numbers['first']:,}" if modelled else "which still lacks scores"
    return (
        f"{_known(numbers)} It is open how often variants fail. "
        f"{_points(numbers)} as they occur in operation estimate it without a model, {model}."
    )


def _doubtful(numbers: _Numbers) -> str:
    operational = _points(numbers, "operational")
    return (
        f"{_known(numbers)} A model of the scores expects {100 * numbers['expected']:.1f} % failures in operation, "
        f"which may be wrong where it has no points. {operational} as they occur in operation test it and estimate the "
        f"rate without it; {_points(numbers, 'doubtful')} where it is unsure of the verdict narrow the assisted estimate."
    )


def _search(numbers: _Numbers) -> str:
    known = f"{counted(int(numbers['modes']), 'mode')} known after {_points(numbers, 'explored')} that explored."
    open_ = f"A mode below {100 * numbers['smallest']:.2g} % of the operational domain may well be unmet."
    if not numbers["explored"]:
        known, open_ = "No score is known yet.", "It is open where failures lie, and in how many modes."
    parts = [f"{_points(numbers, 'exploring')} explore the operational domain for new modes"]
    if numbers["descending"]:
        lows = counted(int(numbers["low"]), "low score")
        parts.append(f"{numbers['descending']} descend from {lows} to see whether a mode lies below")
    if numbers["checking"]:
        parts.append(f"{numbers['checking']} decide whether failures repeat and are connected")
    return f"{known} {open_} {'; '.join(parts)}."


def _border(numbers: _Numbers) -> str:
    if not numbers["doubtful"]:
        known = f"{counted(int(numbers['scored']), 'score')} known." if numbers["scored"] else "No score is known yet."
        return (
            f"{known} Too few to draw a boundary between pass and fail. "
            f"{_points(numbers, 'exploring')} explore the operational domain for a first map."
        )
    return (
        f"A map rests on {counted(int(numbers['scored']), 'score')}. Along its boundary and far from points, it may be wrong. "
        f"{_points(numbers, 'doubtful')} lie where pass and fail are least sure, and {numbers['exploring']} explore: they test "
        "the map."
    )


def _screening(numbers: _Numbers) -> str:
    known = f"{counted(int(numbers['scored']), 'score')} of the screening known." if numbers["scored"] else ""
    return (
        f"{known or 'No score is known yet.'} It is open which of the {numbers['parameters']} parameters matter. "
        f"{_points(numbers)} of {numbers['walks']} walks, which change one parameter after another, screen out those that "
        "hardly do."
    )


def _blocks(numbers: _Numbers) -> str:
    blocks, fewest = int(numbers["blocks"]), numbers["fewest"]
    missing = f"; shares of variance need {fewest}" if blocks < fewest else ""
    return (
        f"The screening put {numbers['screened']} of {numbers['parameters']} parameters aside, and "
        f"{counted(blocks, 'block')} ended{missing}. The parameters' parts in the variance are uncertain. "
        f"{_points(numbers)} of further blocks narrow them, and show whether those put aside matter after all."
    )


def _judging(numbers: _Numbers) -> str:
    bound = f"{numbers['bound']:g} required"
    known = f"No score is known yet; {bound}."
    if numbers["scored"]:
        known = f"{numbers['estimate']:.3f} on average over {counted(int(numbers['scored']), 'score')} (1 is best), {bound}."
    open_ = "The requirement is undecided, and the estimate too close to the bound for a forecast."
    if "further" in numbers:
        open_ = f"The requirement is undecided: about {numbers['further']:,} more decide if the estimate is right."
    elif "cheapest" in numbers:
        open_ = f"The requirement is undecided: without any failure, {numbers['cheapest']:,} would decide."
    elif not numbers["scored"]:
        open_ = "The requirement is undecided."
    return f"{known} {open_} {_points(numbers)} as they occur in operation continue the test."


def _pairing(numbers: _Numbers) -> str:
    pairs = int(numbers["pairs"])
    known = f"{counted(pairs, 'pair')} of scores so far; an interval needs {numbers['fewest']}."
    open_ = f"The difference is not known to ± {numbers['within']:g}."
    if "further" in numbers:
        known = (
            f"The difference is {numbers['estimate']:+.3f} ± {numbers['half_width']:.3f} over {counted(pairs, 'pair')}."
        )
        open_ = f"It is requested to ± {numbers['within']:g}: about {numbers['further']:,} more at the present spread."
    return f"{known} {open_} {_points(numbers)} as they occur in operation, for both functions, narrow it."


def _engine(numbers: _Numbers, *, costly: bool) -> str:
    pairs, ratio = int(numbers["pairs"]), numbers["ratio"]
    known = f"{counted(pairs, 'pair')} of both engines and {numbers['cheap']:,} cheap scores"
    if isfinite(numbers["correlation"]):
        known += f", with a correlation of {numbers['correlation']:.2f}"
    open_ = f"How well the cheap engine foretells the costly one is open before {numbers['fewest']} pairs."
    if pairs >= numbers["fewest"]:
        open_ = "The estimate for the costly engine is still uncertain."
        if isfinite(ratio):
            open_ += f" About {ratio:.1f} cheap points for each costly one narrow it at the lowest price."
    engine = (
        "for the costly engine, at variants that the cheap one has seen, extend the pairs"
        if costly
        else "for the cheap engine, as they occur in operation, extend what the pairs are compared with"
    )
    return f"{known}. {open_} {_points(numbers)} {engine}."
