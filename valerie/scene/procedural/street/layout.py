"""Where things stand in a street: seeded rules, no shapes.

People walk at x −2…7 m, y 5…35 m and cameras look along +y from about (2.5, −12, 1.4): parked cars, trunks and posts
stand between the two, with gaps, and never within `CAMERA_CORRIDOR`.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import shapely

from valerie.scene.procedural.street.plan import (
    CAMERA_CORRIDOR,
    KERB_HEIGHT,
    LEFT_FRONT,
    LEFT_KERB,
    RIGHT_FRONT,
    RIGHT_KERB,
    ROAD_START,
    ROAD_STOP,
    ROW_START,
    ROW_STOP,
    Footprint,
    GroundRegion,
    Placement,
    Polygon,
    StreetLayout,
    StreetSettings,
    disc,
    rectangle,
    turned_rectangle,
)
from valerie.scene.procedural.vehicles.build import dimensions

HOUSE_STYLES = ("brick", "classic", "plain", "gable", "shop")
HOUSE_DEPTH = 11.0
#: What is parked and how often.
_PARKED = {"hatchback": 0.36, "sedan": 0.18, "estate": 0.18, "suv": 0.22, "van": 0.06}
#: Seeds of a kind that differ: rims, plates, paint.
CAR_MODELS = 6
TREE_MODELS = 3
#: Along the street: pedestrian crossings (centre).
CROSSINGS = (0.0, 66.0)
_KERB_GAP = 0.2
#: Up to here along the street people are varied: some bays stay free, so that most places are seen past the cars.
WALK_STOP = 34.0
#: Signs: left side?, about where, which face (`textures.things.sign_faces`).
_SIGNS = (
    (True, 4.6, 4), (False, 5.2, 4), (True, 19.0, 5), (False, 15.5, 2), (True, 33.0, 1), (False, 36.0, 6),
    (True, 61.0, 4), (False, 70.5, 4), (True, 84.0, 2), (False, 92.0, 0),
)  # fmt: skip


class _Plan:
    """Collects placements and footprints and numbers the objects of each class."""

    def __init__(self) -> None:
        self.placements: list[Placement] = []
        self.footprints: list[Footprint] = []
        self._numbers: Counter[str] = Counter()

    def add(self, object_class: str, kind: str, x: float, y: float, **more: Any) -> Placement:
        self._numbers[object_class] += 1
        path = f"scene.{object_class}-{self._numbers[object_class]}"
        placed = Placement(path, kind, round(x, 4), round(y, 4), **more)
        self.placements.append(placed)
        return placed

    def block(self, placed: Placement, polygon: Polygon) -> None:
        self.footprints.append(Footprint(placed.path, polygon))


def layout_street(settings: StreetSettings) -> StreetLayout:
    """Place everything in the street; a few milliseconds, no meshes.

    Args:
        settings: equal settings give equal layouts.
    """
    streams = np.random.SeedSequence(settings.seed).spawn(6)
    houses, cars, trees, furniture, ends, cycles = (np.random.default_rng(stream) for stream in streams)
    plan = _Plan()
    plan.add("road", "carriageway", 0.0, 0.0, seed=_seed(ends))
    plan.add("sidewalk", "left", 0.0, 0.0)
    plan.add("sidewalk", "right", 0.0, 0.0)
    plan.add("terrain", "outskirts", 0.0, 0.0)
    _place_houses(plan, houses)
    _place_ends(plan, ends)
    _place_cars(plan, cars)
    kerbside = _place_trees(plan, trees)
    _place_furniture(plan, furniture, kerbside)
    _place_large_vehicles(plan)
    _place_cycles(plan, cycles)
    ground = (
        GroundRegion(rectangle(-12.0, ROAD_START, LEFT_KERB, ROAD_STOP - 6.0), KERB_HEIGHT),
        GroundRegion(rectangle(RIGHT_KERB, ROAD_START, 17.0, ROAD_STOP - 6.0), KERB_HEIGHT),
    )
    extent = (LEFT_FRONT - HOUSE_DEPTH, ROAD_START, RIGHT_FRONT + HOUSE_DEPTH, ROAD_STOP)
    return StreetLayout(settings, tuple(plan.placements), tuple(plan.footprints), ground, extent)


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))


def _place_houses(plan: _Plan, rng: np.random.Generator) -> None:
    """Two rows without gaps; neighbours differ in style, a few stand back behind a front garden."""
    for left in (True, False):
        y, previous, since_garden = ROW_START, "", 0
        while y < ROW_STOP - 0.1:
            rest = ROW_STOP - y
            width = float(rng.uniform(9.0, 15.5))
            if rest < width + 9.0:
                width = rest if rest < 16.0 else 0.5 * rest
            choices = [style for style in HOUSE_STYLES if style != previous and not (style == "gable" and width > 12.5)]
            style = str(rng.choice(choices))
            setback = float(rng.choice([0.0, 0.0, 0.12, 0.3]))
            garden = style in {"brick", "plain"} and since_garden > 1 and rng.random() < 0.6
            since_garden = 0 if garden else since_garden + 1
            if garden:
                setback = 1.7
            front = LEFT_FRONT - setback if left else RIGHT_FRONT + setback
            heading, start = (0.5 * math.pi, y) if left else (-0.5 * math.pi, y + width)
            bays, door = _bays(width, rng)
            house = plan.add(
                "building", style, front, start, z=KERB_HEIGHT, heading=heading, seed=_seed(rng),
                size=(round(width, 3), HOUSE_DEPTH, bays, door), variant=int(rng.choice([3, 3, 4, 4, 5])),
            )  # fmt: skip
            plan.block(house, turned_rectangle(front, start, heading, (0.0, 0.0), (width, HOUSE_DEPTH)))
            if garden:
                entrance = (door + 0.5) * width / bays
                _place_garden(
                    plan, rng, left=left, y0=y, y1=y + width, gate=y + entrance if left else y + width - entrance
                )
            previous = style
            y += width


def _bays(width: float, rng: np.random.Generator) -> tuple[int, int]:
    """Number of window axes of a front, and which of them has the door."""
    bays = max(round(width / float(rng.uniform(2.35, 2.9))), 3)
    return bays, int(rng.integers(bays))


def _place_garden(plan: _Plan, rng: np.random.Generator, *, left: bool, y0: float, y1: float, gate: float) -> None:
    """Grass and a hedge behind railings or a low wall on both sides of the way to the door."""
    outward = -1.0 if left else 1.0
    line = (LEFT_FRONT if left else RIGHT_FRONT) + 0.12 * outward
    kind = ("fence", "railing") if rng.random() < 0.6 else ("wall", "low")
    for start, stop in ((y0, gate - 0.75), (gate + 0.75, y1)):
        if stop - start < 1.0:
            continue
        inner = line + 1.58 * outward
        plan.add("terrain", "garden", min(line, inner), start, z=KERB_HEIGHT, size=(abs(inner - line), stop - start))
        border = plan.add(*kind, line, start, z=KERB_HEIGHT, size=(stop - start,))
        plan.block(border, rectangle(line - 0.12, start, line + 0.12, stop))
        x = line + 0.45 * outward
        hedge = plan.add(
            "vegetation", "hedge", x, start + 0.2, z=KERB_HEIGHT, seed=_seed(rng), size=(0.6, stop - start - 0.4, 0.9)
        )
        plan.block(hedge, rectangle(x - 0.3, start + 0.2, x + 0.3, stop - 0.2))


def _place_ends(plan: _Plan, rng: np.random.Generator) -> None:
    """Cross streets at both ends with houses behind, so that no open horizon shows."""
    for y, heading, direction in ((ROAD_STOP + 3.0, 0.0, 1.0), (ROAD_START - 3.0, math.pi, -1.0)):
        plan.add("road", "cross-road", 2.5, y - 6.0 * direction, size=(90.0, 6.0))
        plan.add("sidewalk", "cross-footway", 2.5, y - 1.5 * direction, size=(90.0, 3.0))
        x, previous = -21.0, ""
        while x < 26.0:
            width = float(rng.uniform(11.0, 16.0))
            style = str(rng.choice([s for s in ("brick", "classic", "plain", "shop") if s != previous]))
            origin = x if direction > 0 else x + width
            bays, door = _bays(width, rng)
            house = plan.add(
                "building", style, origin, y, z=KERB_HEIGHT, heading=heading, seed=_seed(rng),
                size=(round(width, 3), HOUSE_DEPTH, bays, door), variant=int(rng.integers(4, 6)),
            )  # fmt: skip
            plan.block(house, turned_rectangle(origin, y, heading, (0.0, 0.0), (width, HOUSE_DEPTH)))
            previous = style
            x += width


def _place_cars(plan: _Plan, rng: np.random.Generator) -> None:
    """Both parking bays: rows with tight gaps, now and then a free bay; one van where people walk."""
    van_left = bool(rng.random() < 0.5)
    for left in (True, False):
        y = float(rng.uniform(13.0, 16.0) if left else rng.uniform(9.5, 12.5))
        parked = 0
        while y < ROW_STOP - 8.0:
            kind = str(rng.choice(list(_PARKED), p=list(_PARKED.values())))
            if left == van_left and parked == 1:
                kind = "van"
            length, width, _ = dimensions(kind)
            crossing = next((c for c in CROSSINGS if y < c + 5.5 and y + length > c - 5.5), None)
            if crossing is not None:
                y = crossing + 5.6
                continue
            inset = 0.5 * width + _KERB_GAP + float(rng.uniform(0.0, 0.07))
            x = LEFT_KERB + inset if left else RIGHT_KERB - inset
            backwards = rng.random() < 0.18
            car = plan.add(
                "car", kind, x, y + 0.5 * length, seed=_seed(rng), variant=int(rng.integers(CAR_MODELS)),
                heading=_whole(180.0 * backwards + float(rng.normal(0.0, 0.46))),
            )  # fmt: skip
            plan.block(
                car,
                turned_rectangle(car.x, car.y, car.heading, (-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length)),
            )
            parked += 1
            y += length + _gap(rng, roomy=y < WALK_STOP)


def _place_large_vehicles(plan: _Plan) -> None:
    """A delivery truck and a bus in the cross street at the far end."""
    for kind, x, y in (("truck", -2.6, ROAD_STOP - 4.5), ("bus", 8.2, ROAD_STOP - 1.5)):
        length, width, _ = dimensions(kind)
        placed = plan.add(kind, kind, x, y, heading=0.5 * math.pi)
        plan.block(
            placed, turned_rectangle(x, y, placed.heading, (-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length))
        )


def _place_cycles(plan: _Plan, rng: np.random.Generator) -> None:
    """Motorcycles in free bays, bicycles along the kerbs where nothing else stands."""
    blocked = shapely.union_all([shapely.Polygon(footprint.polygon) for footprint in plan.footprints])
    zebras = shapely.union_all([shapely.box(LEFT_KERB, c - 3.2, RIGHT_KERB, c + 3.2) for c in CROSSINGS])
    keep_free = blocked.union(zebras).union(shapely.box(*CAMERA_CORRIDOR))
    for kind, tries, wanted in (("motorcycle", 40, 3), ("bicycle", 60, 8)):
        found = 0
        length, width, _ = dimensions(kind)
        for _ in range(tries):
            left = bool(rng.random() < 0.5)
            y = float(rng.uniform(8.0, ROW_STOP - 8.0))
            if kind == "motorcycle":
                x = LEFT_KERB + 1.1 if left else RIGHT_KERB - 1.1
                heading = (0.5 if left else -0.5) * math.pi + float(rng.uniform(-0.1, 0.1))
            else:
                x = LEFT_KERB - 0.55 if left else RIGHT_KERB + 0.55
                heading = float(rng.choice([0.0, math.pi])) + float(rng.normal(0.0, 0.06))
            low, high = (-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length)
            polygon = turned_rectangle(round(x, 4), round(y, 4), heading, low, high)
            shape = shapely.Polygon(polygon)
            if found == wanted or shape.buffer(0.35).intersects(keep_free):
                continue
            z = 0.0 if kind == "motorcycle" else KERB_HEIGHT
            placed = plan.add(kind, kind, x, y, z=z, heading=heading, variant=int(rng.integers(CAR_MODELS)))
            plan.block(placed, polygon)
            keep_free = keep_free.union(shape)
            found += 1


def _whole(degrees: float) -> float:
    """Radians of a heading in thousandths of a degree, so that a declared default says it exactly."""
    return math.radians(round(degrees % 360.0, 3))


def _gap(rng: np.random.Generator, *, roomy: bool) -> float:
    """Metres to the next parked car: manoeuvring room, or a free bay or two (more of them where people walk)."""
    tight = rng.random() < (0.1 if roomy else 0.55)
    return float(rng.uniform(0.7, 1.5) if tight else rng.uniform(*((6.5, 11.0) if roomy else (3.6, 7.5))))


def _place_trees(plan: _Plan, rng: np.random.Generator) -> list[tuple[bool, float]]:
    """Trees along both kerbs; returns (left side?, y) of each trunk."""
    trunks = []
    for left in (True, False):
        y = ROW_START + (4.0 if left else 8.5)
        while y < ROW_STOP - 3.0:
            here = y + float(rng.uniform(-1.2, 1.2))
            y += 10.2
            if CAMERA_CORRIDOR[1] - 2.0 < here < CAMERA_CORRIDOR[3] + 0.5 or any(
                abs(here - c) < 4.5 for c in CROSSINGS
            ):
                continue
            if rng.random() < 0.08:
                continue
            x = LEFT_KERB - 0.62 if left else RIGHT_KERB + 0.62
            tree = plan.add(
                "vegetation", "tree" if 0.0 < here < 42.0 else "far-tree", x, here, z=KERB_HEIGHT,
                heading=float(rng.uniform(0.0, 2.0 * math.pi)), variant=int(rng.integers(TREE_MODELS)),
                size=(float(rng.uniform(0.92, 1.1)),),
            )  # fmt: skip
            plan.block(tree, disc(x, here, 0.2))
            trunks.append((left, here))
    for x in (-9.0, -3.2, 3.4, 9.6, 16.0):  # beyond the cross street
        tree = plan.add(
            "vegetation", "far-tree", x + float(rng.uniform(-0.8, 0.8)), ROAD_STOP + 0.6, z=KERB_HEIGHT,
            heading=float(rng.uniform(0.0, 6.0)), variant=int(rng.integers(TREE_MODELS)),
            size=(float(rng.uniform(1.0, 1.2)),),
        )  # fmt: skip
        plan.block(tree, disc(tree.x, tree.y, 0.2))
    return trunks


def _place_furniture(plan: _Plan, rng: np.random.Generator, trunks: list[tuple[bool, float]]) -> None:
    """Lamp posts, signs, bollards, bins, planters, bicycle stands: where the trunks leave room."""
    taken = list(trunks)

    def free(y: float, *, left: bool) -> float:
        """The nearest place along the kerb at least 1.6 m from what stands there already."""
        for step in range(60):
            candidate = y + 0.25 * step
            if all(side != left or abs(candidate - other) > 1.6 for side, other in taken):
                taken.append((left, candidate))
                return candidate
        return y

    def kerbside(
        object_class: str, kind: str, y: float, radius: float, *, left: bool, inset: float = 0.42, **more: Any
    ) -> Placement:
        x = LEFT_KERB - inset if left else RIGHT_KERB + inset
        heading = 0.0 if left else math.pi
        placed = plan.add(object_class, kind, x, y, z=KERB_HEIGHT, heading=heading, **more)
        plan.block(placed, disc(x, y, radius))
        return placed

    for left in (True, False):
        y = 12.0 if left else 24.5
        for k in range(-1, 4):
            place = free(y + 25.0 * k + float(rng.uniform(-1.5, 1.5)), left=left)
            if not CAMERA_CORRIDOR[1] - 2.0 < place < CAMERA_CORRIDOR[3]:
                kerbside("pole", "lamp", place, 0.09, left=left)
    for left, y, face in _SIGNS:
        place = free(y + float(rng.uniform(-0.5, 1.5)), left=left)
        post = kerbside("pole", "post", place, 0.05, left=left, inset=0.36)
        plan.add("traffic-sign", "face", post.x, post.y - 0.045, z=KERB_HEIGHT, variant=face)
    for crossing in CROSSINGS:
        for left in (True, False):
            for offset in (-5.0, -3.7, 3.0):
                kerbside("pole", "bollard", crossing + offset, 0.08, left=left, inset=0.3)
    for left in (True, False):
        light = kerbside("pole", "signal-post", CROSSINGS[1] - 2.6, 0.07, left=left, inset=0.4)
        plan.add("traffic-light", "signal", light.x, light.y - 0.06, z=KERB_HEIGHT)
        _place_along_walls(plan, rng, left=left)


def _place_along_walls(plan: _Plan, rng: np.random.Generator, *, left: bool) -> None:
    """Bins and planters, clear of house doors and of each other."""
    front, heading = (LEFT_FRONT, 0.5 * math.pi) if left else (RIGHT_FRONT, -0.5 * math.pi)
    taken = []
    for house in plan.placements:
        if house.object_class == "building" and house.heading == heading:
            width, _, bays, door = house.size
            taken.append(house.y + math.copysign((door + 0.5) * width / bays, heading))
    x = front + 0.42 if left else front - 0.42
    for y in rng.uniform(6.0, 90.0, 6):
        if any(abs(y - other) < 2.0 for other in taken):
            continue
        taken.append(float(y))
        if rng.random() < 0.5:
            size = (0.5, 1.1)
            planter = plan.add("vegetation", "planter", x, float(y) - 0.55, z=KERB_HEIGHT, seed=_seed(rng), size=size)
            plan.block(planter, rectangle(x - 0.25, planter.y, x + 0.25, planter.y + 1.1))
        else:
            bins = plan.add("static", "bins", x, float(y), z=KERB_HEIGHT, heading=heading, seed=_seed(rng))
            plan.block(bins, rectangle(x - 0.36, bins.y - 0.65, x + 0.36, bins.y + 0.65))
