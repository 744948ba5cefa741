"""A low-floor city bus with three doors on the right, large panes and a destination display."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
import shapely

from urban_street.solids.rounded import pillow, rod, torus, turned
from urban_street.solids.surfaces import Bag, Surface, boxes, merge
from urban_street.vehicles.cars import wheels
from urban_street.vehicles.content import RawPart
from urban_street.vehicles.details import facing, number_plate
from urban_street.vehicles.hull import Hull, both_sides
from urban_street.vehicles.interior import add_seat
from urban_street.vehicles.skin import cut, mirrored_bag, reversed_
from urban_street.vehicles.wheels import WheelSize

LENGTH: Final = 11.95
WIDTH: Final = 2.55
HEIGHT: Final = 3.12
_AXLES: Final = (3.28, -2.60)
_TYRE: Final = 0.478
#: y of both edges of each door, front to rear, metres.
_DOORS: Final = ((4.30, 5.52), (-0.62, 0.66), (-5.02, -3.78))


def build_bus() -> list[RawPart]:
    """Build body, doors (``door-1`` … from front to rear, all on the right) and wheels."""
    hull = Hull(
        (-0.5 * LENGTH, 0.5 * LENGTH), WIDTH, (0.30, 2.93), corners=(0.30, 0.40),
        inset=((0.30, 0.05), (0.40, 0.012), (0.95, 0.0), (2.45, 0.06), (2.72, 0.10), (2.86, 0.17), (2.93, 0.27)),
        rake=((0.3, 0.05), (0.5, 0.0), (1.0, 0.02), (2.0, 0.14), (2.93, 0.34)),
    )  # fmt: skip
    body = Bag()
    arches = shapely.union_all([hull.arch(y, _TYRE, 0.60) for y in _AXLES])
    for y in _AXLES:
        body.merge(both_sides(hull.liner(y, _TYRE, 0.60, 0.42)))
    doors = [hull.side(y0, y1, 0.36, 2.52, 0.04) for y0, y1 in _DOORS]
    windscreen = hull.front(0.0, 1.42, 1.02, 2.42, 0.12)
    display = hull.front(0.0, 0.86, 2.50, 2.76, 0.03)
    rear_window = hull.back(0.0, 0.98, 1.72, 2.50, 0.10)
    glass_low, glass_high = 1.08, 2.36
    stops = (-5.62, -4.42, -3.24, -2.02, -0.80, 0.44, 1.68, 2.92, 4.16, 5.10)
    left_panes = [hull.side(y0 + 0.03, y1 - 0.03, glass_low, glass_high, 0.06) for y0, y1 in pairwise(stops)]
    band = hull.side(stops[0] - 0.06, stops[-1] + 0.08, glass_low - 0.05, glass_high + 0.05, 0.05)
    blocked = shapely.union_all([door.buffer(0.06) for door in doors])
    right_panes = [pane for pane in left_panes if not pane.intersects(blocked)]
    right_panes += [
        rest
        for pane in left_panes
        if pane.intersects(blocked)
        and (rest := _largest(pane.difference(blocked).buffer(-0.03).buffer(0.03))).area > 0.35
    ]
    lamps, tail = hull.front(0.62, 1.24, 0.66, 0.86, 0.07), hull.back(1.06, 1.22, 0.72, 1.28, 0.05)
    grille = hull.back(0.0, 0.86, 0.62, 1.42, 0.05)
    fixed = [windscreen, display, rear_window, lamps, tail, grille, arches]
    for side, panes, gaps in ((1, right_panes, doors), (-1, left_panes, [])):
        half = Bag()
        holes = shapely.union_all([*fixed, *panes, *gaps])
        skin = hull.master.domain.difference(holes)
        dark = shapely.union_all(
            [
                band.difference(shapely.union_all(gaps)) if gaps else band,
                hull.front(0.0, 1.62, 0.98, 2.80, 0.10),
                hull.back(0.0, 1.06, 1.64, 2.58, 0.10),
            ]
        )
        skirt = shapely.box(-1.0, 0.0, 99.0, 0.37)
        lines = _flaps(hull, arches, gaps)
        half.merge(hull.panel("paint", skin.difference(dark).difference(skirt).difference(lines), depth=0.0))
        half.merge(hull.panel("vehicle-black-gloss", skin.intersection(dark), depth=0.0))
        half.merge(hull.panel("vehicle-plastic", skin.intersection(skirt), depth=0.0))
        half.merge(hull.panel("vehicle-gap", lines.intersection(skin), depth=0.0, offset=-0.004))
        for pane in (*panes, windscreen, rear_window):
            half.merge(hull.panel("vehicle-glass", pane, depth=0.0, offset=-0.004))
        half.merge(hull.panel("vehicle-gap", display, depth=0.0, offset=-0.03))
        half.merge(_rear_grille(hull, grille))
        half.merge(_lamps(hull, lamps, tail))
        inner = hull.master.domain.difference(shapely.union_all([*panes, windscreen, rear_window, *gaps, arches]))
        half.add("vehicle-trim", reversed_(cut(hull.master.coarse(2), inner.simplify(0.03), offset=-0.05).surface))
        body.merge(half if side > 0 else mirrored_bag(half))
    body.merge(hull.lid("paint", 0.07))
    _roof_units(body)
    _display(body, hull)
    _cabin(body)
    _front_details(body, hull)
    parts = [RawPart("body", body)]
    for k, (y0, y1) in enumerate(_DOORS):
        parts.append(RawPart(f"door-{k + 1}", _door(hull, y0, y1), (0.5 * WIDTH, y1, 0.0), "rot.z"))
    return parts + wheels(WheelSize(_TYRE, 0.29, 0.29), "steel", 0.5 * WIDTH - 0.20, _AXLES)


def _largest(shape: shapely.Geometry) -> shapely.Geometry:
    parts = shapely.get_parts(shape)
    return max(parts, key=lambda part: part.area) if len(parts) else shape


def _flaps(hull: Hull, arches: shapely.Geometry, gaps: list[shapely.Geometry]) -> shapely.Geometry:
    """Return the seams of the lower panels."""
    lines = [hull.side(y - 0.004, y + 0.004, 0.37, 1.0) for y in (-5.2, -4.1, -3.3, -1.8, -0.7, 0.4, 1.5, 2.5, 4.1)]
    lines.append(hull.side(-5.6, 5.3, 0.985, 0.993))
    shape = shapely.union_all(lines).difference(arches)
    return shape.difference(shapely.union_all([gap.buffer(0.02) for gap in gaps])) if gaps else shape


def _rear_grille(hull: Hull, region: shapely.Geometry) -> Bag:
    bag = hull.panel("vehicle-gap", region, depth=0.0, offset=-0.03)
    _, z0, _, z1 = region.bounds
    for z in np.arange(z0 + 0.05, z1 - 0.02, 0.09):
        bag.merge(
            hull.panel(
                "vehicle-plastic", region.intersection(shapely.box(-1, z, 99, z + 0.045)), depth=0.0, offset=-0.008
            )
        )
    return bag


def _lamps(hull: Hull, head: shapely.Geometry, tail: shapely.Geometry) -> Bag:
    bag = hull.panel("vehicle-lens", head, depth=0.0)
    bag.merge(hull.panel("vehicle-lamp-housing", head, depth=0.0, offset=-0.06))
    a0, z0, a1, z1 = head.bounds
    for share in (0.25, 0.62):
        a = a0 + share * (a1 - a0)
        centre = hull.master.points(np.array([[a, 0.5 * (z0 + z1)]]))[0] - np.array([0.0, 0.05, 0.0])
        bag.add(
            "vehicle-lamp-white",
            pillow((0.07, 0.02, 0.07), squareness=1.0, sides=16, levels=5).moved(turned(0, 0.0, centre)),
        )
    third = (tail.bounds[3] - tail.bounds[1]) / 3.0
    for k, material in enumerate(("vehicle-lamp-dark-red", "vehicle-amber", "vehicle-lamp-red")):
        box = shapely.box(-1, tail.bounds[1] + k * third, 99, tail.bounds[1] + (k + 1) * third - 0.01)
        bag.merge(hull.panel(material, tail.intersection(box), depth=0.0))
    bag.merge(hull.panel("vehicle-gap", tail, depth=0.0, offset=-0.01))
    return bag


def _door(hull: Hull, y0: float, y1: float) -> Bag:
    """Build a door of two glazed leaves."""
    bag = Bag()
    middle = 0.5 * (y0 + y1)
    for low, high in ((y0, middle), (middle, y1)):
        leaf = hull.side(low + 0.008, high - 0.008, 0.37, 2.51, 0.02)
        pane = hull.side(low + 0.07, high - 0.07, 0.55, 2.42, 0.05)
        frame = leaf.difference(pane)
        bag.merge(hull.panel("vehicle-black-gloss", frame, offset=-0.012, depth=0.03))
        bag.add("vehicle-interior", reversed_(cut(hull.master, frame, offset=-0.042).surface))
        bag.merge(hull.panel("vehicle-glass", pane, offset=-0.016, depth=0.0))
    return bag


def _roof_units(bag: Bag) -> None:
    top = 2.98
    for y, long, wide, high in ((2.4, 2.6, 1.5, 0.14), (-3.4, 3.2, 1.7, 0.16)):
        bag.add(
            "paint",
            pillow((0.5 * wide, 0.5 * long, high), squareness=0.25, sides=20, levels=5).moved(
                turned(0, 0.0, (0.0, y, top))
            ),
        )


def _display(bag: Bag, hull: Hull) -> None:
    """Add the line's number and a word in amber dots behind the upper windscreen."""
    rng = np.random.default_rng(5)
    low, high = [], []
    for row in range(9):
        for column in range(44):
            bright = rng.random() < 0.62 if column % 6 != 5 and not 10 <= column <= 13 else False
            if bright:
                x, z = 0.72 - 0.033 * column, 2.535 + 0.022 * row
                low.append((x - 0.011, 0.0, z))
                high.append((x + 0.011, 0.004, z + 0.016))
    y = float(hull.master.points(np.array([[hull.length, 2.62]]))[0, 1])
    dots = boxes(low, high, skip=("-y", "-x", "+x", "-z", "+z"))
    points = dots.positions.copy()
    points[:, 1] += y - 0.025 - 0.2 * (points[:, 2] - 2.62)
    bag.add("vehicle-display", Surface(points, dots.normals, dots.uvs, dots.faces))


def _cabin(bag: Bag) -> None:
    half = 0.5 * WIDTH - 0.10
    bag.add("vehicle-interior", boxes([[-half, -5.7, 0.34]], [[half, 5.6, 0.38]]))
    for y in _AXLES:
        low = [[-half, y - 0.62, 0.38], [half - 0.5, y - 0.62, 0.38]]
        bag.add("vehicle-interior", boxes(low, np.array(low) + [0.5, 1.24, 0.72]))
    bag.add("vehicle-interior", boxes([[-half, -5.75, 0.38]], [[half, -4.95, 1.45]]))
    seats = []
    for y in (-4.4, -3.55, -1.75, -0.95, 1.0, 1.85, 2.55):
        for x in (-0.98, -0.52, 0.98):
            if x > 0 and any(y0 - 0.5 < y < y1 + 0.5 for y0, y1 in _DOORS):
                continue
            z = 0.86 if abs(y - _AXLES[1]) < 1.1 or y < -3.2 else 0.62
            seats.append(pillow((0.21, 0.045, 0.34), sides=8, levels=5).moved(turned(0, 10.0, (x, y - 0.2, z + 0.42))))
            seats.append(pillow((0.21, 0.21, 0.05), sides=8, levels=5).moved(turned(0, 4.0, (x, y, z + 0.10))))
    bag.add("vehicle-seat", merge(seats))
    poles = [
        rod([(x, y, 0.4), (x, y, 2.5)], 0.017, 6)
        for x, y in ((-0.30, 3.6), (-0.30, 1.4), (0.35, 0.9), (0.35, -0.9), (-0.3, -1.4), (0.35, -3.6), (0.35, 4.1))
    ]
    rails = [rod([(x, -4.6, 2.35), (x, 4.0, 2.35)], 0.016, 6) for x in (-0.42, 0.42)]
    bag.add("vehicle-handrail", *poles, *rails)
    # the driver's seat on the left
    add_seat(bag, -0.72, 4.55, 0.62)
    bag.add(
        "vehicle-interior",
        boxes(
            [[-half, 5.05, 0.40], [-half, 3.95, 0.40], [-0.26, 4.0, 0.40]],
            [[0.40, 5.55, 1.06], [-0.26, 3.99, 1.60], [-0.22, 5.0, 1.15]],
        ),
    )
    bag.add("vehicle-interior", torus(0.23, 0.016, 20, 6).moved(turned(0, 35.0, (-0.72, 4.98, 1.22))))


def _front_details(bag: Bag, hull: Hull) -> None:
    nose = float(hull.master.points(np.array([[hull.length, 0.52]]))[0, 1])
    tail = float(hull.master.points(np.array([[0.0, 0.55]]))[0, 1])
    bag.merge(number_plate(), facing(np.array([0.0, nose + 0.012, 0.52]), front=True))
    bag.merge(number_plate(), facing(np.array([0.0, tail - 0.012, 0.50]), front=False))
    for side in (-1.0, 1.0):
        top = np.array([side * 1.10, nose - 0.30, 2.62])
        head = np.array([side * 1.46, nose + 0.06, 2.05])
        bag.add(
            "vehicle-plastic",
            rod([top, top + [side * 0.20, 0.26, 0.05], head + [0.0, 0.02, 0.42], head + [0.0, 0.0, 0.2]], 0.022, 7),
        )
        bag.add(
            "vehicle-plastic",
            pillow((0.11, 0.055, 0.23), squareness=0.4, sides=14, levels=7).moved(turned(0, 0.0, head)),
        )
        bag.add("vehicle-mirror", boxes([head - [0.085, 0.059, 0.195]], [head + [0.085, -0.056, 0.195]]))
    for x in (-0.75, 0.25):
        y = nose - 0.015
        bag.add(
            "vehicle-plastic", rod([(x, y, 0.98), (x + 0.30, y - 0.03, 1.14), (x + 0.46, y - 0.13, 1.95)], 0.012, 5)
        )
    bag.add(
        "vehicle-gap",
        boxes([[-1.1, -5.7, 0.26]], [[1.1, 5.6, 0.33]]),
        boxes([[-0.75, y - 0.65, 0.2] for y in _AXLES], [[0.75, y + 0.65, 0.95] for y in _AXLES]),
    )
