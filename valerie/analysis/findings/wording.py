"""Sentences about findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from valerie.analysis.findings.findings import Finding, Findings, Inequality, PictureFault, Step
from valerie.analysis.wording import ALIKE_PLACES, for_whom, percent, place_noun, population, unit_noun
from valerie.measures import measure_of
from valerie.statistics.contrasts import Matching
from valerie.statistics.importance import Importance
from valerie.statistics.intervals import Interval


def finding_sentence(finding: Finding) -> str:
    """Return a finding as sentences: effect and condition, interval, numbers, and other differences of the sides."""
    step = finding.steps[0]
    size = f"{100 * abs(finding.effect):.1f} points"
    higher = "higher" if finding.effect > 0 else "lower"
    if len(finding.steps) == 2:
        second = finding.steps[1]
        text = (
            f"{finding.function}: the effect of {_after(step)} instead of {step.before} on pACC is {size} {higher} "
            f"with {_after(second)} than with {second.before}"
        )
    elif not finding.function:
        better, worse = (step.after, step.before) if finding.effect > 0 else (step.before, step.after)
        text = f"{better} sees more than {worse} on identical frames: pACC is {size} higher"
    else:
        text = f"{finding.function}: pACC is {size} {higher} with {_after(step)} than with {step.before}"
    if finding.matching is Matching.MODEL:
        text += ", between different places"
    elif finding.function:
        text += ", all else equal"
    places = f"{finding.places:,} {place_noun(finding.estimand)}"
    counted = [f"in the {places} searched" if finding.searched else places]
    counted += [f"{finding.pairs:,} pair{'s' if finding.pairs > 1 else ''}"] if finding.pairs else []
    if finding.low is not None and finding.high is not None:
        # The better function is named first, so the interval takes its sign.
        sign = -1 if finding.effect < 0 and not finding.function else 1
        low, high = map(percent, sorted(sign * end for end in (finding.low, finding.high)))
        counted.insert(0, f"joint 95 % interval {low} to {high} points{for_whom(finding.estimand)}")
    fault = "" if finding.picture_fault is None else f"{picture_fault_sentence(finding.picture_fault)} "
    return f"{fault}{text} ({', '.join(counted)}).{_size_sentence(finding)}{unequal_sentence(finding.unequal)}"


def _size_sentence(finding: Finding) -> str:
    """Return how many places would show the size of an effect; empty if these do."""
    if finding.places_for_size is None:
        return ""
    enough = f"about {finding.places_for_size:,} {place_noun(finding.estimand)} would."
    if not finding.confirmed:
        return f" They do not show its size; {enough}"
    higher = "higher" if finding.effect > 0 or not finding.function else "lower"
    return f" They show that it is {higher}, not by how much (those that suggested it do not count); {enough}"


def picture_fault_sentence(fault: PictureFault) -> str:
    """Return that faulty pictures carry a finding, and what is left without them."""
    left = (
        "nothing is left to compare" if fault.left is None else f"the difference is {100 * abs(fault.left):.1f} points"
    )
    return f"A fault of the picture: {percent(fault.share)} % of these views are {fault.fault}; without faulty ones {left}."


def _after(step: Step) -> str:
    """Return the factor with its later level, or the level alone where it starts with the factor: ``camera-3``."""
    return step.after if step.after.startswith(step.factor) else f"{step.factor} {step.after}"


def unequal_sentence(unequal: Sequence[Inequality]) -> str:
    """Return the measured differences between the sides of a finding; empty if there are none."""
    texts = [
        f"{measure_of(entry.column).title} ({measure_of(entry.column).text(entry.after)} with {_after(entry.step)}, "
        f"{measure_of(entry.column).text(entry.before)} with {entry.step.before})"
        for entry in unequal
    ]
    return f" The sides also differ in {' and '.join(texts)}." if texts else ""


def searched_sentence(findings: Findings) -> str:
    """Return how the findings were searched, and if any is confirmed."""
    if not findings.comparisons:
        return "Nothing to compare: vary a parameter, or name several functions."
    found = (*findings.items, *findings.candidates)
    places = place_noun(found[0].estimand) if found else "places"
    looked = f"{findings.comparisons:,} comparisons searched in {findings.places_searched:,} {places}"
    if not findings.places_confirming:
        return f"{looked}, too few to confirm anything: 10 {places} are needed."
    sure = f"with {100 * findings.level:g} % confidence for all together"
    none = "" if findings.items else "; none is confirmed"
    return f"{looked}, judged in {findings.places_confirming:,} others {sure}{none}."


def candidate_text(finding: Finding) -> str:
    """Return how a candidate can be settled."""
    if finding.alike:
        return f"{ALIKE_PLACES.capitalize()}: repeat the grid on several sites to confirm it."
    places = place_noun(finding.estimand)
    return f"To confirm an effect half as large, about {finding.places_needed:,} fresh {places} are needed."


def alike_sentence(function: str) -> str:
    """Return why some differences stay candidates; no function: those between functions."""
    whose = f"{function}: " if function else "Between functions: "
    return f"{whose}in some differences, {ALIKE_PLACES}; these stay candidates. Repeat the grid on several sites to confirm them."


def measured_note(measured: Sequence[Importance]) -> str:
    """Return why no measured quantity is named or tested; empty if they are tested."""
    if not measured:
        return "Measured quantities are not tested: too few places, or nothing measured that differs."
    if measured[0].alike:
        return f"Of measured quantities, none is named: {ALIKE_PLACES}. Repeat the grid on several sites."
    return ""


def false_positives_sentence(function: str, sensor: str, interval: Interval) -> str:
    """Return the share of false person pixels of a function with its interval."""
    return (
        f"{function}, sensor {sensor}: {percent(interval.estimate)} % of the pixels that it calls person belong to no person "
        f"(95 % interval {percent(interval.low)} to {percent(interval.high)} for {population(interval.estimand)}, from "
        f"{interval.units:,} {unit_noun(interval.estimand)})."
    )


def incomparable_sentence(a: str, b: str, precisions: Mapping[str, str]) -> str:
    """Return why two functions were not compared."""
    first, second = (f"{name} ({precisions.get(name, 'full precision')})" for name in (a, b))
    return f"{first} and {second} ran in different precisions and are not compared."
