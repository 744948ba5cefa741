"""Sentences about what a run shows for a claim."""

from __future__ import annotations

from typing import Final

from valerie.analysis.claims.claims import DepartureTest, DifferenceTest, FlipTest, QuantityTest, TrendTest
from valerie.analysis.wording import points
from valerie.statistics.contrasts import Contrast, Matching
from valerie.statistics.curves import Changes, Departure

_MATCHINGS: Final = {
    Matching.BLOCKS: "same place and all other factors equal",
    Matching.PLACES: "same place",
    Matching.MODEL: "between places, other factors in a linear model",
}


def quantity_sentence(test: QuantityTest, estimate: float) -> str:
    """Return a statistic and the claimed range."""
    quantity = test.of if test.above is None else f"{test.of} > {test.above:g}"
    claimed = " and ".join(
        f"{sign} {bound:g}" for sign, bound in (("≥", test.low), ("≤", test.high)) if bound is not None
    )
    return f"{test.statistic}({quantity}) is {estimate:.4g}; claimed {claimed}"


def difference_sentence(test: DifferenceTest, contrast: Contrast, low: float, high: float) -> str:
    """Return a difference between two levels with its interval."""
    return (
        f"{test.factor} {test.first} less {test.second}: {points(contrast.estimate)} points "
        f"({points(low)} to {points(high)}; {_MATCHINGS[contrast.matching]}, {contrast.pairs:,} pairs)"
    )


def flip_sentence(test: FlipTest, largest: float, pairs: int) -> str:
    """Return the largest change between two levels."""
    return (
        f"the largest change of {test.factor} alone, from {test.second} to {test.first}, is {points(largest)} points "
        f"({pairs:,} pairs)"
    )


def departure_sentence(test: DepartureTest, left: Departure) -> str:
    """Return where a curve leaves its first level, and the claimed place."""
    best = "never" if left.estimate is None else f"at {left.estimate:.3g}"
    certain = [f"not before {left.not_before:.3g}"] if left.not_before is not None else []
    certain += [f"at {left.at_latest:.3g} at the latest"] if left.at_latest is not None else []
    return (
        f"pACC leaves its first level by {100 * test.by:g} points {best}"
        + (f" ({', '.join(certain)})" if certain else " (the band is too wide to say when)")
        + f"; claimed {test.at:g} ± {test.tolerance:g}"
    )


def trend_sentence(test: TrendTest, changes: Changes) -> str:
    """Return the change from the first to the last third of the rows, the proven shape, and the outer averages."""
    shapes = {(False, False): "", (True, False): "; falls somewhere", (False, True): "; rises somewhere"}
    shape, bins = shapes.get((changes.falls, changes.rises), "; falls and rises"), changes.bins
    return (
        f"pACC over {test.over}: the last third less the first is {points(changes.difference)} points "
        f"({points(changes.low)} to {points(changes.high)}){shape}; {100 * bins.mean[0]:.1f} % at {bins.centre[0]:.3g}, "
        f"{100 * bins.mean[-1]:.1f} % at {bins.centre[-1]:.3g}"
    )
