"""Trucks with a tilt cab over the engine, a box or a flat bed, and twin rear wheels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import shapely

from urban_street.solids.rounded import bar, pillow, rod, rounded_outline, torus, turned
from urban_street.solids.surfaces import Bag, boxes, sheet
from urban_street.vehicles.cars import wheels
from urban_street.vehicles.content import RawPart
from urban_street.vehicles.details import convex_mirror, facing, number_plate
from urban_street.vehicles.hull import Hull, both_sides
from urban_street.vehicles.interior import add_seat
from urban_street.vehicles.skin import cut, mirrored_bag, reversed_
from urban_street.vehicles.truck_cab import equip_cab
from urban_street.vehicles.wheels import WheelSize

LENGTH: Final = 7.40
WIDTH: Final = 2.46
HEIGHT: Final = 3.42
#: Height without a box: that of the headboard behind the cab.
FLAT_HEIGHT: Final = 2.43
_CAB: Final = (1.98, 3.70)
_BOX: Final = (-3.62, 1.86)
_AXLES: Final = (2.52, -1.68)
_TYRE: Final = 0.405


def build_truck() -> list[RawPart]:
    """Build the truck of the first street, whose bits are kept; `build_box_truck` has what its cab lacks.

    Its parts are body (cab, box, chassis), two doors (1 left, 2 right) and wheels.
    """
    body = Bag()
    return _with_chassis(body, _cab(body, _cab_inside), _box)


def build_box_truck() -> list[RawPart]:
    """Build a truck with a box; parts as in `build_truck`."""
    body = Bag()
    return _with_chassis(body, _cab(body, equip_cab, convex=True), _box)


def build_flatbed_truck() -> list[RawPart]:
    """Build a truck with a flat bed and low boards; parts as in `build_truck`."""
    body = Bag()
    return _with_chassis(body, _cab(body, equip_cab, convex=True, deflector=False), _flat_bed)


def _with_chassis(body: Bag, doors: Bag, load: Callable[[Bag], None]) -> list[RawPart]:
    """Add what is behind the cab, and return the parts."""
    load(body)
    _chassis(body)
    parts = [RawPart("body", body)]
    for k, side in enumerate((-1, 1)):
        parts.append(
            RawPart(f"door-{k + 1}", doors if side > 0 else mirrored_bag(doors), (side * 1.02, 3.22, 0.0), "rot.z")
        )
    return parts + wheels(WheelSize(_TYRE, 0.235, 0.245), "steel", 0.5 * WIDTH - 0.19, _AXLES, twin=True)


def _cab(body: Bag, inside: Callable[[Bag], None], *, convex: bool = False, deflector: bool = True) -> Bag:
    """Add the cab, with its mirrors ``convex`` or flat, and return the right door."""
    width = 2.12
    hull = Hull(
        _CAB, width, (0.42, 2.36), corners=(0.10, 0.24),
        inset=((0.42, 0.03), (0.52, 0.0), (1.35, 0.0), (2.05, 0.055), (2.24, 0.10), (2.36, 0.24)),
        rake=((0.42, 0.06), (0.55, 0.0), (1.0, 0.03), (1.35, 0.07), (2.36, 0.44)), columns=0.35, rows=0.22,
    )  # fmt: skip
    arch = hull.arch(_AXLES[0], _TYRE, 0.50)
    body.merge(both_sides(hull.liner(_AXLES[0], _TYRE, 0.50, 0.36)))
    windscreen = hull.front(0.0, 1.03, 1.30, 2.06, 0.10)
    lamp = hull.front(0.50, 0.98, 0.66, 0.86, 0.05)
    grille = hull.front(0.0, 0.82, 0.94, 1.18, 0.04)
    bumper = hull.front(0.0, 1.75, 0.42, 0.92)
    door = shapely.union_all([hull.side(2.36, 3.26, 1.02, 2.20, 0.03), hull.side(2.95, 3.26, 0.72, 1.2)]).difference(
        arch.buffer(0.03)
    )
    pane = hull.side(2.46, 3.17, 1.36, 2.06, 0.06)
    skin = hull.master.domain.difference(shapely.union_all([arch, windscreen, lamp, grille, door, bumper]))
    half = hull.panel("paint", skin, gap=0.003, depth=0.015)
    half.merge(hull.panel("vehicle-plastic", bumper.difference(shapely.union_all([arch, lamp])), depth=0.03))
    seal = windscreen.buffer(0.03).difference(windscreen)
    half.merge(hull.panel("vehicle-black-gloss", seal, depth=0.0, offset=0.002))
    half.merge(hull.panel("vehicle-glass", windscreen, depth=0.0, offset=-0.004))
    half.merge(hull.panel("vehicle-lens", lamp, depth=0.0))
    half.merge(hull.panel("vehicle-lamp-housing", lamp, depth=0.0, offset=-0.05))
    half.merge(hull.panel("vehicle-gap", grille, depth=0.0, offset=-0.03))
    for z in (0.97, 1.03, 1.09, 1.145):
        half.merge(hull.panel("vehicle-plastic", grille.intersection(shapely.box(-9, z, 99, z + 0.028)), depth=0.02))
    for x in (0.63, 0.82):
        centre = hull.master.points(np.array([[hull.length - x, 0.76]]))[0] - np.array([0.0, 0.045, 0.0])
        half.add(
            "vehicle-lamp-white",
            pillow((0.07, 0.02, 0.07), squareness=1.0, sides=16, levels=5).moved(turned(0, 0.0, centre)),
        )
    blinker = hull.front(1.02, 1.16, 0.97, 1.10, 0.02)
    half.merge(hull.panel("vehicle-amber", blinker, depth=0.0, offset=0.004))
    hollow = hull.master.domain.difference(shapely.union_all([windscreen, pane, arch]))
    half.add("vehicle-trim", reversed_(cut(hull.master.coarse(2), hollow.simplify(0.02), offset=-0.05).surface))
    half.merge(_mirrors(hull, convex=convex))
    body.merge(both_sides(half))
    body.merge(hull.lid("paint", 0.06))
    if deflector:
        outline = np.array([(2.05, 2.34), (2.86, 2.37), (2.62, 2.62), (2.28, 2.92), (2.12, 2.98), (2.05, 2.96)])
        body.add("paint", bar(outline, -0.86, 0.86))
    for x in (-0.62, 0.12):
        y = float(hull.master.points(np.array([[hull.length - abs(x), 1.28]]))[0, 1]) + 0.012
        body.add(
            "vehicle-plastic", rod([(x, y, 1.24), (x + 0.46, y - 0.01, 1.33), (x + 0.50, y - 0.03, 1.36)], 0.010, 5)
        )
    nose = float(hull.master.points(np.array([[hull.length, 0.55]]))[0, 1])
    body.merge(number_plate(), facing(np.array([0.0, nose + 0.012, 0.55]), front=True))
    inside(body)
    doors = hull.panel("paint", door.difference(pane), gap=0.004, depth=0.05)
    doors.add("vehicle-interior", reversed_(cut(hull.master, door.difference(pane), offset=-0.05).surface))
    doors.merge(hull.panel("vehicle-glass", pane, depth=0.0, offset=-0.004))
    doors.merge(hull.panel("vehicle-black-gloss", pane.buffer(0.02).difference(pane), depth=0.0, offset=0.002))
    x = float(hull.master.points(np.array([[hull.flank_a(2.5), 1.20]]))[0, 0])
    doors.add(
        "vehicle-plastic",
        pillow((0.02, 0.09, 0.022), squareness=0.5, sides=10, levels=5).moved(turned(0, 0.0, (x + 0.012, 2.50, 1.22))),
    )
    for z in (0.52, 0.74):
        body.merge(both_sides(_step(z)))
    return doors


def _step(z: float) -> Bag:
    bag = Bag()
    bag.add("vehicle-plastic", boxes([[0.82, 3.06, z - 0.05]], [[1.05, 3.42, z - 0.02]]))
    return bag


def _mirrors(hull: Hull, *, convex: bool) -> Bag:
    bag = Bag()
    for z, high in ((1.86, 0.20), (1.50, 0.11)):
        head = np.array([1.26, 3.40, z])
        bag.add(
            "vehicle-plastic",
            pillow((0.10, 0.05, high), squareness=0.4, sides=14, levels=7).moved(turned(0, 0.0, head)),
        )
        if convex:
            bag.add(
                "vehicle-mirror",
                convex_mirror((0.084, 0.006, high - 0.022)).moved(turned(2, 6.0, head - [0.0, 0.049, 0.0])),
            )
        else:
            bag.add("vehicle-mirror", boxes([head - [0.08, 0.054, high - 0.03]], [head + [0.08, -0.050, high - 0.03]]))
    foot = hull.half - 0.03
    bag.add(
        "vehicle-plastic",
        rod([(foot, 3.24, 2.05), (1.24, 3.40, 2.09), (1.26, 3.40, 1.95)], 0.016, 6),
        rod([(foot, 3.26, 1.34), (1.24, 3.40, 1.36), (1.26, 3.40, 1.5)], 0.016, 6),
    )
    return bag


def _cab_inside(body: Bag) -> None:
    half = 0.98
    body.add("vehicle-interior", boxes([[-half, 2.1, 0.98]], [[half, 3.5, 1.02]]))
    body.add("vehicle-interior", bar(rounded_outline(0.20, 0.16, 0.12, steps=4) + [3.30, 1.24], -half, half))
    body.add("vehicle-trim", boxes([[-half, 2.06, 1.0]], [[half, 2.10, 2.25]]))
    for x in (-0.55, 0.52):
        add_seat(body, x, 2.66, 1.02)
    body.add("vehicle-interior", torus(0.22, 0.016, 20, 6).moved(turned(0, 40.0, (-0.55, 3.06, 1.46))))


def _box(body: Bag) -> None:
    """Add a box with aluminium edges, side guards and two rear doors with locking bars."""
    y0, y1 = _BOX
    half, low, high = 0.5 * WIDTH, 1.02, HEIGHT - 0.02
    t = 0.012
    body.add("vehicle-box", boxes([[-half + t, y0 + t, low]], [[half - t, y1 - t, high]]))
    edges_low, edges_high = [], []
    for z in (low, high - 0.09):
        edges_low += [[-half, y0, z], [half - 0.06, y0, z], [-half, y0, z], [-half, y1 - 0.06, z]]
        edges_high += [
            [-half + 0.06, y1, z + 0.09],
            [half, y1, z + 0.09],
            [half, y0 + 0.06, z + 0.09],
            [half, y1, z + 0.09],
        ]
    for y in (y0, y1 - 0.09):
        for x in (-half, half - 0.09):
            edges_low.append([x, y, low])
            edges_high.append([x + 0.09, y + 0.09, high])
    body.add("vehicle-satin", boxes(edges_low, edges_high))
    body.add("vehicle-gap", boxes([[-0.006, y0 + 0.004, low + 0.09]], [[0.006, y0 + 0.03, high - 0.09]]))
    bars = [
        rod([(x, y0 - 0.02, low + 0.02), (x, y0 - 0.02, high - 0.02)], 0.016, 6) for x in (-0.85, -0.25, 0.25, 0.85)
    ]
    body.add("vehicle-satin", *bars)
    clamps = [
        (x - 0.04, y0 - 0.03, z) for x in (-0.85, -0.25, 0.25, 0.85) for z in (low + 0.06, low + 0.72, high - 0.16)
    ]
    body.add("vehicle-satin", boxes(clamps, np.array(clamps) + [0.08, 0.04, 0.07]))
    hinges = [(x, y0 - 0.012, z) for x in (-half + 0.005, half - 0.075) for z in np.linspace(low + 0.2, high - 0.3, 4)]
    body.add("vehicle-satin", boxes(hinges, np.array(hinges) + [0.07, 0.02, 0.10]))
    # ribs along the sides, and a coloured band
    ribs = [[x, y, low + 0.09] for y in np.arange(y0 + 0.6, y1 - 0.3, 0.61) for x in (-half - 0.001, half - 0.011)]
    body.add("vehicle-box", boxes(ribs, np.array(ribs) + [0.012, 0.035, high - low - 0.18]))
    body.add(
        "paint",
        boxes(
            [[-half + 0.006, y0 + 0.12, low + 0.62], [half - 0.013, y0 + 0.12, low + 0.62]],
            [[-half + 0.013, y1 - 0.12, low + 1.02], [half - 0.006, y1 - 0.12, low + 1.02]],
        ),
    )
    markers = [(x, y, low - 0.055) for y in np.linspace(y0 + 0.6, y1 - 0.5, 4) for x in (-half + 0.0, half - 0.02)]
    body.add("vehicle-amber", boxes(markers, np.array(markers) + [0.02, 0.11, 0.04]))


def _flat_bed(body: Bag) -> None:
    """Add a platform with drop sides, a headboard, and a load of pallets under a sheet."""
    y0, y1 = _BOX
    half, floor = 0.5 * WIDTH - 0.01, 1.14
    body.add("vehicle-satin", boxes([[-half, y0, 1.02]], [[half, y1, floor]]))
    sides = [((x, y0), (x + 0.03, y1)) for x in (-half, half - 0.03)] + [
        ((-half, y), (half, y + 0.03)) for y in (y0, y1 - 0.03)
    ]
    body.add("vehicle-satin", boxes([[*low, floor] for low, _ in sides], [[*high, floor + 0.40] for _, high in sides]))
    ribs = np.arange(y0 + 0.02, y1, 0.9)
    posts = [[x, y, floor - 0.04] for y in ribs for x in (-half - 0.012, half - 0.02)]
    body.add("vehicle-steel", boxes(posts, np.array(posts) + [0.032, 0.07, 0.46]))
    body.add("paint", boxes([[-half, y1 - 0.05, floor]], [[half, y1, 2.30]]))
    body.add(
        "vehicle-steel",
        *(rod([(x, y1 - 0.08, floor), (x, y1 - 0.08, 2.40)], 0.03, 8, caps=True) for x in (-1.0, 0.0, 1.0)),
    )
    body.add("vehicle-steel", rod([(-1.0, y1 - 0.08, 2.40), (1.0, y1 - 0.08, 2.40)], 0.03, 8, caps=True))
    heights = (1.05, 0.72, 0.90)
    for k, high in enumerate(heights):
        y = y1 - 0.75 - 1.35 * k
        body.add("vehicle-wood", boxes([[-1.0, y - 0.6, floor]], [[1.0, y + 0.6, floor + 0.14]]))
        sheet_over = pillow((0.98, 0.58, 0.5 * high), squareness=0.16, sides=24, levels=9)
        body.add("vehicle-sheet", sheet_over.moved(turned(0, 0.0, (0.0, y, floor + 0.14 + 0.5 * high))))
        straps = [
            bar(
                rounded_outline(0.03, 0.5 * high + 0.006, 0.002, steps=1) + [y + a, floor + 0.14 + 0.5 * high],
                -0.99,
                0.99,
            )
            for a in (-0.28, 0.28)
        ]
        body.add("vehicle-amber", *straps)


def _chassis(body: Bag) -> None:
    y0 = _BOX[0]
    for x in (-0.46, 0.38):
        body.add("vehicle-steel", boxes([[x, y0 + 0.1, 0.66]], [[x + 0.08, 3.3, 0.90]]))
    cross = [[-1.18, y, 0.90] for y in np.arange(y0 + 0.3, 1.7, 0.8)]
    body.add("vehicle-steel", boxes(cross, np.array(cross) + [2.36, 0.07, 0.12]))
    body.add(
        "vehicle-steel",
        rod([(-0.95, _AXLES[1], _TYRE), (0.95, _AXLES[1], _TYRE)], 0.09, 10, caps=True),
        pillow((0.20, 0.22, 0.20), squareness=0.8, sides=14, levels=7).moved(turned(0, 0.0, (0.0, _AXLES[1], _TYRE))),
    )
    body.add("vehicle-gap", boxes([[-0.7, 2.2, 0.40]], [[0.7, 3.3, 1.0]]))
    body.add(
        "vehicle-steel",
        bar(rounded_outline(0.42, 0.24, 0.10) + [0.55, 0.66], 0.62, 1.14),
        bar(rounded_outline(0.30, 0.20, 0.05) + [0.95, 0.68], -1.14, -0.62),
    )
    # Side guards, mudguards, under-run bar.
    for side in (-1.0, 1.0):
        rails = [
            rod([(side * 1.17, -1.0, z), (side * 1.17, 1.5 if side < 0 else 0.05, z)], 0.03, 6, caps=True)
            for z in (0.52, 0.78)
        ]
        posts = [rod([(side * 1.15, y, 0.5), (side * 1.12, y, 1.0)], 0.02, 5) for y in (-0.85, -0.1)]
        body.add("vehicle-satin", *rails, *posts)
        angle = np.radians(np.linspace(10.0, 170.0, 11))
        guard = np.stack([np.full(11, 0.0), _AXLES[1] + 0.50 * np.cos(angle), _TYRE + 0.02 + 0.50 * np.sin(angle)], -1)
        inner, outer = guard + [side * 0.72, 0, 0], guard + [side * 1.21, 0, 0]
        strip = np.stack([inner, outer] if side > 0 else [outer, inner], 1)
        body.add("vehicle-plastic", sheet(strip, flip=True), sheet(strip))
        lamp = np.array([side * 0.98, y0 + 0.02, 0.86])
        body.add("vehicle-plastic", boxes([lamp - [0.19, 0.03, 0.075]], [lamp + [0.19, 0.05, 0.075]]))
        for k, material in enumerate(("vehicle-amber", "vehicle-lamp-red", "vehicle-lamp-clear")):
            x = lamp[0] + side * (0.12 - 0.12 * k)
            body.add(
                material,
                boxes([[x - 0.055, lamp[1] - 0.037, lamp[2] - 0.055]], [[x + 0.055, lamp[1] - 0.028, lamp[2] + 0.055]]),
            )
    body.add(
        "vehicle-satin",
        bar(rounded_outline(0.035, 0.055, 0.02) + [y0 + 0.06, 0.52], -1.12, 1.12),
        boxes([[-0.5, y0 + 0.05, 0.5], [0.42, y0 + 0.05, 0.5]], [[-0.42, y0 + 0.12, 0.9], [0.5, y0 + 0.12, 0.9]]),
    )
    body.merge(number_plate(), facing(np.array([0.0, y0 + 0.0, 0.72]), front=False))
