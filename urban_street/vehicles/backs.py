"""What is behind a car's doors instead of a closed body: a pick-up's bed, an open cabin, a body of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from urban_street.solids.rounded import bar, rod
from urban_street.solids.surfaces import Bag, boxes, extrude, quads, sheet
from urban_street.vehicles.details import facing, number_plate
from urban_street.vehicles.interior import cabin_half
from urban_street.vehicles.shell import Shell

#: Depth of a bed below the belt, metres.
_BED_DEPTH: Final = 0.50


def _bed(bag: Bag, shell: Shell) -> None:
    """Add floor and walls of the bed, seen from inside, and the wheel arches in it."""
    d = shell.design
    y0, y1, half = d.bed
    top = float(np.interp(y0, *np.array(d.belt).T)) + 0.005
    floor = top - _BED_DEPTH
    a, b, c, e = (half, y0), (half, y1), (-half, y1), (-half, y0)
    walls = [[(*p, floor), (*q, floor), (*q, top), (*p, top)] for p, q in ((b, a), (c, b), (e, c), (a, e))]
    bag.add("vehicle-plastic", quads([[(*e, floor), (*a, floor), (*b, floor), (*c, floor)], *walls]))
    ribs = np.arange(y0 + 0.15, y1 - 0.1, 0.16)
    bag.add(
        "vehicle-plastic",
        boxes([[-half, y, floor] for y in ribs], [[half, y + 0.06, floor + 0.015] for y in ribs], skip=("-z",)),
    )
    wheel = 1.02 * d.arch
    for side in (-1.0, 1.0):
        low, high = sorted((side * (half - 0.16), side * half))
        bag.add(
            "vehicle-plastic", boxes([[low, d.rear_axle - wheel, floor]], [[high, d.rear_axle + wheel, floor + 0.24]])
        )
    # a roll bar behind the cab
    y, x, high = y1 - 0.06, half - 0.02, d.rail[1] - 0.10
    for z in (high, high - 0.14):
        bag.add("vehicle-satin", rod([(-x + 0.06, y, z), (x - 0.06, y, z)], 0.022, 10))
    for side in (-1.0, 1.0):
        post = [
            (side * (x + 0.06), y - 0.55, top),
            (side * (x - 0.02), y - 0.10, high - 0.03),
            (side * (x - 0.06), y, high),
        ]
        bag.add("vehicle-satin", rod(post, 0.026, 10))


def _open(bag: Bag, shell: Shell) -> None:
    """Add the insides of the flanks, and the folded hood behind the seats."""
    d = shell.design
    half, floor = cabin_half(d), float(np.interp(0.0, *np.array(d.sill).T)) + 0.09
    rear, front = d.rear_base, d.pillar_base
    top = float(np.interp(rear, *np.array(d.belt).T)) - 0.03
    for side in (-1.0, 1.0):
        low, high = sorted((side * (half - 0.02), side * (half + 0.02)))
        bag.add("vehicle-interior", boxes([[low, rear, floor]], [[high, front, top]]))
    bag.add("vehicle-interior", boxes([[-half, rear - 0.02, floor]], [[half, rear + 0.02, top + 0.02]]))
    angle = np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
    roll = np.stack([rear - 0.02 + 0.15 * np.cos(angle), top + 0.045 + 0.065 * np.sin(angle)], -1)
    bag.add("vehicle-fabric", bar(roll, -half + 0.06, half - 0.06))


def _box(bag: Bag, shell: Shell) -> None:
    """Add a body of its own behind the cab, with lamps, chassis and mudguards."""
    d = shell.design
    y0, y1, width, low, _, over = d.box
    half = 0.5 * width
    if over:
        _living_quarters(bag, shell)
    else:
        _cargo_box(bag, d.box)
    rails = [[x, y0 + 0.1, 0.48] for x in (-0.5, 0.42)]
    bag.add("vehicle-steel", boxes(rails, [[x + 0.08, y1 + 0.5, low] for x, _, _ in rails]))
    bag.add("vehicle-gap", boxes([[-0.46, d.rear_axle - 0.3, 0.30]], [[0.46, d.rear_axle + 0.3, low]]))
    bag.add("vehicle-plastic", boxes([[-half + 0.04, y0 - 0.02, 0.40]], [[half - 0.04, y0 + 0.12, 0.54]]))
    angle = np.radians(np.linspace(0.0, 180.0, 13))
    arch = np.stack([0.0 * angle, np.cos(angle), np.sin(angle)], -1) * (d.tyre + 0.075) + [0.0, d.rear_axle, d.tyre]
    for side in (-1.0, 1.0):
        guard = np.stack([arch + [side * x, 0.0, 0.0] for x in (half - 0.32, half - 0.02)], 1)
        bag.add("vehicle-plastic", sheet(guard), sheet(guard, flip=True))
        x0, x1 = sorted((side * (half - 0.16), side * (half - 0.05)))
        for k, material in enumerate(("vehicle-lamp-red", "vehicle-amber", "vehicle-lamp-clear")):
            z = 0.62 + 0.12 * k
            bag.add(material, boxes([[x0, y0 - 0.03, z]], [[x1, y0 + 0.02, z + 0.11]]))
    bag.merge(number_plate(), facing(np.array([0.0, y0 - 0.035, 0.47]), front=False))


def _cargo_box(bag: Bag, box: Sequence[float]) -> None:
    """Add a smooth box with metal edges, a coloured band, and two rear doors."""
    y0, y1, width, low, high, _ = box
    half = 0.5 * width
    bag.add("vehicle-white", boxes([[-half, y0, low]], [[half, y1, high]]))
    corners = np.array([(x, y, z) for x in (-half, half) for y in (y0, y1) for z in (low, high)])
    pairs = [(p, q) for p, q in combinations(corners, 2) if (p != q).sum() == 1]
    ends = np.array([(np.minimum(p, q), np.maximum(p, q)) for p, q in pairs])
    limits = np.array([[-half - 0.006, y0 - 0.006, low - 0.02], [half + 0.006, y1 + 0.006, high + 0.01]])
    bag.add("vehicle-satin", boxes(np.maximum(ends[:, 0] - 0.03, limits[0]), np.minimum(ends[:, 1] + 0.03, limits[1])))
    _stripe(bag, half + 0.003, (y0 + 0.14, y1 - 0.14), (low + 0.55, low + 1.0))
    bag.add("vehicle-gap", boxes([[-0.006, y0 - 0.003, low + 0.04]], [[0.006, y0 + 0.02, high - 0.04]]))
    bars = [rod([(x, y0 - 0.022, low + 0.04), (x, y0 - 0.022, high - 0.04)], 0.014, 6) for x in (-0.40, 0.40)]
    bag.add("vehicle-satin", *bars)


def _stripe(bag: Bag, x: float, along: tuple[float, float], high: tuple[float, float]) -> None:
    """Add a stripe in the paint's colour to both sides, at ``x`` from the middle."""
    (y0, y1), (z0, z1) = along, high
    right = [(x, y0, z0), (x, y1, z0), (x, y1, z1), (x, y0, z1)]
    bag.add("paint", quads([right, [(-x, y, z) for _, y, z in right[::-1]]]))


def _living_quarters(bag: Bag, shell: Shell) -> None:
    """Add the body of a camper with a bed over the cab, windows, a door, an awning and skirts."""
    d = shell.design
    y0, y1, width, low, high, over = d.box
    half = 0.5 * width
    back = [(y0, low), (y0, high - 0.10), (y0 + 0.10, high), (y1, high), (y1, low), (y0, low)]
    bunk = [(y1, high - 0.74), (y1, high), (over - 0.50, high), (over - 0.18, high - 0.07), (over - 0.02, high - 0.30),
            (over, high - 0.52), (over - 0.16, high - 0.66), (y1, high - 0.74)]  # fmt: skip
    bag.add("vehicle-white", extrude(back, -half, half), extrude(bunk, -half + 0.02, half - 0.02))
    gap = d.tyre + 0.12
    for side in (-1.0, 1.0):
        x0, x1 = sorted((side * half, side * (half - 0.04)))
        spans = ((y0, d.rear_axle - gap), (d.rear_axle + gap, y1))
        bag.add("vehicle-satin", boxes([[x0, a, 0.40] for a, _ in spans], [[x1, b, low] for _, b in spans]))
        panes = ((y0 + 0.35, y0 + 1.15), (y0 + 1.75, y0 + 2.35))
        out = side * (half + 0.016)
        x0, x1 = sorted((out, side * (half - 0.02)))
        bag.add(
            "vehicle-black-gloss",
            boxes([[x0, a, low + 0.68] for a, _ in panes], [[x1, b, low + 1.22] for _, b in panes]),
        )
    _stripe(bag, half + 0.004, (y0 + 0.12, y1 - 0.05), (low + 0.16, low + 0.34))
    door = np.array([[y1 - 0.88, low - 0.30], [y1 - 0.26, high - 0.34]])
    frame = [(half + 0.006, *door[0]), (half + 0.006, door[1, 0], door[0, 1]), (half + 0.006, *door[1]),
             (half + 0.006, door[0, 0], door[1, 1]), (half + 0.006, *door[0])]  # fmt: skip
    bag.add("vehicle-plastic", rod(frame, 0.012, 5))
    bag.add("vehicle-black-gloss", boxes([[half, y1 - 0.74, low + 0.72]], [[half + 0.014, y1 - 0.40, low + 1.20]]))
    bag.add(
        "vehicle-satin",
        rod([(half - 0.035, y0 + 0.2, high - 0.10), (half - 0.035, y1 - 0.2, high - 0.10)], 0.055, 10, caps=True),
    )
    bag.add("vehicle-black-gloss", boxes([[-0.55, y0 - 0.014, low + 0.72]], [[0.55, y0 + 0.02, low + 1.24]]))
    ladder = [
        rod([(x, y0 - 0.07, low + 0.1), (x, y0 - 0.07, high - 0.05), (x, y0 + 0.15, high + 0.03)], 0.014, 6)
        for x in (-0.92, -0.62)
    ]
    rungs = [
        rod([(-0.92, y0 - 0.07, z), (-0.62, y0 - 0.07, z)], 0.012, 5) for z in np.arange(low + 0.25, high - 0.2, 0.28)
    ]
    bag.add("vehicle-satin", *ladder, *rungs)


#: Adds what is behind the doors, by `CarDesign.back`.
BACKS: Final[dict[str, Callable[[Bag, Shell], None]]] = {"bed": _bed, "open": _open, "box": _box}
