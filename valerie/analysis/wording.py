"""Wording shared by all texts about results: rates, titles and reasons."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from valerie.analysis.rows.frame_counts import ALL
from valerie.labels import NUM_TRAIN_CLASSES
from valerie.statistics.units import Estimand

DASH: Final = "–"
#: Largest number of classes that a sentence names one by one.
_NAMED: Final = 4
#: Why there is no interval.
ALIKE_PLACES: Final = "neighbouring places score alike, so they are no independent evidence"
#: What stands in place of the interval.
NO_INTERVAL: Final = f"of these places, no interval: {ALIKE_PLACES}"
_POPULATIONS: Final = {
    Estimand.LISTED_GRID: "the listed variants",
    Estimand.DESIGN_BOX: "the space that the design draws from",
    Estimand.SITES: "all sites that the asset generates, at the listed variants",
}


def minus(number: str) -> str:
    """Return the text of a computed number with a minus sign instead of a hyphen.

    Values of parameters keep the hyphen, as a spec writes them.
    """
    return number.replace("-", "−")


def percent(value: float | None, digits: int = 1) -> str:
    """Return a rate in per cent without the sign, for columns that state the unit; a dash where undefined."""
    if value is None:
        return DASH
    return minus(f"{round(100 * value, digits) + 0.0:.{digits}f}")


def pedestrian(character: str) -> str:
    """Return the title of a pedestrian's row."""
    return "all together" if character == ALL else character


def setting_labels(pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Return a title for each (function, sensor), in the order of ``pairs``; it names the sensor if there are several."""
    distinct = dict.fromkeys(pairs)
    several = len({sensor for _, sensor in distinct}) > 1
    return {
        (function, sensor): f"{function} · sensor {sensor}" if several else function for function, sensor in distinct
    }


def reasons_text(undefined: Mapping[str, int]) -> str:
    """Return the numbers and reasons of persons without pACC: ``2 outside the image``."""
    return ", ".join(f"{count:,} {reason}" for reason, count in undefined.items()) or "none"


def classes_text(judged_by: Sequence[str]) -> str:
    """Return the classes of `AllClasses.judged_by`: ``all classes``, ``person alone``, ``12 of the 19 classes``."""
    if len(judged_by) in (0, NUM_TRAIN_CLASSES):
        return "all classes"
    if len(judged_by) > _NAMED:
        return f"{len(judged_by)} of the {NUM_TRAIN_CLASSES} classes"
    *others, last = judged_by
    return f"{', '.join(others)} and {last}" if others else f"{last} alone"


def unit_noun(estimand: Estimand) -> str:
    """Return the name of sampling units, in the plural."""
    return "sites" if estimand is Estimand.SITES else "variants"


def place_noun(estimand: Estimand) -> str:
    """Return the name of the places whose differences are compared, in the plural."""
    return "sites" if estimand is Estimand.SITES else "places"


def population(estimand: Estimand) -> str:
    """Return the population of a mean."""
    return _POPULATIONS[estimand]


def population_of_differences(estimand: Estimand) -> str:
    """Return the population of a difference with an interval by place.

    Places of a listed grid count as exchangeable with further places of their site.
    """
    return "places like these on this site" if estimand is Estimand.LISTED_GRID else population(estimand)


def for_whom(estimand: Estimand) -> str:
    """Return the population of the interval of a difference: `` for places like these on this site``."""
    return f" for {population_of_differences(estimand)}"


def counted(count: int, what: str) -> str:
    """Return a number of things: ``1 mode``, ``2 modes``."""
    return f"{count:,} {what}" if count == 1 else f"{count:,} {what}s"


def points(difference: float) -> str:
    """Return a difference of rates in percentage points with its sign."""
    return minus(f"{round(100 * difference, 1) + 0.0:+.1f}")
