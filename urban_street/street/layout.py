"""Lay out a street: seeded rules for the places of objects, without shapes.

People walk at x −2…7 m, y 5…35 m, and cameras look along +y from about (2.5, −12, 1.4). Parked cars, trunks and posts are
between them, with gaps, and never within `CAMERA_CORRIDOR`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import shapely

from urban_street.street import layout_furniture
from urban_street.street.plan import (
    CAMERA_CORRIDOR,
    SIDE_HALF,
    SIDE_LENGTH,
    SIDE_ROAD_HALF,
    GroundRegion,
    Placement,
    Spot,
    StreetLayout,
    StreetSettings,
    disc,
    rectangle,
    turned_rectangle,
)
from urban_street.street.planning import StreetPlan, seed_of
from urban_street.street.rows import CORNERS, ENDS, HOUSE_DEPTH, HOUSE_STYLES, NARROW, add_house, bays_of, next_width
from urban_street.street.species import SPECIES, garden_kinds, kerb_kinds
from urban_street.vehicles.build import dimensions

#: Depth of houses in a side street, metres: less than the width of the narrowest corner house.
_SIDE_DEPTH = 7.9
#: Weights of parked cars by kind.
_PARKED: Final[dict[str, float]] = {
    **dict.fromkeys(("hatchback", "city-car", "three-door", "crossover", "suv", "estate", "touring-estate"), 0.08),
    **dict.fromkeys(("sedan", "mpv", "leisure-van", "electric-saloon", "large-suv", "microcar", "coupe"), 0.04),
    **dict.fromkeys(("notchback", "limousine", "city-van", "minibus", "taxi", "van"), 0.02),
    **dict.fromkeys(("convertible", "sports-car", "classic-car", "off-roader"), 0.01),
}
#: Number of different seeds of a kind, which determine rims, plates and paint.
CAR_MODELS = 6
TREE_MODELS = 3
_KERB_GAP = 0.2
#: End of the people's range along the street, metres. Some bays up to here stay free, so that most places are visible.
WALK_STOP = 34.0
#: Signs: left side?, approximate place, face (`signs.faces.PLACED`).
_SIGNS = (
    (True, 4.6, 4), (False, 5.2, 4), (True, 19.0, 5), (False, 15.5, 2), (True, 33.0, 1), (False, 36.0, 6),
    (True, 61.0, 4), (False, 70.5, 4), (True, 84.0, 2), (False, 92.0, 0),
)  # fmt: skip


def _signs(row_stop: float) -> Iterator[tuple[bool, float, int]]:
    """Yield the signs of a street whose houses end at ``row_stop``. They repeat every 88 m."""
    for again in range(math.ceil(row_stop / 88.0)):
        for left, y, face in _SIGNS:
            if again == 0 or 96.0 < y + 88.0 * again < row_stop - 5.0:
                yield left, y + 88.0 * again, face


def layout_street(settings: StreetSettings) -> StreetLayout:
    """Place all objects of the street in a few milliseconds, without meshes.

    Args:
        settings: arguments of the street. Equal settings give equal layouts.
    """
    streams = np.random.SeedSequence(settings.seed).spawn(6)
    houses, cars, trees, furniture, ends, cycles = (np.random.default_rng(stream) for stream in streams)
    plan = StreetPlan(settings)
    lines = plan.lines
    plan.add("road", "carriageway", 0.0, 0.0, seed=seed_of(ends))
    plan.add("sidewalk", "left", 0.0, 0.0)
    plan.add("sidewalk", "right", 0.0, 0.0)
    plan.add("terrain", "outskirts", 0.0, 0.0)
    _place_houses(plan, houses)
    if lines.side_y is not None:
        _place_side_street(plan, lines.side_y, np.random.default_rng(np.random.SeedSequence([settings.seed, 7004])))
    _place_ends(plan, ends)
    _place_cars(plan, cars)
    kerbside = _place_trees(plan, trees)
    _place_furniture(plan, furniture, kerbside)
    _place_large_vehicles(plan)
    _place_cycles(plan, cycles)
    layout_furniture.place_furniture(plan, np.random.default_rng(np.random.SeedSequence([settings.seed, 7003])))
    left, right = round(lines.front(left=True), 4), round(lines.front(left=False), 4)
    stop, height = lines.road_stop - 6.0, lines.kerb_height
    ground = [
        GroundRegion(rectangle(round(left - 8.4, 4), lines.road_start, lines.left_kerb, stop), height),
        GroundRegion(rectangle(lines.right_kerb, lines.road_start, round(right + 8.4, 4), stop), height),
    ]
    for x0, x1 in ((round(left - 8.4, 4), lines.left_kerb), (lines.right_kerb, round(right + 8.4, 4))):
        if lines.side_y is not None and lines.sides[0 if x0 < lines.left_kerb else 1]:
            y = lines.side_y
            ground.append(GroundRegion(rectangle(x0, y - SIDE_ROAD_HALF, x1, y + SIDE_ROAD_HALF), 0.0))
    extent = (left - HOUSE_DEPTH, lines.road_start, right + HOUSE_DEPTH, lines.road_stop)
    return StreetLayout(settings, tuple(plan.placements), tuple(plan.footprints), tuple(ground), extent)


def _place_houses(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Place two rows of houses without gaps except for side streets. Neighbours differ in style; a few have front gardens."""
    for left in (True, False):
        for start, stop in plan.lines.spans(plan.lines.row_start, plan.lines.row_stop, SIDE_HALF, left=left):
            _place_row(plan, rng, start, stop, left=left)


def _place_row(plan: StreetPlan, rng: np.random.Generator, y: float, stop: float, *, left: bool) -> None:
    lines, styles = plan.lines, HOUSE_STYLES
    previous, since_garden = "", 0
    while y < stop - 0.1:
        width = next_width(rng, stop - y)
        choices = [style for style in styles if style != previous and not (style in NARROW and width > 12.5)]
        # The side wall of a corner house is a second front, and the side street's houses begin at its back.
        before, behind = (lines.in_side_street(edge, SIDE_HALF + 0.1, left=left) for edge in (y + width, y))
        if before or behind:
            choices = [style for style in CORNERS if style != previous]
        style = str(rng.choice(choices))
        setback = float(rng.choice([0.0, 0.0, 0.12, 0.3]))
        garden = style in {"brick", "plain", "bay"} and since_garden > 1 and rng.random() < 0.6
        since_garden = 0 if garden else since_garden + 1
        if garden:
            setback = 1.7
        if before or behind:
            garden, setback = False, lines.setback
        elif lines.setback > 0.0:
            garden, setback = lines.setback >= 1.5, lines.setback
        front = lines.left_front - setback if left else lines.right_front + setback
        heading, start = (0.5 * math.pi, y) if left else (-0.5 * math.pi, y + width)
        bays, door = bays_of(width, rng)
        house = plan.add(
            "building", style, front, start, z=plan.lines.kerb_height, heading=heading, seed=seed_of(rng),
            size=(round(width, 3), HOUSE_DEPTH, bays, door, *((1.0 if before == left else -1.0,) if before or behind else ())),
            variant=int(rng.choice([3, 3, 4, 4, 5])),
        )  # fmt: skip
        plan.block(house, turned_rectangle(front, start, heading, (0.0, 0.0), (width, HOUSE_DEPTH)))
        if garden:
            entrance = (door + 0.5) * width / bays
            gate = y + entrance if left else y + width - entrance
            _place_garden(plan, rng, left=left, y0=y, y1=y + width, gate=gate, depth=setback - 0.12)
        previous = style
        y += width


def _place_side_street(plan: StreetPlan, y: float, rng: np.random.Generator) -> None:
    """Place a street to the left, the right or both, with carriageway, pavements, two rows of houses and one across its end."""
    lines = plan.lines
    for left, there in zip((True, False), lines.sides, strict=True):
        if not there:
            continue
        outward = -1.0 if left else 1.0
        kerb, front = (lines.left_kerb, lines.front(left=True)) if left else (lines.right_kerb, lines.front(left=False))
        end = front + outward * SIDE_LENGTH
        x0, x1 = sorted((kerb, end))
        plan.add("road", "side-road", x0, y, size=(x1 - x0, 2.0 * SIDE_ROAD_HALF))
        for side in (-1.0, 1.0):
            near, far = sorted((lines.left_front if left else lines.right_front, end))
            middle, wide = y + side * 0.5 * (SIDE_HALF + SIDE_ROAD_HALF), SIDE_HALF - SIDE_ROAD_HALF
            plan.add("sidewalk", "side-footway", near, middle, size=(far - near, wide, lines.kerb_height))
            x, previous = front + outward * HOUSE_DEPTH, ""
            for width in rng.dirichlet([40.0, 40.0, 40.0]) * (SIDE_LENGTH - HOUSE_DEPTH):
                low, high = sorted((x, x + outward * float(width)))
                # Fronts face the side street: houses before it (smaller y) face +y.
                heading, origin = (math.pi, high) if side < 0.0 else (0.0, low)
                style = str(rng.choice([s for s in ENDS if s != previous]))
                spot = Spot(origin, y + side * SIDE_HALF, heading)
                add_house(plan, rng, style, spot, float(width), _SIDE_DEPTH)
                previous, x = style, x + outward * float(width)
        heading, origin = (0.5 * math.pi, y - 11.0) if left else (-0.5 * math.pi, y + 11.0)
        add_house(plan, rng, "classic", Spot(end, origin, heading), 22.0)


def _place_garden(
    plan: StreetPlan, rng: np.random.Generator, *, left: bool, y0: float, y1: float, gate: float, depth: float
) -> None:
    """Place grass and a hedge behind railings or a low wall, on both sides of the path to the door."""
    outward = -1.0 if left else 1.0
    line = (plan.lines.left_front if left else plan.lines.right_front) + 0.12 * outward
    kind = ("fence", "railing") if rng.random() < 0.6 else ("wall", "low")
    for start, stop in ((y0, gate - 0.75), (gate + 0.75, y1)):
        if stop - start < 1.0:
            continue
        inner = line + depth * outward
        plan.add(
            "terrain",
            "garden",
            min(line, inner),
            start,
            z=plan.lines.kerb_height,
            size=(abs(inner - line), stop - start),
        )
        border = plan.add(*kind, line, start, z=plan.lines.kerb_height, size=(stop - start,))
        plan.block(border, rectangle(line - 0.12, start, line + 0.12, stop))
        x = line + 0.45 * outward
        hedge = plan.add(
            "vegetation",
            "hedge",
            x,
            start + 0.2,
            z=plan.lines.kerb_height,
            seed=seed_of(rng),
            size=(0.6, stop - start - 0.4, 0.9),
        )
        plan.block(hedge, rectangle(x - 0.3, start + 0.2, x + 0.3, stop - 0.2))


def _place_ends(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Place cross streets at both ends, with houses behind them that close the horizon."""
    lines = plan.lines
    first, last = round(lines.front(left=True) - 17.4, 4), round(lines.front(left=False) + 17.4, 4)
    middle = round(0.5 * (first + last), 4)
    for y, heading, direction in ((lines.road_stop + 3.0, 0.0, 1.0), (lines.road_start - 3.0, math.pi, -1.0)):
        plan.add("road", "cross-road", middle, y - 6.0 * direction, size=(90.0, 6.0))
        plan.add("sidewalk", "cross-footway", middle, y - 1.5 * direction, size=(90.0, 3.0))
        x, previous = first, ""
        while x < last:
            width = float(rng.uniform(11.0, 16.0))
            style = str(rng.choice([s for s in ENDS if s != previous]))
            add_house(plan, rng, style, Spot(x if direction > 0 else x + width, y, heading), width)
            previous = style
            x += width


def _place_cars(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Place cars in both parking bays, in rows with tight gaps and some free bays, and one van where people walk."""
    van_left = bool(rng.random() < 0.5)
    for left in (True, False):
        y = float(rng.uniform(13.0, 16.0) if left else rng.uniform(9.5, 12.5))
        parked = 0
        while y < plan.lines.row_stop - 8.0:
            kind = str(rng.choice(list(_PARKED), p=list(_PARKED.values())))
            if left == van_left and parked == 1:
                kind = "van"
            length, width, _ = dimensions(kind)
            crossing = next((c for c in plan.lines.crossings if y < c + 5.5 and y + length > c - 5.5), None)
            if crossing is not None:
                y = crossing + 5.6
                continue
            if plan.lines.in_side_street(y + 0.5 * length, SIDE_HALF + 0.5 * length, left=left):
                y += 1.0
                continue
            # Wide cars keep to their bay.
            inset = 0.5 * width + min(_KERB_GAP + float(rng.uniform(0.0, 0.07)), plan.lines.lanes[0] - width)
            x = plan.lines.left_kerb + inset if left else plan.lines.right_kerb - inset
            backwards = rng.random() < 0.18
            car = plan.add(
                "car", kind, x, y + 0.5 * length, seed=seed_of(rng), variant=int(rng.integers(CAR_MODELS)),
                heading=_whole(180.0 * backwards + float(rng.normal(0.0, 0.46))),
            )  # fmt: skip
            plan.block(
                car,
                turned_rectangle(car.x, car.y, car.heading, (-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length)),
            )
            parked += 1
            y += length + _gap(rng, roomy=y < WALK_STOP)


def _place_large_vehicles(plan: StreetPlan) -> None:
    """Place a delivery truck and a bus in the cross street at the far end."""
    for kind, x, y in (("truck", -2.6, plan.lines.road_stop - 4.5), ("bus", 8.2, plan.lines.road_stop - 1.5)):
        length, width, _ = dimensions(kind)
        placement = plan.add(kind, kind, x, y, heading=0.5 * math.pi)
        plan.block(
            placement,
            turned_rectangle(x, y, placement.heading, (-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length)),
        )


def _place_cycles(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Place motorcycles in free bays, and bicycles along the kerbs at free places."""
    lines = plan.lines
    zebras = [shapely.box(lines.left_kerb, c - 3.2, lines.right_kerb, c + 3.2) for c in lines.crossings]
    keep_free = shapely.union_all([*zebras, shapely.box(*CAMERA_CORRIDOR)])
    for kind, tries, number in (("motorcycle", 40, 3), ("bicycle", 60, 8)):
        count = 0
        length, width, _ = dimensions(kind)
        for _ in range(tries):
            left = bool(rng.random() < 0.5)
            y = float(rng.uniform(8.0, lines.row_stop - 8.0))
            if kind == "motorcycle":
                x = lines.left_kerb + 1.1 if left else lines.right_kerb - 1.1
                heading = (0.5 if left else -0.5) * math.pi + float(rng.uniform(-0.1, 0.1))
            else:
                x = lines.left_kerb - 0.55 if left else lines.right_kerb + 0.55
                heading = float(rng.choice([0.0, math.pi])) + float(rng.normal(0.0, 0.06))
            low, high = (-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length)
            polygon = turned_rectangle(round(x, 4), round(y, 4), heading, low, high)
            if (
                count == number
                or lines.in_side_street(y, SIDE_HALF, left=left)
                or shapely.Polygon(polygon).buffer(0.35).intersects(keep_free)
                or not plan.is_free(polygon, 0.35)
            ):
                continue
            z = 0.0 if kind == "motorcycle" else lines.kerb_height
            placement = plan.add(kind, kind, x, y, z=z, heading=heading, variant=int(rng.integers(CAR_MODELS)))
            plan.block(placement, polygon)
            count += 1


def _whole(degrees: float) -> float:
    """Return a heading in radians, rounded to thousandths of a degree, so that a declared default is exact."""
    return math.radians(round(degrees % 360.0, 3))


def _gap(rng: np.random.Generator, *, roomy: bool) -> float:
    """Return the distance to the next parked car, metres: manoeuvring room, or a free bay or two (more where people walk)."""
    tight = rng.random() < (0.1 if roomy else 0.55)
    return float(rng.uniform(0.7, 1.5) if tight else rng.uniform(*((6.5, 11.0) if roomy else (3.6, 7.5))))


def _place_trees(plan: StreetPlan, rng: np.random.Generator) -> list[tuple[bool, float]]:
    """Place trees along both kerbs, and return (left side?, y) of each trunk."""
    trunks = []
    picks = np.random.default_rng(np.random.SeedSequence([plan.settings.seed, 7006]))
    for left in (True, False):
        kinds = kerb_kinds(plan.settings, picks)
        y = plan.lines.row_start + (4.0 if left else 8.5)
        while y < plan.lines.row_stop - 3.0:
            here = y + float(rng.uniform(-1.2, 1.2))
            y += 10.2
            if CAMERA_CORRIDOR[1] - 2.0 < here < CAMERA_CORRIDOR[3] + 0.5 or any(
                abs(here - c) < 4.5 for c in plan.lines.crossings
            ):
                continue
            if rng.random() < 0.08 or plan.lines.in_side_street(here, SIDE_HALF + 0.8, left=left):
                continue
            x = plan.lines.left_kerb - 0.62 if left else plan.lines.right_kerb + 0.62
            kind = next(kinds)
            tree = plan.add(
                "vegetation", kind if 0.0 < here < 42.0 else f"far-{kind}", x, here, z=plan.lines.kerb_height,
                heading=float(rng.uniform(0.0, 2.0 * math.pi)), variant=int(rng.integers(TREE_MODELS)),
                size=(float(rng.uniform(0.92, 1.1)),),
            )  # fmt: skip
            plan.block(tree, disc(x, here, SPECIES[kind].footing))
            trunks.append((left, here))
    beyond = garden_kinds(picks)
    for x, kind in zip((-9.0, -3.2, 3.4, 9.6, 16.0), beyond, strict=False):  # beyond the cross street
        tree = plan.add(
            "vegetation", f"far-{kind}", x + float(rng.uniform(-0.8, 0.8)), plan.lines.road_stop + 0.6,
            z=plan.lines.kerb_height, heading=float(rng.uniform(0.0, 6.0)), variant=int(rng.integers(TREE_MODELS)),
            size=(float(rng.uniform(1.0, 1.2)),),
        )  # fmt: skip
        plan.block(tree, disc(tree.x, tree.y, SPECIES[kind].footing))
    return trunks


def _place_furniture(plan: StreetPlan, rng: np.random.Generator, trunks: list[tuple[bool, float]]) -> None:
    """Place lamp posts, signs, bollards, bins, planters and bicycle stands between the trunks."""
    places = list(trunks)

    def free(y: float, *, left: bool) -> float:
        """Return the nearest place along the kerb at least 1.6 m from all objects there."""
        for step in range(60):
            candidate = y + 0.25 * step
            if plan.lines.in_side_street(candidate, SIDE_HALF, left=left):
                continue
            if all(side != left or abs(candidate - other) > 1.6 for side, other in places):
                places.append((left, candidate))
                return candidate
        return y

    def kerbside(
        object_class: str, kind: str, y: float, radius: float, *, left: bool, inset: float = 0.42, **more: Any
    ) -> Placement:
        x = plan.lines.left_kerb - inset if left else plan.lines.right_kerb + inset
        heading = 0.0 if left else math.pi
        placement = plan.add(object_class, kind, x, y, z=plan.lines.kerb_height, heading=heading, **more)
        plan.block(placement, disc(x, y, radius))
        return placement

    for left in (True, False):
        y = 12.0 if left else 24.5
        for k in range(-1, math.floor((plan.lines.row_stop - 4.0 - y) / 25.0) + 1):
            place = free(y + 25.0 * k + float(rng.uniform(-1.5, 1.5)), left=left)
            if not CAMERA_CORRIDOR[1] - 2.0 < place < CAMERA_CORRIDOR[3]:
                kerbside("pole", "lamp", place, 0.09, left=left)
    for left, y, face in _signs(plan.lines.row_stop):
        place = free(y + float(rng.uniform(-0.5, 1.5)), left=left)
        post = kerbside("pole", "post", place, 0.05, left=left, inset=0.36)
        plan.add("traffic-sign", "face", post.x, post.y - 0.045, z=plan.lines.kerb_height, variant=face)
    for crossing in plan.lines.crossings:
        for left in (True, False):
            for offset in (-5.0, -3.7, 3.0):
                kerbside("pole", "bollard", crossing + offset, 0.08, left=left, inset=0.3)
    for left in (True, False):
        for crossing in plan.lines.crossings[1:]:
            light = kerbside("pole", "signal-post", crossing - 2.6, 0.07, left=left, inset=0.4)
            plan.add("traffic-light", "signal", light.x, light.y - 0.06, z=plan.lines.kerb_height)
        _place_along_walls(plan, rng, left=left)


def _place_along_walls(plan: StreetPlan, rng: np.random.Generator, *, left: bool) -> None:
    """Place bins and planters, clear of house doors and of each other."""
    front, heading = (plan.lines.left_front, 0.5 * math.pi) if left else (plan.lines.right_front, -0.5 * math.pi)
    places = []
    for house in plan.placements:
        if house.object_class == "building" and house.heading == heading:
            width, _, bays, door = house.size[:4]
            places.append(house.y + math.copysign((door + 0.5) * width / bays, heading))
    x = front + 0.42 if left else front - 0.42
    for y in rng.uniform(6.0, plan.lines.row_stop - 15.0, round(plan.settings.length_m / 22.0)):
        if any(abs(y - other) < 2.0 for other in places) or plan.lines.in_side_street(
            float(y), SIDE_HALF + 1.0, left=left
        ):
            continue
        places.append(float(y))
        if rng.random() < 0.5:
            size = (0.5, 1.1)
            planter = plan.add(
                "vegetation", "planter", x, float(y) - 0.55, z=plan.lines.kerb_height, seed=seed_of(rng), size=size
            )
            plan.block(planter, rectangle(x - 0.25, planter.y, x + 0.25, planter.y + 1.1))
        else:
            bins = plan.add("static", "bins", x, float(y), z=plan.lines.kerb_height, heading=heading, seed=seed_of(rng))
            plan.block(bins, rectangle(x - 0.36, bins.y - 0.65, x + 0.36, bins.y + 0.65))
