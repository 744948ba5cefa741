"""Sentences about what a run shows for a claim."""

from __future__ import annotations

from typing import Final

from valerie.analysis.claims.claims import DepartureTest, DifferenceTest, FlipTest, QuantityTest, TrendTest
from valerie.analysis.wording import NO_INTERVAL, percent, points
from valerie.measures import BY_NAME
from valerie.statistics.contrasts import Contrast, Matching
from valerie.statistics.curves import Changes, Departure

_MATCHINGS: Final = {
    Matching.BLOCKS: "same place and all other factors equal",
    Matching.PLACES: "same place",
    Matching.MODEL: "between places, other factors in a linear model",
}

_STATISTICS: Final = {"minimum": "smallest", "maximum": "largest"}


def title_of(column: str) -> str:
    """Return the title of a measure, or the name of another column."""
    return BY_NAME[column].title if column in BY_NAME else column


def _value(column: str, value: float) -> str:
    """Return a value of a column with its unit, as far as that is known."""
    return BY_NAME[column].text(value) if column in BY_NAME else f"{value:.3g}"


def quantity_sentence(test: QuantityTest, estimate: float) -> str:
    """Return a statistic and the claimed range."""
    if test.above is None:
        quantity = f"{_STATISTICS.get(test.statistic, test.statistic)} {title_of(test.of)}"
    else:
        quantity = f"share of persons with {title_of(test.of)} above {_value(test.of, test.above)}"

    def text(value: float) -> str:
        return _value(test.of, value) if test.above is None else f"{percent(value)} %"

    claimed = " and ".join(
        f"{bounded} {text(bound)}"
        for bounded, bound in (("at least", test.low), ("at most", test.high))
        if bound is not None
    )
    return f"{quantity} is {text(estimate)}; claimed {claimed}"


def difference_sentence(test: DifferenceTest, contrast: Contrast, low: float, high: float) -> str:
    """Return a difference between two levels with its interval, or why it has none."""
    ends = NO_INTERVAL if contrast.alike else f"{points(low)} to {points(high)}"
    return (
        f"{test.factor} {test.first} less {test.second}: {points(contrast.estimate)} points "
        f"({ends}; {_MATCHINGS[contrast.matching]}, {contrast.pairs:,} pairs)"
    )


def flip_sentence(test: FlipTest, largest: float, pairs: int) -> str:
    """Return the largest change between two levels."""
    return (
        f"the largest change of {test.factor} alone, from {test.second} to {test.first}, is {points(largest)} points "
        f"({pairs:,} pairs)"
    )


def departure_sentence(test: DepartureTest, left: Departure, *, alike: bool) -> str:
    """Return where a curve leaves its first level, with the interval of that place unless places are ``alike``, and the claim."""
    leaves, change = f"over {title_of(test.over)}, pACC", f"its first level by {100 * test.by:g} points"
    if left.estimate is None:
        best = f"{leaves} nowhere leaves {change}"
    else:
        best = f"{leaves} leaves {change} at {_value(test.over, left.estimate)}"
    first, last = (None if x is None else _value(test.over, x) for x in (left.not_before, left.at_latest))
    certain = {
        (True, True): f"95 %: from {first} to {last}",
        (True, False): f"95 %: after {first}, or nowhere",
        (False, True): f"95 %: by {last}, perhaps at once",
        (False, False): "95 %: anywhere or nowhere",
    }[first is not None, last is not None]
    claimed = f"{_value(test.over, test.at - test.tolerance)} to {_value(test.over, test.at + test.tolerance)}"
    return f"{best} ({NO_INTERVAL if alike else certain}); claimed {claimed}"


def trend_sentence(test: TrendTest, changes: Changes) -> str:
    """Return the change from the first to the last third of the rows, the proven shape, and the outer averages."""
    shapes = {(False, False): "", (True, False): "; falls somewhere", (False, True): "; rises somewhere"}
    shape, bins = shapes.get((changes.falls, changes.rises), "; falls and rises"), changes.bins
    title = title_of(test.over)
    ends = NO_INTERVAL if changes.alike else f"{points(changes.low)} to {points(changes.high)}"
    first, last = (f"{percent(bins.mean[k])} % ({title} {_value(test.over, bins.centre[k])})" for k in (0, -1))
    return (
        f"pACC over {title}: the last third less the first is {points(changes.difference)} points "
        f"({ends}){shape}; from {first} to {last}"
    )
