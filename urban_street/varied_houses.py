"""The houses of a generated street that can be moved, turned and resized within limits, and the ways between them.

They belong to the background. Houses are side by side, so most changes need room first: a smaller house, or one farther back.
Outlines decide whether a change is legal (`valerie.scene.legality.mover_rules`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from urban_street.street.plan import (
    PEOPLE_Y,
    SIDE_HALF,
    SIDE_LENGTH,
    Placement,
    StreetLayout,
    rectangle,
)
from valerie.parameters.declaring import angle, number
from valerie.parameters.definitions import Affects, ParameterDefinition
from valerie.scene.assets.manifest import Footprint

#: Number of houses with parameters on each side: those nearest to the places of people.
_EACH_SIDE: Final = 3
#: Limits of the changes: metres forward and back, metres to both sides, degrees to both sides, smallest and largest size.
_FORWARD_M, _BACK_M, _ALONG_M, _TURN_DEG = 1.0, 3.0, 2.0, 6.0
_SIZES: Final = (0.85, 1.1)


def varied_houses(layout: StreetLayout) -> list[Placement]:
    """Return the houses with parameters, first the left ones, each side by path."""
    houses: list[Placement] = []
    for heading in (0.5 * math.pi, -0.5 * math.pi):
        # Only rows along the street count. Houses of a side street face that street or are far from this front.
        fronts = layout.lines.front(left=heading > 0.0)
        row = [
            house
            for house in layout.placements
            if house.object_class == "building" and house.heading == heading and abs(house.x - fronts) < 5.0
        ]
        nearest = sorted(row, key=lambda house: (abs(_middle(house) - PEOPLE_Y), house.path))[:_EACH_SIDE]
        houses += sorted(nearest, key=layout.placements.index)
    return houses


def house_parameters(house: Placement) -> Iterator[ParameterDefinition]:
    """Yield the parameters of a house: limited position, orientation and size (the paper's table 1).

    It turns and scales about the left end of its front, seen from the street, on the ground. The default is the planned house.
    """
    back = -_BACK_M if house.heading > 0.0 else -_FORWARD_M, _FORWARD_M if house.heading > 0.0 else _BACK_M
    degrees = round(math.degrees(house.heading)) % 360.0
    yield number(
        f"{house.path}.pos.x", _sum(house.x, back[0]), _sum(house.x, back[1]), house.x, Affects.GEOMETRY, "m",
        "position of its front across the street",
    )  # fmt: skip
    yield number(
        f"{house.path}.pos.y", _sum(house.y, -_ALONG_M), _sum(house.y, _ALONG_M), house.y, Affects.GEOMETRY, "m",
        "position of the left end of its front along the street",
    )  # fmt: skip
    yield angle(
        f"{house.path}.rot.z", degrees, Affects.GEOMETRY, "counter-clockwise from above, about the left end of its front",
        low=degrees - _TURN_DEG, high=degrees + _TURN_DEG,
    )  # fmt: skip
    yield number(f"{house.path}.scale", *_SIZES, 1.0, Affects.GEOMETRY, "", "scale of the whole house")


def ways(layout: StreetLayout) -> Iterator[Footprint]:
    """Yield the ground of carriageways and pavements, which houses must leave free."""
    lines = layout.lines
    start, stop = lines.road_start, lines.road_stop
    for name, x0, x1 in (
        ("road-1", lines.left_kerb, lines.right_kerb),
        ("sidewalk-1", lines.left_front, lines.left_kerb),
        ("sidewalk-2", lines.right_kerb, lines.right_front),
    ):
        yield _way(name, x0, start, x1, stop)
    side_roads = (placement for placement in layout.placements if placement.kind == "side-road")
    for left, there in zip((True, False), lines.sides, strict=True):
        if there and lines.side_y is not None:
            near = lines.left_front if left else lines.right_front
            end = lines.front(left=left) + (-SIDE_LENGTH if left else SIDE_LENGTH)
            name = next(side_roads).path.rpartition(".")[2]
            yield _way(name, min(near, end), lines.side_y - SIDE_HALF, max(near, end), lines.side_y + SIDE_HALF)


def _way(name: str, x0: float, y0: float, x1: float, y1: float) -> Footprint:
    return Footprint(path=f"scene.{name}", polygon=rectangle(x0, y0, x1, y1), reason=f"on {name}")


def _middle(house: Placement) -> float:
    return house.y + math.copysign(0.5 * house.size[0], house.heading)


def _sum(first: float, second: float) -> float:
    """Return the sum, rounded to decimetres for readable ranges."""
    return round(first + second, 1)
