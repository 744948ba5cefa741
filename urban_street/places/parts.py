"""Pieces that several places have: outlines, lanes, avenues, signs."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import shapely

from urban_street.site import PlaceSettings
from urban_street.street.plan import KERB_HEIGHT, Spot, StreetSettings, disc
from urban_street.street.planning import StreetPlan
from urban_street.street.shapes import Mark, Polygon
from urban_street.street.species import SPECIES
from urban_street.traffic_places import CAR_KINDS

#: Width of narrow markings, metres.
LINE = 0.12
_WOODS = ("far-oak", "far-maple", "far-birch", "far-spruce", "far-pine")


def begin(settings: PlaceSettings, floor: float = KERB_HEIGHT) -> tuple[StreetPlan, np.random.Generator]:
    """Return an empty plan, with houses ``floor`` metres above the road, and the source of its random choices."""
    plan = StreetPlan(StreetSettings(seed=settings.seed, season=settings.season, kerb_height_m=floor))
    return plan, np.random.default_rng(np.random.SeedSequence([settings.seed, 7010]))


def rounded(x0: float, y0: float, x1: float, y1: float, radius: float) -> Polygon:
    """Return a rectangle with round corners, counter-clockwise."""
    box = shapely.box(x0 + radius, y0 + radius, x1 - radius, y1 - radius)
    return outline_of(box.buffer(radius, quad_segs=8))


def outline_of(shape: shapely.Polygon) -> Polygon:
    """Return the corners of a polygon without holes, counter-clockwise, to tenths of a millimetre."""
    corners = shapely.orient_polygons(shape.simplify(1e-4)).exterior.coords
    return tuple((round(x, 4), round(y, 4)) for x, y in corners[:-1])


def kinds_from(first: str) -> tuple[str, ...]:
    """Return all kinds of cars, ``first`` first."""
    return (first, *(kind for kind in CAR_KINDS if kind != first))


def line(along: tuple[float, float], across: float, width: float = LINE) -> Mark:
    """Return an unbroken marking along a road."""
    return Mark(along, (across - 0.5 * width, across + 0.5 * width))


def around(across: float, width: float = LINE) -> tuple[float, float]:
    """Return the two edges of a marking."""
    return across - 0.5 * width, across + 0.5 * width


def plant(
    plan: StreetPlan, rng: np.random.Generator, kind: str, x: float, y: float, size: float = 1.0, sunk: float = 0.0
) -> None:
    """Add a tree, about ``size`` times as large as its species, and its trunk; ``sunk`` by metres, it is a bush."""
    turn, variant = float(rng.uniform(0.0, 2.0 * math.pi)), int(rng.integers(3))
    tree = plan.add(
        "vegetation", kind, x, y, z=plan.height(x, y) - sunk, heading=turn, variant=variant,
        size=(round(size * float(rng.uniform(0.9, 1.12)), 3),),
    )  # fmt: skip
    footing = 0.9 if sunk else size * SPECIES[kind.removeprefix("far-")].footing
    plan.block(tree, disc(tree.x, tree.y, footing), 2.2 if sunk else None)


def of_woods(rng: np.random.Generator) -> str:
    """Return the kind of a tree in distant woods."""
    return str(rng.choice(_WOODS))


def avenue(
    plan: StreetPlan, rng: np.random.Generator, kinds: tuple[str, ...], x: float, ys: Iterable[float], *, pits: bool = True
) -> None:  # fmt: skip
    """Plant trees at x and about each of ``ys``, coarse ones where they are far."""
    for y in ys:
        here = y + float(rng.uniform(-0.8, 0.8))
        kind = str(rng.choice(kinds))
        plant(plan, rng, kind if 0.0 < here < 42.0 else f"far-{kind}", x, here)
        if pits:
            plan.add("terrain", "pit", x, here, z=plan.height(x, here))


def sign(plan: StreetPlan, face: int, spot: Spot) -> None:
    """Add a sign on its post, with its face towards −y of the spot."""
    post = plan.stand("pole", "post", spot, 0.05)
    x, y = spot.x + 0.045 * math.sin(spot.heading), spot.y - 0.045 * math.cos(spot.heading)
    plan.add("traffic-sign", "face", x, y, z=post.z, heading=spot.heading, variant=face)


def lamps(plan: StreetPlan, x: float, ys: Iterable[float], heading: float) -> None:
    """Add lamp posts; at heading 0 their arms reach to +x."""
    for y in ys:
        plan.stand("pole", "lamp", Spot(x, y, heading), 0.1)
