"""The words of results: every sentence about numbers that the terminal, the report and the dashboard show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from valerie.analysis.before_after import Change, Difference
from valerie.analysis.before_after import Comparison as VersionComparison
from valerie.analysis.findings import Finding, Findings, Inequality, Step
from valerie.analysis.frame_counts import ALL
from valerie.analysis.summary import OCCLUDED, OcclusionShare, Summary, SummaryRow
from valerie.labels import NUM_TRAIN_CLASSES
from valerie.measures import measure_of
from valerie.statistics.contrasts import Matching
from valerie.statistics.intervals import Interval, Refusal
from valerie.statistics.units import Estimand

DASH: Final = "–"
_ESTIMANDS: Final[Mapping[Estimand, str]] = {
    Estimand.LISTED_GRID: "the listed variants",
    Estimand.DESIGN_BOX: "the space that the design draws from",
    Estimand.STREETS: "all streets, at the listed variants",
}
#: Largest number of classes that a sentence names one by one.
_NAMED: Final = 4


def percent(value: float | None, digits: int = 1) -> str:
    """Return a rate in per cent without the sign, for columns that state the unit; a dash where undefined."""
    return DASH if value is None else f"{100 * value:.{digits}f}"


def pedestrian(character: str) -> str:
    """Return the title of a pedestrian's row."""
    return "all together" if character == ALL else character


def setting_labels(pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Return a title for each (function, sensor), in the order of ``pairs``; it names the sensor where there are several."""
    distinct = dict.fromkeys(pairs)
    several = len({sensor for _, sensor in distinct}) > 1
    return {
        (function, sensor): f"{function} · sensor {sensor}" if several else function for function, sensor in distinct
    }


def reasons_text(undefined: Mapping[str, int]) -> str:
    """Return how many persons have no pACC and why: ``2 outside the image``."""
    return ", ".join(f"{count:,} {reason}" for reason, count in undefined.items()) or "none"


def classes_text(judged_by: Sequence[str]) -> str:
    """Return the classes of `AllClasses.judged_by`: ``all classes``, ``person alone``, ``12 of the 19 classes``."""
    if len(judged_by) in (0, NUM_TRAIN_CLASSES):
        return "all classes"
    if len(judged_by) > _NAMED:
        return f"{len(judged_by)} of the {NUM_TRAIN_CLASSES} classes"
    *others, last = judged_by
    return f"{', '.join(others)} and {last}" if others else f"{last} alone"


def occlusion_sentence(shares: Sequence[OcclusionShare]) -> str:
    """Return which share of each pedestrian's views is occluded; empty without views."""
    texts = [
        f"{'all' if share.character == ALL else share.character} {percent(share.share)} % of {share.persons:,}"
        for share in shares
        if share.persons
    ]
    return f"More than {100 * OCCLUDED:g} % occluded: {', '.join(texts)}." if texts else ""


def finding_sentence(finding: Finding) -> str:
    """Return a finding as sentences: effect and condition, interval, numbers, and what else differs."""
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
    counted = [f"{finding.places:,} places"]
    counted += [f"{finding.pairs:,} pairs"] if finding.pairs else []
    if finding.low is not None and finding.high is not None:
        # A function is named for being better, so the interval has to point its way.
        sign = -1 if finding.effect < 0 and not finding.function else 1
        ends = sorted(100 * sign * end for end in (finding.low, finding.high))
        low, high = (f"{round(end, 1) + 0.0:.1f}".replace("-", "−") for end in ends)
        counted.insert(0, f"joint 95 % interval {low} to {high}")
    return f"{text} ({', '.join(counted)}).{unequal_sentence(finding.unequal)}"


def _after(step: Step) -> str:
    """Return the factor with its later level; names that contain the factor's stand alone: ``camera-3``."""
    return step.after if step.after.startswith(step.factor) else f"{step.factor} {step.after}"


def unequal_sentence(unequal: Sequence[Inequality]) -> str:
    """Return what else differs between the sides of a finding; empty where nothing does."""
    texts = [
        f"{measure_of(one.column).title} ({measure_of(one.column).text(one.after)} with {_after(one.step)}, "
        f"{measure_of(one.column).text(one.before)} with {one.step.before})"
        for one in unequal
    ]
    return f" The sides also differ in {' and '.join(texts)}." if texts else ""


def searched_sentence(findings: Findings) -> str:
    """Return how findings were found, and what it means that there are none."""
    if not findings.comparisons:
        return "Nothing to compare: vary a parameter, or name several functions."
    looked = f"{findings.comparisons:,} comparisons searched in {findings.places_searched:,} places"
    if not findings.places_confirming:
        return f"{looked}, too few to confirm anything: 10 places are needed."
    sure = f"with {100 * findings.level:g} % confidence for all together"
    none = "" if findings.items else "; none is confirmed"
    return f"{looked}, judged in {findings.places_confirming:,} others {sure}{none}."


def candidate_text(finding: Finding) -> str:
    """Return how a candidate can be settled."""
    return f"To confirm half of it, about {finding.places_needed:,} fresh places would be needed."


def certainty_sentences(rows: Sequence[SummaryRow]) -> list[str]:
    """Return what the brackets of a summary mean, and why intervals are missing."""
    sentences = []
    units = {(one.estimand, one.units) for row in rows if isinstance(one := row.pacc_mean_interval, Interval)}
    if units:
        estimand, most = max(units, key=lambda one: one[1])
        sentences.append(f"[95 % interval] for {_ESTIMANDS[estimand]}, from {most:,} {estimand.noun}.")
    if any(row.pacc_mean_spread for row in rows):
        places = max(row.pacc_mean_spread.places for row in rows if row.pacc_mean_spread)
        sentences.append(f"[Middle 80 % of the means of {places:,} places]: how much places differ.")
    reasons = dict.fromkeys(one.reason for row in rows if isinstance(one := row.pacc_mean_interval, Refusal))
    return sentences + [f"No confidence interval: {reason}." for reason in reasons]


def points(difference: float) -> str:
    """Return a difference of rates in percentage points with its sign."""
    return f"{100 * difference:+.1f}".replace("-", "−")


def limits(summary: Summary, findings: Findings) -> list[str]:
    """Return what the results do not say."""
    first = next((one for row in summary.rows if (one := row.pacc_mean_interval) is not None), None)
    sentences = []
    if first is not None:
        sentences.append(f"Means speak of {_ESTIMANDS[first.estimand]} and of nothing else.")
    if first is not None and first.estimand is Estimand.LISTED_GRID:
        sentences.append(
            "All variants were listed, so nothing is known of what lies between them, or of other streets."
        )
    if findings.places_searched:
        places = findings.places_searched + findings.places_confirming
        sentences.append(f"The run saw {places:,} places. It cannot detect differences that need more places.")
    together = [row for row in summary.rows if row.character == ALL] or list(summary.rows)
    # Visibility alone decides, so functions share their gaps.
    gaps = dict.fromkeys((row.persons, reasons_text(row.undefined)) for row in together if row.undefined)
    sentences += [f"Of {persons:,} views of a person, some have no pACC: {reasons}." for persons, reasons in gaps]
    return sentences


def false_positives_sentence(function: str, sensor: str, interval: Interval) -> str:
    """Return that most pixels which a function calls person belong to none."""
    return (
        f"{function}, sensor {sensor}: {percent(interval.estimate)} % of the pixels that it calls person belong to no person "
        f"(95 % interval {percent(interval.low)} to {percent(interval.high)}, {interval.units:,} {interval.estimand.noun})."
    )


def incomparable_sentence(a: str, b: str, precisions: Mapping[str, str]) -> str:
    """Return why two functions were not compared."""
    first, second = (f"{name} ({precisions.get(name, 'full precision')})" for name in (a, b))
    return f"{first} and {second} ran in different precisions and are not compared."


def change_sentence(change: Change) -> str:
    """Return one change between two versions with its numbers."""
    values = f"{percent(change.before)} → {percent(change.after)} %"
    if change.kind == "class":
        return f"class {change.name}: pooled IoU {values}"
    if change.kind == "score":
        return f"person {measure_of(change.name).title}, pooled: {values}"
    own = change.difference
    assert own is not None
    by_place = f"{100 * own.mean:+.1f} points by place{span_text(own)}, {own.places:,} places"
    return f"{change.name}: mean pACC {values} ({by_place}; {own.lost:,} lost, {own.gained:,} gained)"


def span_text(difference: Difference) -> str:
    """Return the interval of a difference as people read it, ``, 95 % [-0.2, +1.4]``; empty where there is none."""
    if difference.low is None or difference.high is None:
        return ""
    return f", 95 % [{100 * difference.low:+.1f}, {100 * difference.high:+.1f}]"


def numeric_classes_sentence(comparison: VersionComparison) -> str:
    """Return the numeric classes that the versions ran in, with a warning where they differ; empty where unknown."""
    if not comparison.numeric_classes:
        return ""
    if comparison.alike:
        return f"All ran as {comparison.numeric_classes[0]}."
    ran = zip(comparison.versions, comparison.numeric_classes, strict=True)
    return (
        f"Numeric classes differ, so differences may come from precision or engine: "
        f"{'; '.join(f'{version} ran as {numeric_class}' for version, numeric_class in ran)}."
    )
