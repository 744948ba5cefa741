"""Houses side by side along a line."""

from __future__ import annotations

import math

import numpy as np

from urban_street.street.plan import Spot
from urban_street.street.planning import StreetPlan, seed_of

#: Styles of houses, and the ones that close a view.
HOUSE_STYLES = ("brick", "classic", "plain", "gable", "shop", "mansard", "bay", "timber", "modern")
ENDS = ("brick", "classic", "plain", "shop", "mansard", "bay", "modern")
#: Styles of corner houses.
CORNERS = ("brick", "classic", "plain", "shop")
#: Styles whose gables face the street, for narrow plots only.
NARROW = {"gable", "timber"}
HOUSE_DEPTH = 11.0


def add_row(
    plan: StreetPlan, rng: np.random.Generator, spot: Spot, length: float, corners: tuple[bool, bool] = (False, False)
) -> None:
    """Add houses whose fronts form a line of ``length`` metres that begins at ``spot``, their left end seen from the street.

    Args:
        corners: True if the walls at the two ends of the row are second fronts.
    """
    at, previous = 0.0, ""
    while at < length - 0.1:
        width = next_width(rng, length - at)
        corner = -1.0 if corners[0] and at == 0.0 else 1.0 if corners[1] and at + width > length - 0.1 else None
        styles = HOUSE_STYLES if corner is None else CORNERS
        style = str(rng.choice([s for s in styles if s != previous and not (s in NARROW and width > 12.5)]))
        x, y = spot.x + at * math.cos(spot.heading), spot.y + at * math.sin(spot.heading)
        add_house(plan, rng, style, Spot(x, y, spot.heading), width, corner=corner)
        at, previous = at + width, style


def next_width(rng: np.random.Generator, rest: float) -> float:
    """Return the width of the next house of a row with ``rest`` metres left."""
    width = float(rng.uniform(9.0, 15.5))
    if rest < width + 9.0:
        width = rest if rest < 16.0 else 0.5 * rest
    return width


def add_house(
    plan: StreetPlan, rng: np.random.Generator, style: str, spot: Spot, width: float, depth: float = HOUSE_DEPTH, *,
    corner: float | None = None, floors: tuple[int, ...] = (4, 5),
) -> None:  # fmt: skip
    """Add a house, with the left end of its front at ``spot``, and its footprint; width and depth in metres.

    The wall at its left end (``corner`` −1) or its right end (1) can be a second front. ``floors`` are its possible numbers.
    """
    bays, door = bays_of(width, rng)
    house = plan.add(
        "building", style, spot.x, spot.y, z=plan.lines.kerb_height, heading=spot.heading, seed=seed_of(rng),
        size=(round(width, 3), depth, bays, door, *(() if corner is None else (corner,))),
        variant=floors[int(rng.integers(len(floors)))],
    )  # fmt: skip
    plan.block(house, spot.outline((0.0, 0.0), (width, depth)))


def bays_of(width: float, rng: np.random.Generator) -> tuple[int, int]:
    """Return the number of window axes of a front, and the index of the axis with the door."""
    bays = max(round(width / float(rng.uniform(2.35, 2.9))), 3)
    return bays, int(rng.integers(bays))
