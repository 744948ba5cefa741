"""The asset pack ``bus-stop``: a bay beside a street with a shelter, people who wait, and a bus."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from pydantic import Field

from urban_street.pedestrians import PersonPlace
from urban_street.places.parts import LINE, around, avenue, begin, kinds_from, lamps, outline_of, sign
from urban_street.site import CameraPlace, Pack, PlaceSettings, Reach, Site, draw_season, nearest_cars, numbered
from urban_street.street.plan import Spot
from urban_street.street.planning import StreetPlan, seed_of
from urban_street.street.rows import add_row
from urban_street.street.shapes import Mark, Strip, Sweep, dashes
from urban_street.traffic_places import TrafficPlace

#: Half width of the street, depth of the bay, width of the pavements, metres.
_HALF, _BAY, _PAVEMENT = 3.5, 2.9, 4.6
#: y of the bay's corners: where it begins, is deep, is no longer deep, and ends.
_ALONG: Final = (3.0, 11.0, 38.0, 46.0)
_START, _STOP, _SIDE, _ROUND = -70.0, 130.0, 60.0, 4.0
#: Place of the shelter, and of the stop's flag, metres.
_SHELTER, _FLAG = (_HALF + _BAY + 2.1, 19.0), (_HALF + _BAY + 0.6, 35.0)
_PEOPLE: Final = (
    PersonPlace(7.0, 16.4, 80.0, "yellow-shirt", "standing"),
    PersonPlace(7.7, 20.4, 120.0, "black-outfit", "phone"),
    PersonPlace(7.2, 13.2, 60.0, "red-coat", "standing"),
    PersonPlace(8.1, 25.2, 10.0, "white-tee"),
    PersonPlace(7.8, 12.6, 30.0, "pink-girl", "standing"),
)
CAMERAS: Final = {
    "camera-1": CameraPlace((1.75, -9.0, 1.4), 353.0, 0.0, 45.0),
    "camera-2": CameraPlace((1.5, -10.0, 1.3), 357.0, 0.0, 50.0),
    "camera-3": CameraPlace((2.1, -8.0, 2.4), 350.0, -2.0, 42.0),
}


class Settings(PlaceSettings):
    """The arguments of a bus stop: those of every place, and the number of persons."""

    persons: int = Field(default=4, ge=1, le=len(_PEOPLE))


def site(settings: Settings) -> Site:
    """Plan a bus stop in milliseconds."""
    plan, rng = begin(settings)
    plan.sweep(_ground())
    ends = (_HALF, _HALF + _BAY, _HALF + _BAY, _HALF)
    kerb = [(_HALF, _START), *zip(ends, _ALONG, strict=True), (_HALF, _STOP)]
    pavement = shapely.Polygon([*kerb, (_SIDE, _STOP), (_SIDE, _START)])
    plan.slab(outline_of(pavement.buffer(-_ROUND).buffer(2.0 * _ROUND).buffer(-_ROUND)))
    plan.slab(outline_of(shapely.box(-_SIDE, _START, -_HALF, _STOP)))
    left, right = -_HALF - _PAVEMENT, _HALF + _BAY + _PAVEMENT
    add_row(plan, rng, Spot(left, -50.0, 0.5 * math.pi), 160.0)
    add_row(plan, rng, Spot(right, 110.0, -0.5 * math.pi), 160.0)
    add_row(plan, rng, Spot(-24.0, 116.0, 0.0), 48.0)
    _add_stop(plan)
    avenue(plan, rng, ("lime", "plane", "chestnut"), left + 3.6, np.arange(-42.0, 105.0, 11.0))
    avenue(plan, rng, ("maple", "birch"), _HALF + 1.1, (-30.0, 52.0, 63.0, 74.0, 85.0, 96.0))
    lamps(plan, -_HALF - 0.5, (-6.0, 17.0, 40.0, 63.0, 86.0), 0.0)
    for y in (57.5, 69.0):
        plan.stand("static", "litter-bin", Spot(_HALF + 0.6, y, 0.0), 0.24, height=1.1)
    for x, y in ((left + 0.5, 14.0), (left + 0.5, 47.0), (right - 0.5, 48.0)):
        plan.stand("static", "cabinet", Spot(x, y, math.copysign(0.5 * math.pi, -x)), 0.65, seed=seed_of(rng))
    sign(plan, 2, Spot(-_HALF - 0.5, 29.0, math.pi))
    sign(plan, 5, Spot(_HALF + 0.5, 49.5, 0.0))
    for kind, y in (("hatchback", 47.5), ("estate", 54.0), ("suv", 66.0), ("sedan", 72.5)):
        plan.park(kind, Spot(-_HALF + 1.1, y, math.pi), int(rng.integers(8)))
    extent = (-8.0, -30.0, 11.0, 90.0)
    layout = plan.layout(extent)
    return Site(
        name="bus-stop",
        title="Bus stop",
        description="A generated street with a bay for buses, a shelter, people who wait, and a bus.",
        layout=layout,
        cameras=CAMERAS,
        people=numbered(_PEOPLE[: settings.persons]),
        vehicles={
            "bus-101": TrafficPlace(_HALF + 1.55, 30.2, 0.0, shown=True),
            "car-101": TrafficPlace(-1.2, 36.0, 180.0, kinds_from("hatchback"), shown=True),
            "bicycle-101": TrafficPlace(2.6, 12.0, 0.0, rider="rider-101"),
            "truck-101": TrafficPlace(1.75, 60.0, 0.0),
        },
        parked=nearest_cars(layout, 2, 30.0),
        reach=Reach(people=(-8.0, 0.0, 11.0, 90.0), vehicles=extent, cameras=extent),
    )


def _ground() -> Sweep:
    marks: list[Mark] = [*dashes(0.0, _STOP - _START, 3.0, 6.0, around(0.0))]
    marks += dashes(_ALONG[0] - _START, _ALONG[3] - _START, 1.5, 1.5, (_HALF - 2.0 * LINE, _HALF))
    strips = (
        Strip("road", "asphalt-open", -_HALF), Strip("road", "asphalt-lane", 0.0), Strip("road", "asphalt-lane", _HALF),
        Strip("road", "asphalt-open", _SIDE),
    )  # fmt: skip
    return Sweep(((0.0, _START), (0.0, _STOP)), -_SIDE, strips, tuple(marks))


def _add_stop(plan: StreetPlan) -> None:
    """Add the shelter with its open side to the bay, the flag, a bench and a bin."""
    x, y = _SHELTER
    spot = Spot(x, y, -0.5 * math.pi)
    shelter = plan.add("static", "shelter", x, y, z=plan.height(x, y), heading=spot.heading)
    for low, high in (
        ((-2.2, 1.0), (2.2, 1.45)),
        ((-2.2, -0.15), (-1.9, 1.4)),
        ((1.8, -0.15), (2.2, 1.4)),
        ((-1.7, 0.65), (1.4, 1.1)),
    ):
        plan.block(shelter, spot.outline(low, high), 2.6)
    x, y = _FLAG
    post = plan.stand("pole", "post", Spot(x, y, 0.0), 0.05)
    plan.add("traffic-sign", "stop-flag", x, y, z=post.z)
    plan.stand("static", "litter-bin", Spot(x + 0.3, y - 12.6, 0.0), 0.24, height=1.1)


PACK: Final = Pack(3, Settings, site, draw_season)
