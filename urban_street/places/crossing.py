"""The asset pack ``street-crossing``: two streets that meet at traffic lights, with zebra crossings, islands and people.

The wide street runs along y, the narrow one along x. By default the narrow street's lights are green: the cameras' cars wait.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from pydantic import Field

from urban_street.pedestrians import PersonPlace
from urban_street.places.parts import LINE, around, avenue, begin, kinds_from, lamps, line, outline_of, rounded, sign
from urban_street.site import CameraPlace, Pack, PlaceSettings, Reach, Site, Sky, draw_season, nearest_cars, numbered
from urban_street.street.plan import Spot
from urban_street.street.planning import StreetPlan
from urban_street.street.rows import HOUSE_DEPTH, add_row
from urban_street.street.shapes import Head, Mark, Signals, Strip, Sweep, bars, dashes
from urban_street.traffic_places import TrafficPlace

#: Half widths of the streets along y and x, half width of the painted median, and the middle of the crossing, metres.
_ALONG, _ACROSS, _MEDIAN, _MIDDLE = 7.5, 3.75, 1.0, 20.0
#: Radius of the kerbs at the corners, and width of the pavements, metres.
_CORNER, _PAVEMENT = 4.5, 4.0
#: Distances of zebra crossings and stop lines from the middle: over the street along y, and over the one along x.
_ZEBRA_ALONG, _ZEBRA_ACROSS, _STOP_ALONG, _STOP_ACROSS = (8.6, 12.6), (12.4, 16.0), (13.8, 14.3), (17.2, 17.7)
#: Ends of the ground along both streets, and of the rows of houses.
_START, _STOP, _SIDE, _ROWS = -80.0, 130.0, 80.0, 104.0
#: Furniture: kind, place, radius and height, metres.
_FURNITURE: Final = (
    ("bench", 10.6, 38.0, 0.95, None), ("litter-bin", 8.1, 33.8, 0.25, None), ("litter-bin", -8.1, 5.2, 0.25, None),
    ("column", -10.2, 2.0, 0.72, 3.1),
)  # fmt: skip
_PEOPLE: Final = (
    PersonPlace(3.2, 9.2, 90.0, "yellow-shirt"),
    PersonPlace(-3.4, 9.9, 270.0, "black-outfit"),
    PersonPlace(8.5, 8.7, 80.0, "red-coat", "standing"),
    PersonPlace(0.1, 10.6, 90.0, "grey-hoodie", "phone"),
    PersonPlace(-9.3, 25.9, 190.0, "blue-dress", "standing"),
    PersonPlace(9.6, 13.9, 20.0, "navy-coat", "standing"),
)
CAMERAS: Final = {
    "camera-1": CameraPlace((2.7, -10.5, 1.4), 0.0, 0.5, 40.0),
    "camera-2": CameraPlace((5.9, -1.5, 1.3), 6.0, 0.5, 32.0),
    "camera-3": CameraPlace((6.2, -13.0, 2.3), 6.0, -1.0, 45.0),
}


class Settings(PlaceSettings):
    """The arguments of a crossing: those of every place, and the number of persons."""

    persons: int = Field(default=5, ge=1, le=len(_PEOPLE))


def site(settings: Settings) -> Site:
    """Plan a crossing in milliseconds."""
    plan, rng = begin(settings)
    plan.sweep(_ground())
    for left in (True, False):
        for near in (True, False):
            plan.slab(_corner(left=left, near=near))
    islands = [(-0.85, 1.0, 0.85, 7.0), (-0.85, 11.8, 0.85, 14.2), (-0.85, 25.8, 0.85, 28.2), (-0.85, 33.0, 0.85, 39.0)]
    for box in islands:
        plan.slab(rounded(*box, 0.8))
    _add_houses(plan, rng)
    _add_signals(plan)
    for y, heading in ((2.2, 0.0), (37.8, math.pi)):
        plan.stand("pole", "bollard", Spot(0.0, y, heading), 0.08)
        sign(plan, 6, Spot(0.0, y + (0.6 if y < 20 else -0.6), heading))
    kinds = ("lime", "plane", "hornbeam")
    for x in (-_ALONG - 1.0, _ALONG + 1.0):
        avenue(plan, rng, kinds, x, (-38.0, -26.0, 42.0, 54.0, 66.0, 78.0, 90.0, 102.0))
        lamps(plan, x + math.copysign(0.3, -x), (-20.0, 3.2, 36.6, 60.0, 84.0), 0.0 if x < 0 else math.pi)
    sign(plan, 2, Spot(_ALONG + 0.5, -16.0, 0.0))
    sign(plan, 1, Spot(_ALONG + 0.5, 47.0, 0.0))
    for kind, x, y, turn in (
        ("estate", 20.6, _MIDDLE + 1.9, 90.0), ("suv", 26.8, _MIDDLE + 1.85, 90.0), ("hatchback", -20.8, _MIDDLE - 1.9, 270.0),
        ("sedan", -2.6, 36.9, 180.0), ("van", -5.9, 37.4, 180.0), ("hatchback", -2.6, 44.0, 180.0),
    ):  # fmt: skip
        plan.park(kind, Spot(x, y, math.radians(turn)), int(rng.integers(6)))
    for kind, x, y, radius, height in _FURNITURE:
        plan.stand("static", kind, Spot(x, y, math.copysign(0.5 * math.pi, x)), radius, height=height)
    extent = (-40.0, -40.0, 40.0, 90.0)
    layout = plan.layout(extent)
    return Site(
        name="street-crossing",
        title="Crossing with traffic lights",
        description="Two generated streets that meet at traffic lights, with houses, vehicles and pedestrians.",
        layout=layout,
        cameras=CAMERAS,
        people=numbered(_PEOPLE[: settings.persons]),
        vehicles={
            "car-101": TrafficPlace(-13.0, 18.1, 270.0, kinds_from("sedan")),
            "bicycle-101": TrafficPlace(4.4, 21.9, 90.0, rider="rider-101", shown=True),
            "bus-101": TrafficPlace(-5.8, 62.0, 180.0),
        },
        parked=nearest_cars(layout, 2, 20.0),
        sky=Sky(310.0, 180.0, 42.0),
        reach=Reach(people=(-30.0, -20.0, 30.0, 90.0), vehicles=extent, cameras=extent),
    )


def _ground() -> Sweep:
    marks: list[Mark] = []
    for way in (-1.0, 1.0):
        # Drivers who come from smaller y are on the right.
        mine, other = ((_MEDIAN, _ALONG), (-_ALONG, -_MEDIAN))[:: -1 if way > 0 else 1]
        marks.append(Mark(_along(way, *_STOP_ALONG), mine))
        for low, high in (mine, other):
            marks += bars(_along(way, *_ZEBRA_ALONG), low + 0.3, high - 0.3, 0.5, 0.5)
        marks += [line(_along(way, _STOP_ALONG[0], 95.0), x) for x in (-_MEDIAN, _MEDIAN)]
        middle = 0.5 * sum(mine)
        marks.append(line(_along(way, _STOP_ALONG[1], 30.0), middle))
        marks += dashes(*_along(way, 33.0, 95.0), 3.0, 6.0, around(middle))
        marks += dashes(*_along(way, _STOP_ALONG[0], 95.0), 3.0, 6.0, around(-middle))
        low, high = sorted(way * d for d in _ZEBRA_ACROSS)
        marks += dashes(*_along(1.0, 0.3 - _ACROSS, _ACROSS - 0.3), 0.5, 0.5, (low, high))
        low, high = sorted(way * d for d in _STOP_ACROSS)
        marks.append(Mark(_along(way, 0.0, _ACROSS), (low, high)))
        low, high = sorted((way * _STOP_ACROSS[1], way * _SIDE))
        marks.append(Mark(_along(1.0, -0.5 * LINE, 0.5 * LINE), (low, high)))
    lane, middle = 0.5 * (_MEDIAN + _ALONG), _MEDIAN
    surfaces = ((-_ALONG, "open"), (-lane, "lane"), (-middle, "lane"), (middle, "open"), (lane, "lane"), (_ALONG, "lane"),
                (_SIDE, "open"))  # fmt: skip
    strips = tuple(Strip("road", f"asphalt-{surface}", edge) for edge, surface in surfaces)
    return Sweep(((0.0, _START), (0.0, _STOP)), -_SIDE, strips, tuple(marks))


def _along(way: float, near: float, far: float) -> tuple[float, float]:
    """Return metres along the ground for two distances from the crossing's middle, towards ``way``."""
    low, high = sorted(_MIDDLE + way * distance - _START for distance in (near, far))
    return low, high


def _corner(*, left: bool, near: bool) -> tuple[tuple[float, float], ...]:
    """Return the outline of the pavement of one quarter, with its houses' ground."""
    x0, x1 = (-_SIDE, -_ALONG) if left else (_ALONG, _SIDE)
    y0, y1 = (_START, _MIDDLE - _ACROSS) if near else (_MIDDLE + _ACROSS, _STOP)
    quarter = shapely.box(x0, y0, x1, y1)
    x, y = (x1 if left else x0), (y1 if near else y0)
    inner = (x + (-_CORNER if left else _CORNER), y + (-_CORNER if near else _CORNER))
    square = shapely.MultiPoint([(x, y), inner]).envelope
    return outline_of(
        quarter.difference(square).union(square.intersection(shapely.Point(inner).buffer(_CORNER, quad_segs=10)))
    )


def _add_houses(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Add two rows in each quarter, and houses that close the views."""
    front, side = _ALONG + _PAVEMENT, _ACROSS + _PAVEMENT
    low, high = _MIDDLE - side, _MIDDLE + side
    quarter, half = 0.5 * math.pi, math.pi
    add_row(plan, rng, Spot(-front, high, quarter), _ROWS - high, (True, False))
    add_row(plan, rng, Spot(-front, -45.0, quarter), low + 45.0, (False, True))
    add_row(plan, rng, Spot(front, _ROWS, -quarter), _ROWS - high, (False, True))
    add_row(plan, rng, Spot(front, low, -quarter), low + 45.0, (True, False))
    back = front + HOUSE_DEPTH
    for x in (-_SIDE + 10.0, back):
        add_row(plan, rng, Spot(x, high, 0.0), _SIDE - 10.0 - back)
        add_row(plan, rng, Spot(x + _SIDE - 10.0 - back, low, half), _SIDE - 10.0 - back)
    for spot, width in (
        (Spot(-22.0, _ROWS + 4.0, 0.0), 44.0), (Spot(-_SIDE + 8.0, _MIDDLE - 12.0, quarter), 24.0),
        (Spot(_SIDE - 8.0, _MIDDLE + 12.0, -quarter), 24.0),
    ):  # fmt: skip
        add_row(plan, rng, spot, width)


def _add_signals(plan: StreetPlan) -> None:
    """Add posts and masts, and the heads of all groups."""
    quarter, half = 0.5 * math.pi, math.pi
    heads: list[Head] = []
    for way, turn in ((1.0, 0.0), (-1.0, half)):  # the crossing is the same from both sides
        posts = {
            "along": [(0.0, 6.2, 0.0)],
            "across": [(17.4, _MIDDLE + _ACROSS + 0.6, quarter)],
            "over-along": [(_ALONG + 0.6, 11.9, -quarter), (-_ALONG - 0.6, 11.9, quarter)],
            "over-across": [(16.4, _MIDDLE + _ACROSS + 0.6, 0.0), (16.4, _MIDDLE - _ACROSS - 0.6, half)],
        }
        for group, places in posts.items():
            for x, y, heading in places:
                spot = Spot(way * x, _MIDDLE + way * (y - _MIDDLE), heading + turn)
                post = plan.stand("pole", "signal-post", spot, 0.07)
                heads.append(_head(spot, group, post.z))
        spot = Spot(way * (_ALONG + 0.6), _MIDDLE + way * (5.9 - _MIDDLE), turn)
        mast = plan.stand("pole", "mast", replace(spot, heading=turn + half), 0.12)
        heads.append(_head(spot, "along", mast.z))
        heads.append(_head(replace(spot, x=spot.x - 3.4 * way), "along", mast.z + 2.15))
    plan.add("traffic-light", "signals", 0.0, 0.0, shape=Signals(tuple(heads)))


def _head(spot: Spot, group: str, lift: float) -> Head:
    """Return a head before its post."""
    x, y = spot.x + 0.07 * math.sin(spot.heading), spot.y - 0.07 * math.cos(spot.heading)
    return Head(round(x, 4), round(y, 4), spot.heading, group, lift)


PACK: Final = Pack(3, Settings, site, draw_season)
