"""The words of results: every sentence about numbers that the terminal, the report and the dashboard show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from valerie.analysis.before_after import Change
from valerie.analysis.before_after import Comparison as VersionComparison
from valerie.analysis.comparisons import Comparison, FindingKind, Side
from valerie.analysis.frame_counts import ALL
from valerie.analysis.intervals import Interval
from valerie.analysis.summary import OCCLUDED, OcclusionShare
from valerie.labels import NUM_TRAIN_CLASSES
from valerie.measures import measure_of

DASH: Final = "–"
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


def finding_sentence(comparison: Comparison, interval: Interval, *, several_sensors: bool) -> str:
    """Return a comparison as one sentence with its effect, its interval and every n.

    Args:
        comparison: to word.
        interval: of its estimate; both ends have the estimate's sign.
        several_sensors: whether the sentence has to name the sensor setting.
    """
    difference = comparison.difference
    positive = difference.estimate > 0
    size = f"{100 * abs(difference.estimate):.1f} points"
    ends = sorted(100 * abs(end) for end in (interval.low, interval.high))
    within = f"95 % interval {ends[0]:.1f} to {ends[1]:.1f}"
    counted = f"n = {' and '.join(f'{n:,}' for n in difference.n.values())}{' pairs' if difference.paired else ''}"
    behind = f" behind sensor {comparison.sensor}" if several_sensors else ""
    who = comparison.function + behind
    first, second = comparison.first, comparison.second
    better, worse = (first.name, second.name) if positive else (second.name, first.name)
    match comparison.kind:
        case FindingKind.BINS:
            title = measure_of(comparison.column).title
            steps = f"from {title} {_bin_text(comparison.column, second)} to {_bin_text(comparison.column, first)}"
            return f"{who}: pACC {'rises' if positive else 'falls'} by {size} ({within}) {steps}."
        case FindingKind.VALUES:
            name = comparison.column.removeprefix("scene.")
            where, rest = side_text(first), side_text(second)
            return (
                f"{who}: pACC is {'higher' if positive else 'lower'} by {size} where {name} is {where} than "
                f"{f'where it is {rest}' if rest else 'elsewhere'}, on average ({within}; {counted})."
            )
        case FindingKind.CHARACTERS:
            where = "in the same situations" if difference.paired else "on average, in different situations"
            return f"{who} sees {better} better than {worse} {where}: pACC is higher by {size} ({within}; {counted})."
        case FindingKind.FUNCTIONS:
            return (
                f"{better} sees {comparison.character} better than {worse} does on the same pictures{behind}: "
                f"pACC is higher by {size} ({within}; {counted})."
            )
        case FindingKind.FALSE_POSITIVES:
            return (
                f"{who}: {percent(first.mean)} % of the pixels that it calls person belong to no person, "
                f"{size} more than half ({within}; {counted} frames)."
            )


def side_text(side: Side) -> str:
    """Return the value or range of one side: ``red``, ``300°``, ``5–10``; empty for all other values."""
    if side.low is None or side.high is None:
        return side.name
    return f"{side.low:g}{side.unit}" if side.low == side.high else f"{side.low:g}–{side.high:g}{side.unit}"


def _bin_text(column: str, side: Side) -> str:
    assert side.low is not None
    assert side.high is not None
    return f"{measure_of(column).range_text(side.low, side.high)} ({percent(side.mean)} %, n = {side.n:,})"


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
    assert change.interval is not None
    span = f"[{100 * change.interval.low:+.1f}, {100 * change.interval.high:+.1f}]"
    return f"{change.name}: mean pACC {values} ({100 * change.step:+.1f} points, 95 % {span})"


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
