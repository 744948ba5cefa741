"""A road motorcycle without fairing, of tubes, surfaces of revolution and rounded solids."""

from __future__ import annotations

from typing import Final

import numpy as np

from urban_street.human.riding import Contact
from urban_street.solids.rounded import pillow, renormalled, rod, turned
from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, lathe, sheet
from urban_street.vehicles.content import RawPart
from urban_street.vehicles.cycle_parts import AXLE, Wheel, arc
from urban_street.vehicles.details import number_plate

#: Places of contact with a rider.
MOTORCYCLE: Final = Contact(
    (0.0, -0.22, 0.80), (0.335, 0.30, 1.03), ((0.24, -0.12, 0.335), (-0.24, -0.12, 0.335)), 12.0
)


def build_motorcycle() -> list[RawPart]:
    """Build frame, with engine and tank, and two wheels of a road motorcycle; about 9,000 triangles."""
    bag = Bag()
    rear, front = np.array([0.0, -0.70, 0.315]), np.array([0.0, 0.73, 0.310])
    _engine(bag)
    _tank_and_seat(bag)
    _fork(bag, front)
    # Frame, swinging arm, springs.
    for x in (-0.11, 0.11):
        bag.add(
            "vehicle-steel",
            rod(
                [(x * 0.5, 0.40, 0.86), (x * 1.5, 0.10, 0.70), (x * 1.3, -0.30, 0.52), (x * 1.2, -0.34, 0.36)], 0.024, 8
            ),
        )
        bag.add("vehicle-steel", rod([(x * 1.1, -0.24, 0.74), (x * 0.9, -0.62, 0.80)], 0.014, 6))
        bag.add("vehicle-satin", rod([(x * 1.1, -0.30, 0.40), (x * 1.15, -0.70, 0.315)], [0.030, 0.024], 8, caps=True))
    bag.add("vehicle-satin", rod([(0.0, -0.28, 0.66), (0.0, -0.44, 0.42)], 0.040, 10))
    # Exhaust on the right.
    bag.add(
        "vehicle-chrome",
        rod(
            [(0.06, 0.27, 0.52), (0.09, 0.36, 0.38), (0.12, 0.22, 0.24), (0.14, -0.20, 0.23), (0.17, -0.36, 0.30)],
            0.022,
            9,
        ),
    )
    bag.add(
        "vehicle-satin",
        rod(
            [(0.17, -0.34, 0.295), (0.185, -0.44, 0.34), (0.20, -0.78, 0.46), (0.20, -0.80, 0.467)],
            [0.030, 0.050, 0.048, 0.030],
            12,
            caps=True,
        ),
    )
    # Foot pegs, side stand.
    for side in (-1.0, 1.0):
        peg = np.array(MOTORCYCLE.foot[0]) * [side, 1.0, 1.0]
        bag.add(
            "vehicle-plastic", rod([peg - [side * 0.09, 0, 0.012], peg + [side * 0.04, 0, -0.012]], 0.013, 7, caps=True)
        )
        bag.add("vehicle-satin", rod([peg - [side * 0.09, 0, 0.012], np.array([side * 0.13, -0.25, 0.42])], 0.011, 6))
    bag.add(
        "vehicle-lamp-red", pillow((0.065, 0.03, 0.028), sides=12, levels=5).moved(turned(0, 0.0, (0.0, -0.83, 0.815)))
    )
    for side in (-1.0, 1.0):
        bag.add(
            "vehicle-amber",
            pillow((0.018, 0.026, 0.016), squareness=0.7, sides=8, levels=5).moved(
                turned(0, 0.0, (side * 0.16, -0.80, 0.76))
            ),
            pillow((0.018, 0.026, 0.016), squareness=0.7, sides=8, levels=5).moved(
                turned(0, 0.0, (side * 0.19, 0.60, 0.85))
            ),
        )
        bag.add(
            "vehicle-plastic",
            rod([(side * 0.05, -0.78, 0.76), (side * 0.15, -0.80, 0.76)], 0.007, 5),
            rod([(side * 0.09, 0.56, 0.85), (side * 0.18, 0.60, 0.85)], 0.007, 5),
        )
    bag.add("vehicle-plastic", rod([(0.0, -0.76, 0.78), (0.0, -0.92, 0.62)], 0.020, 6))
    small = number_plate()
    where = turned(0, -18.0, (0.0, -0.935, 0.60))
    where[:3, :3] = where[:3, :3] @ np.diag([0.42, 0.42, 1.2])
    bag.merge(small, where)
    parts = [RawPart("frame", bag)]
    for k, (axle, width) in enumerate(((front, 0.115), (rear, 0.165))):
        parts.append(
            RawPart(
                f"wheel-{k + 1}",
                _cast_wheel(float(axle[2]), width).moved_to(axle),
                (0.0, float(axle[1]), float(axle[2])),
                "rot.x",
            )
        )
    return parts


def _cast_wheel(radius: float, width: float) -> Wheel:
    bag = Bag()
    half, rim = 0.5 * width, 0.70 * radius
    wall = [(rim, 0.40 * width), (radius - 0.05, half), (radius - 0.018, 0.62 * half), (radius, 0.18 * half)]
    tyre = [*((r, -x) for r, x in wall), *wall[::-1]]
    bag.add("vehicle-tyre", lathe(tyre, 32).moved(AXLE))
    lip = [
        (rim, -0.40 * width),
        (rim - 0.016, -0.36 * width),
        (rim - 0.022, 0.0),
        (rim - 0.016, 0.36 * width),
        (rim, 0.40 * width),
    ]
    bag.add("vehicle-rim-dark", lathe(lip[::-1], 28).moved(AXLE))
    for k in range(5):
        angle = 0.4 * np.pi * k
        for spread in (-0.16, 0.16):
            direction = np.array([0.0, np.cos(angle + spread), np.sin(angle + spread)])
            start = np.array([0.0, np.cos(angle), np.sin(angle)]) * 0.03
            bag.add("vehicle-rim-dark", rod([start, direction * (rim - 0.018)], [0.018, 0.013], 5))
    bag.add("vehicle-rim-dark", lathe([(0.0, -0.06), (0.045, -0.06), (0.045, 0.06), (0.0, 0.06)], 14).moved(AXLE))
    for x in (-0.075, 0.075) if width < 0.14 else (-0.08,):
        ring = [(0.10, x - 0.003), (0.150, x - 0.003), (0.150, x + 0.003), (0.10, x + 0.003), (0.10, x - 0.003)]
        bag.add("vehicle-disc", lathe(ring, 28).moved(AXLE))
    if width > 0.14:
        bag.add("vehicle-steel", lathe([(0.06, 0.085), (0.105, 0.085), (0.105, 0.093), (0.06, 0.093)], 24).moved(AXLE))
    return Wheel(bag)


def _engine(bag: Bag) -> None:
    """Add crankcase, finned cylinders and chain."""
    bag.add(
        "vehicle-steel",
        pillow((0.17, 0.24, 0.13), squareness=0.45, sides=18, levels=7).moved(turned(0, 0.0, (0.0, -0.02, 0.36))),
    )
    for side in (-1.0, 1.0):
        bag.add(
            "vehicle-satin",
            pillow((0.03, 0.10, 0.10), squareness=0.8, sides=16, levels=5).moved(
                turned(0, 0.0, (side * 0.17, -0.08, 0.36))
            ),
        )
        bag.add(
            "vehicle-satin",
            pillow((0.025, 0.07, 0.07), squareness=0.8, sides=14, levels=5).moved(
                turned(0, 0.0, (side * 0.165, 0.11, 0.37))
            ),
        )
    fins = [
        boxes([[-0.15, -0.085, 0.022 * k]], [[0.15, 0.085, 0.022 * k + 0.010]]).moved(
            turned(0, -22.0, (0.0, 0.12, 0.46))
        )
        for k in range(8)
    ]
    bag.add(
        "vehicle-steel",
        *fins,
        boxes([[-0.13, -0.07, 0.0]], [[0.13, 0.07, 0.17]]).moved(turned(0, -22.0, (0.0, 0.12, 0.46))),
    )
    bag.add(
        "vehicle-satin",
        pillow((0.15, 0.09, 0.04), squareness=0.4, sides=16, levels=5).moved(turned(0, -22.0, (0.0, 0.19, 0.655))),
    )
    # Radiator and chain.
    bag.add(
        "vehicle-gap", boxes([[-0.16, 0.0, -0.10]], [[0.16, 0.035, 0.12]]).moved(turned(0, -14.0, (0.0, 0.335, 0.56)))
    )
    for dz in (-0.08, 0.06):
        bag.add("vehicle-gap", rod([(0.10, -0.18, 0.36 + 0.8 * dz), (0.089, -0.70, 0.315 + dz)], 0.010, 5))


def _tank_and_seat(bag: Bag) -> None:
    tank = pillow((0.155, 0.29, 0.135), squareness=0.7, sides=24, levels=11)
    points = tank.positions.copy()
    forward = (points[:, 1] + 0.29) / 0.58
    points[:, 0] *= np.interp(forward, [0.0, 0.35, 0.75, 1.0], [0.50, 0.85, 1.08, 0.9])
    points[:, 2] += np.interp(forward, [0.0, 0.5, 1.0], [-0.055, 0.01, 0.0])
    bag.add("paint", renormalled(Surface(points + np.array([0.0, 0.19, 0.865]), tank.normals, tank.uvs, tank.faces)))
    bag.add(
        "vehicle-chrome",
        lathe([(0.045, 0.0), (0.042, 0.012), (0.0, 0.016)], 16).moved(turned(0, 4.0, (0.0, 0.22, 1.003))),
    )
    # Side panels and tail.
    for side in (-1.0, 1.0):
        panel = pillow((0.03, 0.15, 0.085), squareness=0.7, sides=14, levels=5).moved(
            turned(0, 14.0, (side * 0.125, -0.20, 0.66))
        )
        bag.add("vehicle-plastic", panel)
    tail = pillow((0.12, 0.26, 0.05), squareness=0.6, sides=18, levels=7)
    points = tail.positions.copy()
    points[:, 0] *= np.interp(points[:, 1], [-0.26, 0.26], [0.55, 1.0])
    points[:, 2] += np.interp(points[:, 1], [-0.26, 0.0, 0.26], [0.03, 0.0, 0.0])
    bag.add("paint", renormalled(Surface(points + np.array([0.0, -0.60, 0.80]), tail.normals, tail.uvs, tail.faces)))
    seat = pillow((0.135, 0.32, 0.045), squareness=0.6, sides=20, levels=7)
    points = seat.positions.copy()
    points[:, 0] *= np.interp(points[:, 1], [-0.32, -0.05, 0.32], [0.8, 1.0, 0.62])
    points[:, 2] += np.interp(points[:, 1], [-0.32, -0.13, -0.08, 0.32], [0.09, 0.07, 0.0, 0.015])
    bag.add(
        "vehicle-fabric",
        renormalled(Surface(points + np.array([0.0, -0.36, 0.79]), seat.normals, seat.uvs, seat.faces)),
    )


def _fork(bag: Bag, front: Floats) -> None:
    head = np.array([0.0, 0.455, 0.93])
    for side in (-1.0, 1.0):
        x = np.array([side * 0.095, 0.0, 0.0])
        low = front + x
        top = head + x
        middle = low + 0.48 * (top - low)
        bag.add("vehicle-satin", rod([low - [0, 0, 0.02], middle], 0.030, 10, caps=True))
        bag.add("vehicle-chrome", rod([middle, top], 0.021, 10))
        bag.add(
            "vehicle-satin",
            pillow((0.03, 0.06, 0.035), squareness=0.5, sides=10, levels=5).moved(
                turned(0, 0.0, low + [-side * 0.01, -0.10, 0.10])
            ),
        )
        grip = np.array(MOTORCYCLE.grip) * [side, 1.0, 1.0]
        bag.add(
            "vehicle-plastic",
            rod(
                [*np.array([(side * 0.04, 0.42, 0.985), (side * 0.16, 0.40, 1.03)]), grip - [side * 0.06, -0.015, 0.0]],
                0.013,
                8,
            ),
            rod([grip - [side * 0.065, -0.016, 0], grip + [side * 0.065, -0.016, 0]], 0.019, 8, caps=True),
        )
        bag.add(
            "vehicle-satin",
            rod(
                [
                    grip + [-side * 0.06, 0.03, -0.005],
                    grip + [side * 0.02, 0.055, -0.015],
                    grip + [side * 0.08, 0.03, -0.02],
                ],
                0.006,
                5,
            ),
        )
        mirror = grip + np.array([side * 0.03, 0.03, 0.20])
        bag.add(
            "vehicle-plastic",
            rod(
                [grip + [-side * 0.08, 0.02, 0.01], grip + [-side * 0.04, 0.03, 0.14], mirror - [0, 0, 0.01]], 0.006, 5
            ),
        )
        bag.add(
            "vehicle-plastic",
            pillow((0.075, 0.02, 0.042), squareness=0.6, sides=14, levels=5).moved(turned(0, 0.0, mirror)),
        )
        bag.add(
            "vehicle-mirror",
            pillow((0.066, 0.004, 0.035), squareness=0.6, sides=12, levels=3).moved(
                turned(0, 0.0, mirror - [0, 0.019, 0])
            ),
        )
    bag.add(
        "vehicle-steel", boxes([[-0.12, 0.40, 0.955], [-0.12, 0.46, 0.79]], [[0.12, 0.49, 0.98], [0.12, 0.53, 0.815]])
    )
    lamp = np.array([0.0, 0.575, 0.90])
    bag.add(
        "vehicle-plastic", pillow((0.10, 0.085, 0.095), squareness=0.9, sides=18, levels=7).moved(turned(0, 0.0, lamp))
    )
    bag.add(
        "vehicle-chrome",
        lathe([(0.094, 0.0), (0.098, 0.012), (0.086, 0.020)], 22).moved(turned(0, -90.0, lamp + [0, 0.062, 0])),
    )
    bag.add(
        "vehicle-lamp-white",
        lathe([(0.086, 0.016), (0.06, 0.030), (0.0, 0.036)], 22).moved(turned(0, -90.0, lamp + [0, 0.062, 0])),
    )
    bag.add(
        "vehicle-plastic",
        pillow((0.05, 0.02, 0.04), squareness=0.5, sides=12, levels=5).moved(turned(0, 40.0, (0.0, 0.50, 1.03))),
    )
    spine = arc(front, 0.335, 35.0, 150.0, 14)
    edge = arc(front, 0.318, 35.0, 150.0, 14)
    half = 0.066
    grid = np.stack(
        [
            edge + [half, 0, 0],
            spine + [0.5 * half, 0, 0],
            spine - [0.5 * half, 0, 0],
            edge - [half, 0, 0],
        ],
        1,
    )
    bag.add("paint", sheet(grid), sheet(grid, flip=True))
