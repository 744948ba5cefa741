"""The asset pack ``car-park``: rows of bays with parked cars, aisles, planted islands, lamps, trolleys, people between cars."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from pydantic import Field

from urban_street.pedestrians import PersonPlace
from urban_street.places.parts import avenue, begin, kinds_from, lamps, plant, rounded, sign
from urban_street.site import (
    CameraPlace,
    Pack,
    PlaceSettings,
    Reach,
    Site,
    Sky,
    draw_season,
    nearest_cars,
    numbered,
    picked,
)
from urban_street.street.plan import Spot, rectangle
from urban_street.street.planning import StreetPlan, seed_of
from urban_street.street.rows import add_row
from urban_street.street.shapes import Mark, Strip, Sweep
from urban_street.traffic_places import TrafficPlace

#: Half width of an aisle, depth and width of a bay, width of a planted island, metres.
_AISLE, _BAY, _WIDE, _ISLAND = 3.1, 5.1, 2.6, 1.6
#: Ends of the rows, and of the ground, metres.
_ROWS, _START, _STOP, _SIDE = (-18.2, 49.0), -80.0, 130.0, 90.0
#: Middles of the aisles.
_AISLES: Final = tuple((2.0 * (_AISLE + _BAY) + _ISLAND) * k for k in (-1, 0, 1))
#: Shares of bays with a car at the middle aisle and at the others, and of parked cars by kind.
_TAKEN: Final = (0.42, 0.8, 0.42)
_KINDS: Final = {"hatchback": 0.36, "sedan": 0.14, "estate": 0.2, "suv": 0.24, "van": 0.06}
#: Bays that stay free (aisle, side, number along the row), and the one of the trolleys.
_FREE: Final = {(1, 1.0, 9), (1, -1.0, 10), (1, -1.0, 14), (1, 1.0, 12), (1, 1.0, 15)}
#: Bays before this one, which no camera sees, are empty.
_FIRST: Final = 3
_TROLLEYS: Final = (1, 1.0, 16)
_PEOPLE: Final = (
    PersonPlace(0.9, 12.0, 170.0, "yellow-shirt"),
    PersonPlace(-4.6, 8.9, 285.0, "red-coat", "phone"),
    PersonPlace(4.3, 5.5, 120.0, "grey-hoodie", "standing"),
    PersonPlace(-1.6, 24.0, 10.0, "blue-dress"),
    PersonPlace(2.4, 31.0, 200.0, "pink-girl"),
)
CAMERAS: Final = {
    "camera-1": CameraPlace((1.5, -11.0, 1.35), 1.0, 0.0, 40.0),
    "camera-2": CameraPlace((-1.3, -10.0, 1.25), 354.0, 0.0, 40.0),
    "camera-3": CameraPlace((1.8, -14.0, 2.4), 3.0, -2.0, 40.0),
}


class Settings(PlaceSettings):
    """The arguments of a car park: those of every place, and the number of persons."""

    persons: int = Field(default=4, ge=1, le=len(_PEOPLE))


def site(settings: Settings) -> Site:
    """Plan a car park in milliseconds."""
    plan, rng = begin(settings)
    plan.sweep(_ground())
    low, high = _ROWS
    edge = _AISLES[2] + _AISLE + _BAY
    for x in (_AISLES[0] + _AISLES[1], _AISLES[1] + _AISLES[2]):
        plan.slab(rounded(0.5 * (x - _ISLAND), low, 0.5 * (x + _ISLAND), high, 0.75), "terrain", "verge")
        avenue(plan, rng, ("maple", "hornbeam", "cherry"), 0.5 * x, np.arange(low + 5.2, high, 10.4), pits=False)
        for turn in (0.0, math.pi):
            lamps(plan, 0.5 * x + (0.25 if turn == 0.0 else -0.25), (-8.0, 18.0, 44.0), turn)
    plan.slab(rounded(-edge - 20.0, high + 7.0, edge + 20.0, _STOP, 2.0))
    for x0, x1 in ((-_SIDE, -edge), (edge, _SIDE)):
        plan.slab(rounded(x0, _START, x1, high + 4.0, 1.0), "terrain", "verge")
    for x in (-edge - 1.4, edge + 1.4):
        for y in range(int(low), int(high), 12):
            hedge = plan.add(
                "vegetation", "hedge", x, float(y), z=plan.height(x, float(y)), seed=seed_of(rng), size=(1.2, 11.2, 1.3)
            )
            plan.block(hedge, rectangle(x - 0.6, y, x + 0.6, y + 11.2), 1.45)
    for x in (-edge - 6.0, edge + 6.0):
        for y in np.arange(-24.0, 60.0, 9.0).tolist():
            plant(
                plan, rng, str(rng.choice(("far-lime", "far-plane", "far-birch"))), x, y + float(rng.uniform(-0.8, 0.8))
            )
    _add_cars(plan, rng)
    add_row(plan, rng, Spot(-44.0, high + 13.0, 0.0), 88.0)
    for x in (-24.0, -13.0, -4.0, 5.0, 14.0, 25.0):
        avenue(plan, rng, ("hornbeam", "cherry"), x, (high + 8.4,))
    sign(plan, 5, Spot(_AISLES[1] + _AISLE + _BAY + 0.8, -4.5, 0.0))
    extent = (-45.0, -40.0, 45.0, 60.0)
    layout = replace(plan.layout(extent), near=(-10.0, -20.0, 10.0, 8.0))
    return Site(
        name="car-park",
        title="Car park",
        description="A generated car park with parked cars, aisles, planted islands, trolleys, and people between cars.",
        layout=layout,
        cameras=CAMERAS,
        people=numbered(_PEOPLE[: settings.persons]),
        vehicles={
            "car-101": TrafficPlace(-1.6, 40.0, 180.0, kinds_from("suv"), shown=True),
            "bicycle-101": TrafficPlace(1.9, 20.0, 0.0, rider="rider-101"),
            "motorcycle-101": TrafficPlace(1.8, 26.0, 0.0, rider="rider-102"),
        },
        parked=nearest_cars(layout, 4, 12.0),
        sky=Sky(300.0, 190.0, 40.0),
        reach=Reach(people=(-30.0, -8.0, 30.0, 55.0), vehicles=extent, cameras=extent),
    )


def _ground() -> Sweep:
    """Return asphalt with lines between the bays."""
    low, high = _ROWS[0] - _START, _ROWS[1] - _START
    marks: list[Mark] = []
    for aisle in _AISLES:
        for x0, x1 in ((aisle - _AISLE - _BAY, aisle - _AISLE), (aisle + _AISLE, aisle + _AISLE + _BAY)):
            marks += [
                Mark((low + _WIDE * k - 0.05, low + _WIDE * k + 0.05), (x0, x1))
                for k in range(round((high - low) / _WIDE) + 1)
            ]
    return Sweep(((0.0, _START), (0.0, _STOP)), -_SIDE, (Strip("road", "asphalt-open", _SIDE),), tuple(marks))


def _add_cars(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Park cars in most bays, nose or tail first, and put the trolleys into a free one."""
    count = round((_ROWS[1] - _ROWS[0]) / _WIDE)
    for number, aisle in enumerate(_AISLES):
        for side in (-1.0, 1.0):
            for k in range(_FIRST, count):
                x, y = aisle + side * (_AISLE + 0.5 * _BAY), _ROWS[0] + _WIDE * (k + 0.5)
                if (number, side, k) == _TROLLEYS:
                    plan.stand("static", "trolleys", Spot(x, y, 0.5 * math.pi), 1.3, height=2.6)
                elif rng.random() < _TAKEN[number] and (number, side, k) not in _FREE:
                    nose = 90.0 if (rng.random() < 0.75) == (side < 0) else 270.0
                    turn = nose + float(rng.normal(0.0, 1.0))
                    shift = float(rng.uniform(-0.15, 0.15))
                    spot = Spot(
                        round(x + shift, 3), round(y + float(rng.normal(0.0, 0.08)), 3), math.radians(round(turn, 3))
                    )
                    plan.park(picked(rng, _KINDS), spot, int(rng.integers(8)))


PACK: Final = Pack(3, Settings, site, draw_season)
