"""The vehicles in traffic of a generated street: default places, parameters, outlines.

All are hidden by default and then cost nothing. Their default places block nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import shapely

from urban_street.pedestrians import PERSON_RADIUS_M, PLACES
from urban_street.street.plan import StreetLayout, turned_rectangle
from urban_street.street.shapes import Polygon
from urban_street.vehicles.build import KINDS, dimensions
from urban_street.vehicles.designs import EARLY
from urban_street.vehicles.paints import ALL_PAINTS, PAINTS
from valerie.parameters.declaring import angle, choice, number, switch
from valerie.parameters.definitions import Affects, ParameterDefinition
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.assets.manifest import Footprint
from valerie.scene.graph.naming import ROOT

#: x0, y0, x1, y1, metres.
Box = tuple[float, float, float, float]
#: Default paint of vehicles in traffic.
DEFAULT_PAINT: Final = "blue"
#: Bodies of the cars of the first street. Training scenes draw one of these five.
CAR_KINDS: Final = EARLY
#: All bodies of cars, and of trucks.
ALL_CARS, ALL_TRUCKS = (tuple(kind for kind, of in KINDS.items() if of == name) for name in ("car", "truck"))


@dataclass(frozen=True, slots=True)
class TrafficPlace:
    """The default place of a vehicle in traffic (metres, degrees), and its kinds.

    Attributes:
        kinds: kinds of which one or none is visible; empty for a vehicle with a single kind.
        rider: name of its rider's node, if it has a rider.
        seed: seed of its rims and number plate.
        shown: True if it is there by default, a car in the first of its kinds.
        paints: names of the paints that it can have.
    """

    x: float
    y: float
    heading: float
    kinds: tuple[str, ...] = ()
    rider: str = ""
    seed: int = 0
    shown: bool = False
    paints: tuple[str, ...] = tuple(PAINTS)


#: Vehicles whose places are the same in every street.
_FIXED: Final = {
    "car-101": TrafficPlace(2.5, 40.0, 180.0, CAR_KINDS),
    "bicycle-101": TrafficPlace(1.9, 16.0, 0.0, rider="rider-101"),
}
#: Vehicles that take the first free place in their lane, from their preferred place on.
_FITTED: Final = {
    "car-102": TrafficPlace(2.5, 47.0, 180.0, CAR_KINDS, seed=10),
    "motorcycle-101": TrafficPlace(2.9, 33.0, 180.0, rider="rider-102"),
    "truck-101": TrafficPlace(2.5, 60.0, 180.0),
    "bus-101": TrafficPlace(2.5, 60.0, 0.0),
    "car-103": TrafficPlace(2.5, 66.0, 180.0, ALL_CARS, seed=20, paints=tuple(ALL_PAINTS)),
    "truck-102": TrafficPlace(2.5, -24.0, 180.0, ALL_TRUCKS, paints=tuple(ALL_PAINTS)),
}
#: Names of the vehicles that training scenes never show, since shipped networks were trained on the draws of each seed.
UNTRAINED: Final = tuple(_FITTED)
#: A waiting cyclist far down the street, who belongs to the background and has the shape of the moving cyclist.
WAITING: Final = {"bicycle-100": TrafficPlace(3.1, 57.0, 180.0, rider="rider-100", shown=True)}

#: Range of vehicles in the street, metres.
VEHICLE_REACH: Final[Box] = (-20.0, -30.0, 25.0, 112.0)
#: Range of vehicles along the street, room before the far end, and step of the search, metres.
_ALONG: Final = VEHICLE_REACH[1::2]
_END_M: Final = 12.0
_STEP_M: Final = 0.5
#: Distance between a vehicle's default place and other objects, metres.
_ROOM_M: Final = 0.05


def class_of(name: str) -> str:
    """Return the class that a node's name states: ``truck`` of ``truck-101``."""
    return name.rpartition("-")[0]


def traffic(layout: StreetLayout) -> dict[str, TrafficPlace]:
    """Return the vehicles in traffic by name, at places with room for them."""
    places = dict(_FIXED)
    ground = [shapely.Polygon(footprint.polygon) for footprint in layout.footprints]
    ground += [shapely.Point(person.x, person.y).buffer(PERSON_RADIUS_M) for person in PLACES]
    ground += [
        shapely.Polygon(outline) for name, at in (*places.items(), *WAITING.items()) for outline in outlines(name, at)
    ]
    for name, wish in _FITTED.items():
        places[name] = _fitted(name, wish, layout, shapely.STRtree(ground))
        ground += [shapely.Polygon(outline) for outline in outlines(name, places[name])]
    return places


def outlines(name: str, at: TrafficPlace) -> list[Polygon]:
    """Return the outline of each kind of a vehicle at its place, metres."""
    polygons = []
    for kind in at.kinds or (class_of(name),):
        length, width, _ = dimensions(kind)
        low, high = (-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length)
        polygons.append(turned_rectangle(at.x, at.y, math.radians(at.heading), low, high))
    return polygons


def traffic_obstacles(places: Mapping[str, TrafficPlace]) -> Iterator[Footprint]:
    """Yield outlines of vehicles at their places."""
    for name, at in places.items():
        for kind, polygon in zip(at.kinds or (class_of(name),), outlines(name, at), strict=True):
            path = f"{ROOT}.{name}.{kind}" if at.kinds else f"{ROOT}.{name}"
            height = max(dimensions(kind)[2], 1.8)
            yield Footprint(path=path, polygon=polygon, reason=f"inside {name}", height_m=height)


def traffic_parameters(places: Mapping[str, TrafficPlace], reach: Box) -> Iterator[ParameterDefinition]:
    """Yield the parameters of the vehicles in traffic, which may be anywhere within ``reach``."""
    for name, at in places.items():
        path = f"{ROOT}.{name}"
        if at.kinds:
            kind = at.kinds[0] if at.shown else ABSENT
            yield choice(f"{path}.kind", (*at.kinds, ABSENT), kind, Affects.GEOMETRY, "body of the vehicle, or absent")
        else:
            yield switch(f"{path}.visible", at.shown, Affects.GEOMETRY, "whether it is visible")
        yield from place_parameters(path, at.x, at.y, at.heading, reach)
        yield choice(f"{path}.colour", at.paints, DEFAULT_PAINT, Affects.MATERIAL, "of the paint")


def place_parameters(path: str, x: float, y: float, heading: float, reach: Box) -> Iterator[ParameterDefinition]:
    """Yield position and heading of a vehicle, anywhere within ``reach``."""
    yield number(f"{path}.pos.x", reach[0], reach[2], x, Affects.GEOMETRY, "m", "position across the street")
    yield number(f"{path}.pos.y", reach[1], reach[3], y, Affects.GEOMETRY, "m", "position along the street")
    yield angle(f"{path}.heading", heading, Affects.GEOMETRY, "0 faces +y, counter-clockwise from above")


def _fitted(name: str, wish: TrafficPlace, layout: StreetLayout, ground: shapely.STRtree) -> TrafficPlace:
    """Return the first place with room for every kind, from the preferred place onwards, else the first place before it.

    The carriageway behind the cameras is free in every street, so there is always a place.
    """
    ahead = round((min(_ALONG[1], layout.extent[3] - _END_M) - wish.y) / _STEP_M)
    behind = round((wish.y - _ALONG[0]) / _STEP_M)
    for step in (*range(ahead), *(-k for k in range(1, behind))):
        place = replace(wish, y=wish.y + _STEP_M * step)
        room = shapely.MultiPolygon([shapely.Polygon(outline) for outline in outlines(name, place)]).buffer(_ROOM_M)
        if not len(ground.query(room, predicate="intersects")):
            return place
    raise AssertionError(f"no room for {name}")
