"""The plan of a street: places of objects without shapes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from urban_street.street.shapes import Point, Polygon, Shape

#: x of the kerbs of a street of default width, metres.
LEFT_KERB, RIGHT_KERB = -0.8, 5.8
KERB_HEIGHT = 0.12
#: y of the starts of carriageway and rows of houses, and the carriageway's reach beyond the rows, metres. Houses close both
#: ends.
ROAD_START, ROW_START = -33.0, -27.0
_ROAD_BEYOND = 7.2
#: Edges of the driving lane, metres from the left kerb. Parking bays are beside it.
LANE = (2.1, 4.5)
#: Ground without tall objects, across which the cameras look: x0, y0, x1, y1 in metres.
CAMERA_CORRIDOR = (-0.8, -16.0, 5.8, 4.0)


Season = Literal["spring", "summer", "autumn", "winter"]
#: Half widths of a side street between the corner houses, and of its carriageway, metres.
SIDE_HALF, SIDE_ROAD_HALF = 5.4, 3.0
#: Length of a side street beyond the corner houses' fronts, metres.
SIDE_LENGTH = 46.0


class StreetSettings(BaseModel):
    """The arguments of a generated street; lengths in metres.

    Attributes:
        seed: determines houses, cars, trees, colours and places; 0 is a valid seed.
        length_m: length of the rows of houses.
        lanes: number of driving lanes, between two parking bays. x = 2.5 m is always the middle of a lane: the middle lane, or
            the lane right of the centre line.
        lane_width_m: width of each lane.
        pavement_width_m: width of the pavements, from the kerb to the plots.
        kerb_height_m: height of the pavements above the road.
        setback_m: distance of the houses from the pavement; from 1.5 m on there are front gardens.
        side_street: sides on which a street branches off at y = 46 m, behind a zebra crossing.
        surface: surface of the carriageway.
        season: season of the trees.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(default=0, ge=0, lt=2**63)
    length_m: float = Field(default=165.0, ge=100.0, le=300.0)
    lanes: int = Field(default=1, ge=1, le=6)
    lane_width_m: float = Field(default=2.4, ge=2.2, le=4.5)
    pavement_width_m: float = Field(default=2.8, ge=1.8, le=8.0)
    kerb_height_m: float = Field(default=KERB_HEIGHT, ge=0.02, le=0.2)
    setback_m: float = Field(default=0.0, ge=0.0, le=8.0)
    side_street: Literal["none", "left", "right", "both"] = "right"
    surface: Literal["asphalt", "paving"] = "asphalt"
    season: Season = "summer"


@dataclass(frozen=True, slots=True)
class StreetLines:
    """The lines of a street in metres: x of fronts and kerbs, y of ends, rows of houses and crossings.

    Attributes:
        left_front, left_kerb, right_kerb, right_front: edges of the pavements.
        setback: distance of the houses from the pavements.
        kerb_height: height of the pavements.
        lanes: edges of the driving lanes from the left kerb, one more than there are lanes.
        road_start, road_stop, row_start, row_stop: y of the ends of carriageway and rows of houses.
        crossings: y of the middles of the zebra crossings.
        side_y: y of the middle of the side street, or None.
        sides: True if it branches off to the left, and to the right.
    """

    left_front: float
    left_kerb: float
    right_kerb: float
    right_front: float
    setback: float
    kerb_height: float
    lanes: tuple[float, ...]
    road_start: float
    road_stop: float
    row_start: float
    row_stop: float
    crossings: tuple[float, ...]
    side_y: float | None
    sides: tuple[bool, bool]

    @property
    def width(self) -> float:
        """Return the distance from kerb to kerb."""
        return round(self.right_kerb - self.left_kerb, 4)

    def front(self, *, left: bool) -> float:
        """Return the x of the houses' fronts."""
        return self.left_front - self.setback if left else self.right_front + self.setback

    def in_side_street(self, y: float, half: float, *, left: bool) -> bool:
        """Return True if ``y`` is within ``half`` of the middle of a side street on that side."""
        return self.side_y is not None and self.sides[0 if left else 1] and abs(y - self.side_y) < half

    def spans(self, start: float, stop: float, half: float, *, left: bool) -> list[tuple[float, float]]:
        """Return the parts of ``start`` … ``stop`` on one side at least ``half`` away from the middle of a side street."""
        if self.side_y is None or not self.sides[0 if left else 1]:
            return [(start, stop)]
        return [(start, self.side_y - half), (self.side_y + half, stop)]


def lines_of(settings: StreetSettings) -> StreetLines:
    """Return the lines of a street, across about the middle of the default kerbs, along from `ROW_START` on."""
    bay = LANE[0]
    width = 2.0 * bay + settings.lanes * settings.lane_width_m
    centre = 0.5 * (LEFT_KERB + RIGHT_KERB) - (0.5 * settings.lane_width_m if settings.lanes % 2 == 0 else 0.0)
    left, right = round(centre - 0.5 * width, 4), round(centre + 0.5 * width, 4)
    row_stop = round(ROW_START + settings.length_m, 4)
    sides = (settings.side_street in {"left", "both"}, settings.side_street in {"right", "both"})
    # Zebra crossings are in the middle of pieces of carriageway (13.2 m): every fifth piece, or around the side street.
    first = _SIDE_CROSSING if any(sides) else 66.0
    crossings = [0.0, *(first + 66.0 * k for k in range(5))]
    return StreetLines(
        left_front=round(left - settings.pavement_width_m, 4),
        left_kerb=left,
        right_kerb=right,
        right_front=round(right + settings.pavement_width_m, 4),
        setback=settings.setback_m,
        kerb_height=settings.kerb_height_m,
        lanes=tuple(round(bay + k * settings.lane_width_m, 4) for k in range(settings.lanes + 1)),
        road_start=ROAD_START,
        road_stop=round(row_stop + _ROAD_BEYOND, 4),
        row_start=ROW_START,
        row_stop=row_stop,
        crossings=tuple(c for c in crossings if c < row_stop - 12.0),
        side_y=_SIDE_Y if any(sides) else None,
        sides=sides,
    )


#: y of a side street and of the crossing before it, metres.
_SIDE_Y, _SIDE_CROSSING = 46.0, 39.6


@dataclass(frozen=True, slots=True)
class Spot:
    """A spot on the ground: x and y in metres, heading in radians (0 faces +y, counter-clockwise seen from above)."""

    x: float
    y: float
    heading: float

    def outline(self, low: Point, high: Point) -> Polygon:
        """Return the rectangle ``low`` … ``high`` in the frame of an object at this spot."""
        return turned_rectangle(self.x, self.y, self.heading, low, high)


@dataclass(frozen=True, slots=True)
class Placement:
    """One object of the street.

    Attributes:
        path: node path, e.g. ``scene.car-3``; the class is the name's first part.
        kind: name of builder and shape, e.g. ``sedan``.
        x, y, z: origin in the world, metres.
        heading: radians, counter-clockwise seen from above; 0 faces +y (the front of a house faces −y at 0).
        seed: seed of the object's random choices.
        size: metres; its meaning depends on the kind (houses: width, depth, number of window axes, index of the door's axis).
            Empty if the kind determines the size.
        variant: index of the shared model or colour of that kind.
        shape: shape of ground that no few numbers describe.
    """

    path: str
    kind: str
    x: float
    y: float
    z: float = 0.0
    heading: float = 0.0
    seed: int = 0
    size: tuple[float, ...] = ()
    variant: int = 0
    shape: Shape | None = None

    @property
    def object_class(self) -> str:
        """Return the node class (`valerie.labels`), e.g. ``traffic-sign``."""
        return self.path.rpartition(".")[2].rpartition("-")[0]


@dataclass(frozen=True, slots=True)
class Footprint:
    """Ground on which nobody can stand: ``polygon`` (x, y in metres, counter-clockwise) of the object at ``path``.

    ``height`` (metres) is None for the usual height of the class, and ``reason`` is empty for "inside" the object.
    """

    path: str
    polygon: Polygon
    height: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class GroundRegion:
    """Ground in ``polygon`` at ``height`` metres. Later regions take precedence; elsewhere the height is 0."""

    polygon: Polygon
    height: float


@dataclass(frozen=True, slots=True)
class StreetLayout:
    """A street without shapes, which suffices to plan runs and check variants.

    Attributes:
        settings: its arguments.
        placements: all objects, with unique paths.
        footprints: ground that people cannot enter.
        ground: kerb heights.
        extent: x0, y0, x1, y1 of the modelled street, metres.
        near: likewise, where cars have all their details.
    """

    settings: StreetSettings
    placements: tuple[Placement, ...]
    footprints: tuple[Footprint, ...]
    ground: tuple[GroundRegion, ...]
    extent: tuple[float, float, float, float]
    near: tuple[float, float, float, float] = (-math.inf, -20.0, math.inf, 34.0)

    @property
    def lines(self) -> StreetLines:
        """Return the lines of its kerbs, fronts and ends."""
        return lines_of(self.settings)


#: The middle of the places of people, metres along the street.
PEOPLE_Y: Final = 18.0


def nearest(placements: Iterable[Placement], count: int, y: float) -> list[Placement]:
    """Return the ``count`` objects that are nearest to a place along the street, nearest first."""
    return sorted(placements, key=lambda placement: (abs(placement.y - y), placement.path))[:count]


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    """Return an axis-aligned rectangle, counter-clockwise."""
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def turned_rectangle(x: float, y: float, heading: float, low: Point, high: Point) -> Polygon:
    """Return the rectangle ``low`` … ``high`` in an object's frame, placed at (x, y) with a heading."""
    cos, sin = math.cos(heading), math.sin(heading)
    return tuple((round(x + u * cos - v * sin, 4), round(y + u * sin + v * cos, 4)) for u, v in rectangle(*low, *high))


def disc(x: float, y: float, radius: float, corners: int = 8) -> Polygon:
    """Return a regular polygon around a disc."""
    reach = radius / math.cos(math.pi / corners)
    angles = [2.0 * math.pi * (k + 0.5) / corners for k in range(corners)]
    return tuple((round(x + reach * math.cos(a), 4), round(y + reach * math.sin(a), 4)) for a in angles)
