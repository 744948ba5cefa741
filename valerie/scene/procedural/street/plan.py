"""The plan of a street: what stands where, before anything has a shape."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field

Point = tuple[float, float]
Polygon = tuple[Point, ...]

#: Across, metres: house fronts, kerbs. Along: where the carriageway ends (both ends are closed by houses).
LEFT_FRONT, LEFT_KERB, RIGHT_KERB, RIGHT_FRONT = -3.6, -0.8, 5.8, 8.6
KERB_HEIGHT = 0.12
ROAD_START, ROAD_STOP = -33.0, 112.2
ROW_START, ROW_STOP = -27.0, 105.0
#: Edges of the driving lane, metres from the left kerb: parking bays lie beside it.
LANE = (2.1, 4.5)
#: Nothing tall may stand here: the cameras look through it.
CAMERA_CORRIDOR = (-0.8, -16.0, 5.8, 4.0)


class StreetSettings(BaseModel):
    """What a generated street depends on.

    Attributes:
        seed: houses, cars, trees, colours and their places follow from it; 0 is a seed like any other.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(default=0, ge=0, lt=2**63)


@dataclass(frozen=True, slots=True)
class Placement:
    """One object of the street.

    Attributes:
        path: node path, e.g. ``scene.car-3``; the class is the name's first part.
        kind: which builder and shape, e.g. ``sedan``.
        x, y, z: origin in the world, metres.
        heading: radians, counter-clockwise seen from above; 0 faces +y (houses: the front faces −y at 0).
        seed: the object's own source of chance.
        size: metres, meaning by kind (houses: width, depth, then window axes and which has the door); empty where
            the kind says it all.
        variant: which of the shared models or colours of that kind.
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

    @property
    def object_class(self) -> str:
        """Node class as in `valerie.labels`, e.g. ``traffic-sign``."""
        return self.path.rpartition(".")[2].rpartition("-")[0]


@dataclass(frozen=True, slots=True)
class Footprint:
    """Where nobody can stand: the object at ``path`` fills ``polygon`` (x, y in metres, counter-clockwise)."""

    path: str
    polygon: Polygon


@dataclass(frozen=True, slots=True)
class GroundRegion:
    """The ground in ``polygon`` lies at ``height`` metres; later regions win, elsewhere it is 0."""

    polygon: Polygon
    height: float


@dataclass(frozen=True, slots=True)
class StreetLayout:
    """A street without shapes: cheap, and enough to plan and to decide which variants are legal.

    Attributes:
        settings: what it was made from.
        placements: every object; paths are unique.
        footprints: what people cannot walk through.
        ground: kerb heights.
        extent: x0, y0, x1, y1 in metres, within which the street is modelled.
    """

    settings: StreetSettings
    placements: tuple[Placement, ...]
    footprints: tuple[Footprint, ...]
    ground: tuple[GroundRegion, ...]
    extent: tuple[float, float, float, float]


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    """Axis-aligned, counter-clockwise."""
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def turned_rectangle(x: float, y: float, heading: float, low: Point, high: Point) -> Polygon:
    """The rectangle ``low`` … ``high`` of an object's own frame, placed at (x, y) with a heading."""
    cos, sin = math.cos(heading), math.sin(heading)
    return tuple((round(x + u * cos - v * sin, 4), round(y + u * sin + v * cos, 4)) for u, v in rectangle(*low, *high))


def disc(x: float, y: float, radius: float, corners: int = 8) -> Polygon:
    """A regular polygon around a disc."""
    reach = radius / math.cos(math.pi / corners)
    angles = [2.0 * math.pi * (k + 0.5) / corners for k in range(corners)]
    return tuple((round(x + reach * math.cos(a), 4), round(y + reach * math.sin(a), 4)) for a in angles)
