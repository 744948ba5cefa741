"""The asset pack ``rural-road``: a road between fields, without pavements: verges, a ditch, a crash barrier, hedges, people at
the edge.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np
from pydantic import Field

from urban_street.pedestrians import PersonPlace
from urban_street.places.parts import around, begin, kinds_from, line, of_woods, plant, sign
from urban_street.site import CameraPlace, Pack, PlaceSettings, Reach, Site, Sky, draw_season, numbered
from urban_street.street.plan import Spot, rectangle
from urban_street.street.planning import StreetPlan, seed_of
from urban_street.street.rows import add_house
from urban_street.street.shapes import Mark, Point, Polygon, Strip, Sweep, dashes
from urban_street.traffic_places import TrafficPlace

#: Half width of the asphalt and distance of its edge lines from the middle, metres.
_HALF, _EDGE = 3.5, 3.2
#: Distances from the middle: the ditch's edges on the left, the mown verge's end on the right.
_DITCH, _VERGE_RIGHT = (-5.6, -6.2, -6.7, -7.6), 5.6
_DEPTH = -0.55
#: Ends of the modelled road, start of its bend, and width of the fields, metres.
_START, _STOP, _BEND, _SIDE = -80.0, 420.0, 34.0, 300.0
#: From where to where the crash barrier stands on the right, metres.
_BARRIER = (8.0, 44.0)
_PEOPLE: Final = (
    PersonPlace(3.0, 12.0, 0.0, "yellow-shirt"),
    PersonPlace(-3.7, 19.0, 180.0, "green-parka"),
    PersonPlace(-4.3, 20.2, 180.0, "striped-boy"),
)
CAMERAS: Final = {
    "camera-1": CameraPlace((1.7, -10.0, 1.35), 1.0, 0.0, 45.0),
    "camera-2": CameraPlace((1.3, -10.0, 1.25), 355.0, 0.0, 45.0),
    "camera-3": CameraPlace((1.9, -12.0, 2.4), 3.0, -1.5, 45.0),
}


class Settings(PlaceSettings):
    """The arguments of a rural road: those of every place, and the number of persons."""

    persons: int = Field(default=2, ge=1, le=len(_PEOPLE))


def site(settings: Settings) -> Site:
    """Plan a rural road in milliseconds."""
    plan, rng = begin(settings, 0.02)
    plan.sweep(_ground())
    _add_ditch(plan)
    _add_verges(plan, rng)
    _add_furniture(plan)
    _add_plants(plan, rng)
    extent = (-40.0, -40.0, 40.0, 160.0)
    layout = plan.layout(extent)
    return Site(
        name="rural-road",
        title="Rural road",
        description="A generated road between fields, with verges, a ditch, a crash barrier, trees, and people at its edge.",
        layout=layout,
        cameras=CAMERAS,
        people=numbered(_PEOPLE[: settings.persons]),
        vehicles={
            "car-101": TrafficPlace(round(_bend(62.0) - 1.7, 2), 62.0, 180.0, kinds_from("estate"), shown=True),
            "bicycle-101": TrafficPlace(2.85, 30.0, 0.0, rider="rider-101", shown=True),
            "truck-101": TrafficPlace(round(_bend(96.0) - 1.75, 2), 96.0, 180.0),
            "motorcycle-101": TrafficPlace(-1.6, 30.0, 180.0, rider="rider-102"),
        },
        reach=Reach(people=(-15.0, -8.0, 15.0, 100.0), vehicles=extent, cameras=extent),
        sky=Sky(60.0, 200.0, 38.0),
    )


def _bend(y: float) -> float:
    """Return x of the road's middle: straight at first, then in a bend to the left."""
    return -0.0011 * max(y - _BEND, 0.0) ** 2


def _ground() -> Sweep:
    ys = [_START, *np.arange(0.0, _STOP + 1.0, 6.0).tolist()]
    end = _STOP - _START + 60.0
    marks: list[Mark] = [line((0.0, end), x) for x in (-_EDGE, _EDGE)]
    marks += dashes(0.0, end, 4.0, 8.0, around(0.0))
    shapes = (
        ("terrain", "crops", _DITCH[3], 0.0), ("terrain", "verge", _DITCH[2], _DEPTH), ("terrain", "verge", _DITCH[1], _DEPTH),
        ("terrain", "verge", _DITCH[0], 0.0), ("terrain", "verge", -_HALF - 0.3, 0.0), ("terrain", "gravel", -_HALF, 0.0),
        ("road", "asphalt-lane", 0.0, 0.0), ("road", "asphalt-lane", _HALF, 0.0), ("terrain", "gravel", _HALF + 0.3, 0.0),
        ("terrain", "verge", _VERGE_RIGHT + 2.0, 0.0), ("terrain", "stubble", _SIDE, 0.0),
    )  # fmt: skip
    strips = tuple(Strip(*shape) for shape in shapes)
    corners: Polygon = tuple((round(_bend(y), 4), y) for y in ys)
    return Sweep(corners, -_SIDE, strips, tuple(marks), 12.0)


def _beside(y: float, right: float) -> Point:
    """Return a place beside the road's middle."""
    return round(_bend(y) + right, 4), y


def _add_ditch(plan: StreetPlan) -> None:
    """Block the ditch, in which nobody stands."""
    ground = next(p for p in plan.placements if p.object_class == "terrain")
    ys = np.arange(-60.0, 160.0, 10.0).tolist()
    for y0, y1 in pairwise(ys):
        corners = (_beside(y0, _DITCH[3]), _beside(y0, _DITCH[0]), _beside(y1, _DITCH[0]), _beside(y1, _DITCH[3]))
        plan.block(ground, corners, 0.01, "in the ditch")


def _add_verges(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Add grass: dense where the cameras see its blades, sparse farther away."""
    strips = (
        (_DITCH[0] - 0.3, -_HALF - 0.25, 0.26, 16.0), (_DITCH[3] - 0.5, _DITCH[3] + 0.3, 0.55, 12.0),
        (_HALF + 0.25, _VERGE_RIGHT + 2.3, 0.24, 13.0),
    )  # fmt: skip
    for low, high, tall, density in strips:
        for y in np.arange(-12.0, 120.0, 12.0).tolist():
            share = min(1.0, 26.0 / max(y + 14.0, 1.0))
            x, _ = _beside(y, low)
            plan.add(
                "terrain", "tufts", x, y, seed=seed_of(rng), size=(high - low, 12.0, tall, density * share),
                heading=math.atan2(_bend(y) - _bend(y + 12.0), 12.0),
            )  # fmt: skip


def _add_furniture(plan: StreetPlan) -> None:
    low, high = _BARRIER
    barrier = plan.add("guard-rail", "crash-barrier", _HALF + 1.0, high, heading=math.pi, size=(high - low,))
    plan.block(barrier, rectangle(_HALF + 0.85, low, _HALF + 1.2, high), 0.75)
    for y in np.arange(-9.0, 250.0, 25.0).tolist():
        turn = math.atan(-0.0022 * max(y - _BEND, 0.0))
        for side in (-1.0, 1.0):
            if side > 0 and low - 1.0 < y < high + 1.0:
                continue
            x, _ = _beside(y, side * (_HALF + 0.55))
            plan.stand("pole", "delineator", Spot(x, y, -turn), 0.08, height=1.05)
    sign(plan, 3, Spot(_HALF + 1.6, 5.0, 0.0))
    sign(plan, 1, Spot(_HALF + 1.6, 52.0, 0.0))


def _add_plants(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Add a hedge and trees along the fields, a farm, and woods that close the view."""
    for y in np.arange(13.0, 38.0, 1.3).tolist():
        x, _ = _beside(y, 9.6 + float(rng.uniform(-0.35, 0.35)))
        plant(plan, rng, str(rng.choice(("far-cherry", "far-cherry", "far-hornbeam"))), x, y, 0.58, 1.25)
    for y, right, kind in (
        (11.0, -9.6, "oak"), (23.0, -9.3, "birch"), (36.0, -9.8, "oak"), (50.0, -9.5, "plane"), (64.0, -9.7, "oak"),
        (40.0, 9.6, "oak"), (53.0, 10.0, "plane"), (70.0, 9.4, "birch"), (84.0, 9.6, "oak"), (80.0, -9.5, "oak"),
    ):  # fmt: skip
        x, _ = _beside(y, right)
        plant(plan, rng, kind if y < 42.0 else f"far-{kind}", x, y, 1.05)
    spot = Spot(-62.0, 118.0, math.radians(20.0))
    add_house(plan, rng, "gable", spot, 11.0, floors=(2,))
    add_house(plan, rng, "plain", Spot(-49.0, 124.0, math.radians(20.0)), 14.0, floors=(2,))
    for k in range(76):
        x = -170.0 + 4.3 * k + float(rng.uniform(-1.5, 1.5))
        y = 250.0 - 0.25 * abs(x) + float(rng.uniform(-9.0, 9.0))
        if abs(x - _bend(y)) > 8.0:
            plant(plan, rng, of_woods(rng), x, y, 1.35, 3.2 * (k % 2))
    for k in range(16):
        x, y = 52.0 + float(rng.uniform(-4.0, 4.0)), 40.0 + 8.0 * k
        plant(plan, rng, of_woods(rng), x, y, 1.1, 2.9 * (k % 2))


PACK: Final = Pack(3, Settings, site, draw_season)
