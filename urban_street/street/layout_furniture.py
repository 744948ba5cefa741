"""Lay out the street furniture: bus stop, benches, bins, stands, railings, signals."""

from __future__ import annotations

import math

import numpy as np

from urban_street.street.plan import SIDE_HALF, Spot
from urban_street.street.planning import StreetPlan
from urban_street.street.species import species_of

#: Start of the furniture along the street, metres, so that it is not near the cameras.
_FIRST = 6.0


def place_furniture(plan: StreetPlan, rng: np.random.Generator) -> None:
    """Add the furniture to a plan that already has houses, cars, trees, lamps and signs."""
    _place_pits(plan)
    for left in (True, False):
        _place_signals(plan, left=left)
        _place_railings(plan, left=left)
    _place_bus_stop(plan)
    for left in (True, False):
        _place_along_kerb(plan, rng, left=left)
        _place_cabinets(plan, rng, left=left)


def _kerb(plan: StreetPlan, inset: float, *, left: bool) -> float:
    return plan.lines.left_kerb - inset if left else plan.lines.right_kerb + inset


def _towards_houses(*, left: bool) -> float:
    """Return the heading at which an object's front (−y) faces the houses of its side."""
    return -0.5 * math.pi if left else 0.5 * math.pi


def _place_pits(plan: StreetPlan) -> None:
    for tree in [placement for placement in plan.placements if species_of(placement.kind)]:
        if tree.y < plan.lines.road_stop - 3.0:
            plan.add("terrain", "pit", tree.x, tree.y, z=plan.lines.kerb_height)


def _place_signals(plan: StreetPlan, *, left: bool) -> None:
    """Place a mast with a signal over the nearest lane at each crossing but the first, with two lanes or more."""
    if plan.settings.lanes < 2 or left:
        return
    for crossing in plan.lines.crossings[1:]:
        x, y = _kerb(plan, 0.5, left=left), crossing + 2.2
        placement = plan.add_where_free(
            "pole", "mast", Spot(x, y, math.pi), ((-0.12, -0.12), (0.12, 0.12)), margin=0.25
        )
        if placement:
            plan.add("traffic-light", "signal", x - 3.4, y - 0.1, z=plan.lines.kerb_height + 2.15)


def _place_railings(plan: StreetPlan, *, left: bool) -> None:
    """Place guard rails along the kerb beyond each crossing."""
    for crossing in plan.lines.crossings[1:]:
        y = crossing + 4.2
        if plan.lines.in_side_street(y + 2.0, SIDE_HALF + 2.2, left=left):
            y = crossing - 10.0
        plan.add_where_free(
            "fence", "guard-rail", Spot(_kerb(plan, 0.3, left=left), y, 0.0), ((-0.04, 0.0), (0.04, 3.6)), margin=0.15,
            size=(3.6,),
        )  # fmt: skip


def _place_bus_stop(plan: StreetPlan) -> None:
    """Place a bus stop on the right. If the pavement is wide enough, it has a shelter with its back to the houses."""
    width = plan.lines.right_front - plan.lines.right_kerb
    heading = 0.5 * math.pi + math.pi
    for y in np.arange(54.0, plan.lines.row_stop - 20.0, 2.0):
        flag = plan.is_free(_box(_kerb(plan, 0.4, left=False), float(y) - 3.2, 0.1, 0.1), 0.3)
        if not flag or plan.lines.in_side_street(float(y), SIDE_HALF + 6.0, left=False):
            continue
        if width >= 2.7:
            placement = plan.add_where_free(
                "static", "shelter", Spot(_kerb(plan, 0.55, left=False), float(y), heading), ((-2.2, -0.15), (2.2, 1.4)),
                margin=0.25, height=2.6,
            )  # fmt: skip
            if placement is None:
                continue
        x = _kerb(plan, 0.4, left=False)
        post = plan.add("pole", "post", x, float(y) - 3.2, z=plan.lines.kerb_height)
        plan.block(post, _box(x, post.y, 0.05, 0.05))
        plan.add("traffic-sign", "stop-flag", x, post.y, z=plan.lines.kerb_height)
        return


def _box(x: float, y: float, half_x: float, half_y: float) -> tuple[tuple[float, float], ...]:
    return ((x - half_x, y - half_y), (x + half_x, y - half_y), (x + half_x, y + half_y), (x - half_x, y + half_y))


def _place_along_kerb(plan: StreetPlan, rng: np.random.Generator, *, left: bool) -> None:
    """Place benches that face the houses, litter bins, bicycle stands and one advertising column."""
    wide = plan.settings.pavement_width_m
    things = {
        "bench": ((-0.95, -0.25), (0.95, 0.45), 0.62, None),
        "litter-bin": ((-0.24, -0.24), (0.24, 0.24), 0.5, None),
        "stand": ((-1.0, -0.4), (1.0, 0.4), 0.62, None),
        "column": ((-0.72, -0.72), (0.72, 0.72), 1.0, 3.1),
    }
    order = ["bench", "litter-bin", "stand", "litter-bin", "column", "bench", "litter-bin"]
    y, turn = _FIRST + float(rng.uniform(2.0, 9.0)), int(rng.integers(len(order)))
    while y < plan.lines.row_stop - 8.0:
        kind = order[turn % len(order)]
        low, high, inset, height = things[kind]
        if kind == "column" and wide < 2.7:
            turn += 1
            continue
        blocked = plan.lines.in_side_street(y, SIDE_HALF + 1.5, left=left) or any(
            abs(y - c) < 4.6 for c in plan.lines.crossings
        )
        placement = None if blocked else plan.add_where_free(
            "static", kind, Spot(_kerb(plan, inset, left=left), y, _towards_houses(left=left)), (low, high), margin=0.3,
            height=height,
        )  # fmt: skip
        if placement is None:
            y += 0.8
            continue
        turn += 1
        y += float(rng.uniform(5.0, 11.0))


def _place_cabinets(plan: StreetPlan, rng: np.random.Generator, *, left: bool) -> None:
    """Place grey cabinets along the houses, clear of doors and shop windows."""
    x = plan.lines.left_front + 0.24 if left else plan.lines.right_front - 0.24
    heading = 0.5 * math.pi if left else -0.5 * math.pi
    doors = [
        house.y + math.copysign((house.size[3] + 0.5) * house.size[0] / house.size[2], heading)
        for house in plan.placements
        if house.object_class == "building" and house.heading == heading
    ]
    for y in np.sort(rng.uniform(_FIRST, plan.lines.row_stop - 10.0, round(plan.settings.length_m / 30.0))):
        if any(abs(y - door) < 1.6 for door in doors) or plan.lines.in_side_street(y, SIDE_HALF + 1.0, left=left):
            continue
        plan.add_where_free(
            "static", "cabinet", Spot(x, float(y), heading), ((-0.65, -0.2), (0.65, 0.2)), margin=0.02,
            seed=int(rng.integers(2**31)),
        )  # fmt: skip
