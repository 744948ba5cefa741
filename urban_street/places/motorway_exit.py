"""The asset pack ``motorway-exit``: two lanes, a deceleration lane that leaves them, barriers, boards, and a broken-down car
with people in high-visibility clothes.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from pydantic import Field

from urban_street.pedestrians import PersonPlace
from urban_street.places.parts import begin, kinds_from, of_woods, plant
from urban_street.site import CameraPlace, Pack, PlaceSettings, Reach, Site, Sky, draw_season, numbered
from urban_street.street.plan import Spot, rectangle
from urban_street.street.planning import StreetPlan, seed_of
from urban_street.street.shapes import Edge, Mark, Strip, Sweep, dashes
from urban_street.traffic_places import TrafficPlace

#: Width of a lane, of the shoulder, of the exit's lane and of its lines, metres.
_LANE, _SHOULDER, _EXIT, _LINE = 3.75, 2.5, 3.5, 0.25
_START, _STOP, _SIDE = -80.0, 420.0, 300.0
#: Left edge of the exit's lane: (y, x). The paint of the gore ends in grass at the nose.
_LEFT: Final = tuple((y, round(3.75 + 0.0031 * (y - 28.0) ** 2, 3)) for y in (*range(28, 140, 4), 160.0, 420.0))
_NOSE: Final = (64.0, 7.77)
_SHOULDER_X = _LANE + _EXIT + 0.5 * _SHOULDER
_PEOPLE: Final = (
    PersonPlace(_SHOULDER_X + 0.2, 9.6, 165.0, "orange-workwear"),
    PersonPlace(11.1, 20.5, 100.0, "yellow-shirt", "phone"),
    PersonPlace(11.3, 22.4, 150.0, "pink-girl", "standing"),
)
CAMERAS: Final = {
    "camera-1": CameraPlace((1.9, -14.0, 1.35), 355.0, 0.0, 45.0),
    "camera-2": CameraPlace((5.5, -16.0, 1.35), 358.0, 0.0, 50.0),
    "camera-3": CameraPlace((1.9, -16.0, 2.6), 354.0, -1.5, 45.0),
}


class Settings(PlaceSettings):
    """The arguments of a motorway exit: those of every place, and the number of persons."""

    persons: int = Field(default=2, ge=1, le=len(_PEOPLE))


def site(settings: Settings) -> Site:
    """Plan a motorway exit in milliseconds."""
    plan, rng = begin(settings)
    plan.sweep(_ground())
    _add_barriers(plan)
    _add_signs(plan)
    _add_plants(plan, rng)
    car = plan.park("estate", Spot(_SHOULDER_X + 0.15, 18.0, math.radians(0.8)), 3)
    plan.stand("static", "warning-triangle", Spot(_SHOULDER_X, 2.5, 0.0), 0.25, height=0.45)
    extent = (-30.0, -40.0, 40.0, 160.0)
    return Site(
        name="motorway-exit",
        title="Motorway exit",
        description="A generated motorway with an exit, crash barriers, boards, a broken-down car and people beside it.",
        layout=plan.layout(extent),
        cameras=CAMERAS,
        people=numbered(_PEOPLE[: settings.persons]),
        vehicles={
            "car-101": TrafficPlace(-1.85, 34.0, 0.0, kinds_from("sedan"), shown=True),
            "truck-101": TrafficPlace(1.9, 58.0, 0.0, shown=True),
            "bus-101": TrafficPlace(1.9, 84.0, 0.0),
            "motorcycle-101": TrafficPlace(5.4, 30.0, 0.0, rider="rider-102"),
        },
        parked=(car,),
        reach=Reach(people=(-12.0, -8.0, 30.0, 100.0), vehicles=extent, cameras=extent),
        sky=Sky(20.0, 170.0, 42.0),
    )


def _moved(by: float, until: float = 0.0) -> Edge:
    """Return the course of an edge beside that of the exit's lane; ``until`` is its offset before the exit."""
    first = (0.0, _LEFT[0][1] + until)
    return (first, (_LEFT[0][0] - 6.0 - _START, first[1]), *((y - _START, x + by) for y, x in _LEFT))


def _ground() -> Sweep:
    fork = _LEFT[0][0] - _START
    own = (_LANE - 0.30, _LANE)
    marks: list[Mark] = [*dashes(0.0, fork, 3.0, 3.0, own), Mark((fork, _STOP - _START), own)]
    marks += [Mark((0.0, _STOP - _START), (x, x + _LINE)) for x in (-_LANE, -19.0, -11.75)]
    for x in (0.0, -15.25):
        marks += dashes(0.0, _STOP - _START, 6.0, 12.0, (x - 0.075, x + 0.075))
    nose = _NOSE[0] - _START
    gore = (
        *((s, x) for s, x in _points(_moved(0.0)) if s <= nose),
        (nose + 4.0, _LANE + _SHOULDER),
        (_STOP - _START, _LANE + _SHOULDER),
    )
    shapes: tuple[tuple[str, str, Edge], ...] = (
        ("terrain", "crops", -32.0), ("terrain", "verge", -21.5),
        ("road", "asphalt-open", -19.0), ("road", "asphalt-lane", -15.25), ("road", "asphalt-lane", -11.5),
        ("road", "asphalt-open", -10.75), ("terrain", "verge", -4.5), ("road", "asphalt-open", -_LANE),
        ("road", "asphalt-lane", 0.0), ("road", "asphalt-lane", _LANE),
        ("road", "hatching", gore), ("terrain", "verge", _moved(0.0)),
        ("road", "road-marking", _moved(_LINE)), ("road", "asphalt-lane", _moved(_EXIT, _EXIT)),
        ("road", "road-marking", _moved(_EXIT + _LINE, _EXIT + _LINE)),
        ("road", "asphalt-open", _moved(_EXIT + _SHOULDER, _EXIT + _SHOULDER)),
        ("terrain", "verge", _moved(_EXIT + 9.0, _EXIT + 9.0)), ("terrain", "crops", _SIDE),
    )  # fmt: skip
    return Sweep(((0.0, _START), (0.0, _STOP)), -_SIDE, tuple(Strip(*shape) for shape in shapes), tuple(marks), 8.0)


def _points(edge: Edge) -> tuple[tuple[float, float], ...]:
    assert isinstance(edge, tuple)
    return edge


def _add_barriers(plan: StreetPlan) -> None:
    """Add barriers: two between the carriageways, one behind the shoulder, and one behind the nose."""
    rail = _LANE + _EXIT + _SHOULDER + 0.6
    for x, y0, y1, heading in ((-5.4, -70.0, 230.0, 0.0), (-9.9, -70.0, 230.0, math.pi), (rail, -60.0, 26.0, math.pi),
                               (_LANE + _SHOULDER + 0.7, 70.0, 190.0, math.pi)):  # fmt: skip
        barrier = plan.add(
            "guard-rail", "crash-barrier", x, y0 if heading == 0.0 else y1, heading=heading, size=(y1 - y0,)
        )
        plan.block(barrier, rectangle(x - 0.15, y0, x + 0.15, y1), 0.75)


def _add_signs(plan: StreetPlan) -> None:
    """Add the board at the nose, the board before the exit, and delineator posts."""
    for x, y, cell, height in ((_NOSE[1] - 0.2, _NOSE[0] + 5.0, 0, 1.5), (13.4, 38.0, 1, 2.2)):
        wide = 2.4 if cell == 0 else 4.4
        for side in (-0.35, 0.35):
            plan.stand("pole", "post", Spot(x + side * wide, y + 0.05, 0.0), 0.06, variant=1)
        plan.add("traffic-sign", "board", x, y, z=height, size=(wide, 0.5 * wide), variant=cell)
    for y in np.arange(-60.0, 240.0, 50.0).tolist():
        plan.stand("pole", "delineator", Spot(-4.9, y, 0.0), 0.08, height=1.05)
        plan.stand("pole", "delineator", Spot(-22.0, y, 0.0), 0.08, height=1.05)


def _add_plants(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Add grass, shrubs between the carriageways, and woods."""
    for x, wide, high in ((-10.5, 5.8, 0.30), (10.0, 6.0, 0.28)):
        for y in np.arange(-14.0, 58.0, 12.0).tolist():
            density = 10.0 * min(1.0, 30.0 / (y + 20.0))
            plan.add("terrain", "tufts", x, y, seed=seed_of(rng), size=(wide, 12.0, high, density))
    for k in range(46):
        y = -30.0 + 9.0 * k
        plant(plan, rng, of_woods(rng), -37.0 + float(rng.uniform(-3.0, 3.0)), y, 1.2)
        if y < 66.0 or y > 300.0:
            plant(plan, rng, of_woods(rng), 21.0 + float(rng.uniform(-2.5, 3.5)) + 0.4 * max(y - 300.0, 0.0), y, 1.15)
    for k in range(34):
        plant(plan, rng, of_woods(rng), 20.0 + 3.4 * k, 290.0 + float(rng.uniform(-12.0, 12.0)) - 0.6 * k, 1.35)
    for k in range(18):
        plant(plan, rng, of_woods(rng), 8.5 + float(rng.uniform(0.0, 1.3)) + 0.2 * k, 110.0 + 7.0 * k, 0.8)


PACK: Final = Pack(3, Settings, site, draw_season)
