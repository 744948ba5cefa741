"""A city bicycle of tubes, surfaces of revolution and rounded solids."""

from __future__ import annotations

from typing import Final

import numpy as np

from urban_street.human.riding import Contact
from urban_street.solids.rounded import bar, pillow, renormalled, rod, torus, turned
from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, lathe, sheet
from urban_street.vehicles.content import RawPart
from urban_street.vehicles.cycle_parts import AXLE, Wheel, arc
from urban_street.vehicles.skin import mirrored

#: Places of contact with a rider.
BICYCLE: Final = Contact(
    (0.0, -0.29, 0.925), (0.275, 0.20, 1.055), ((0.115, -0.005, 0.135), (-0.115, -0.155, 0.455)), 16.0
)


def build_bicycle() -> list[RawPart]:
    """Build frame and two wheels of a city bicycle with mudguards, carrier, chain and lamps; about 6,500 triangles."""
    bag = Bag()
    rear, front, bracket = np.array([0, -0.53, 0.345]), np.array([0, 0.545, 0.345]), np.array([0, -0.075, 0.285])
    cluster, head_top, head_low = np.array([0, -0.245, 0.79]), np.array([0, 0.315, 0.905]), np.array([0, 0.365, 0.735])
    saddle = np.array(BICYCLE.seat)
    tube = 0.017
    bag.add(
        "paint",
        rod([bracket, cluster], tube, 8), rod([cluster + [0, 0.01, -0.03], head_top + [0, 0.005, -0.03]], tube, 8),
        rod([bracket, head_low + [0, -0.004, 0.02]], 0.020, 8), rod([head_low, head_top], 0.021, 10, caps=True),
        rod([bracket + [-0.035, 0, 0], bracket + [0.035, 0, 0]], 0.024, 10, caps=True),
    )  # fmt: skip
    for x in (-0.06, 0.06):
        axle = rear + [x, 0, 0]
        bag.add(
            "paint",
            rod([bracket + [0.4 * x, 0, 0], axle], 0.010, 6),
            rod([cluster + [0.3 * x, -0.01, -0.03], axle], 0.009, 6),
        )
        crown = head_low + [x, 0.012, -0.035]
        bag.add("paint", rod([crown, crown + [0, 0.07, -0.18], front + [x, 0, 0]], [0.015, 0.014, 0.010], 6))
    bag.add("paint", rod([head_low + [-0.06, 0.010, -0.03], head_low + [0.06, 0.010, -0.03]], 0.015, 6, caps=True))
    bag.add("vehicle-satin", rod([cluster, saddle + [0, 0.02, -0.06]], 0.013, 8))
    bag.add("vehicle-plastic", _saddle(saddle))
    # stem, handlebar and grips
    stem = head_top + [0, -0.035, 0.10]
    bag.add("vehicle-satin", rod([head_top, stem, stem + [0, 0.055, 0.045]], 0.013, 8))
    clamp = stem + [0, 0.055, 0.045]
    right = [
        clamp,
        clamp + [0.09, 0.02, 0.005],
        clamp + [0.19, -0.01, 0.012],
        np.array([0.245, 0.235, 1.055]),
        np.array([0.305, 0.165, 1.052]),
    ]
    grip = [np.array([0.243, 0.237, 1.055]), np.array([0.307, 0.163, 1.052])]
    lever = [np.array([0.20, 0.262, 1.052]), np.array([0.255, 0.268, 1.030]), np.array([0.315, 0.215, 1.012])]
    for surface, material in (
        (rod(right, 0.0115, 8), "vehicle-satin"),
        (rod(grip, 0.017, 8, caps=True), "vehicle-plastic"),
        (rod(lever, 0.006, 5), "vehicle-satin"),
    ):
        bag.add(material, surface, mirrored(surface))
    bag.add(
        "vehicle-satin",
        pillow((0.025, 0.02, 0.018), squareness=0.8, sides=10, levels=5).moved(turned(0, 0.0, (-0.13, 0.36, 1.045))),
    )
    _mudguards(bag, rear, front)
    _carrier(bag, rear)
    _drive(bag, bracket, rear)
    bag.add(
        "vehicle-plastic",
        pillow((0.035, 0.035, 0.035), squareness=0.8, sides=10, levels=5).moved(turned(0, 0.0, (0.0, 0.42, 0.80))),
    )
    bag.add(
        "vehicle-lamp-white",
        lathe([(0.030, 0.0), (0.022, 0.010), (0.0, 0.014)], 12).moved(turned(0, -90.0, (0.0, 0.45, 0.80))),
    )
    bag.add("vehicle-lamp-red", boxes([[-0.04, -0.79, 0.70]], [[0.04, -0.765, 0.735]]))
    wheels = []
    for k, axle in enumerate((front, rear)):
        wheels.append(
            RawPart(
                f"wheel-{k + 1}",
                _spoked(0.345, 0.019, hub_half=0.05).moved_to(axle),
                (0.0, float(axle[1]), float(axle[2])),
                "rot.x",
            )
        )
    return [RawPart("frame", bag), *wheels]


def _spoked(radius: float, tyre: float, *, hub_half: float, spokes: int = 28) -> Wheel:
    """Return tyre, rim, crossed spokes and hub around the origin. The axle is x."""
    bag = Bag()
    bag.add("vehicle-tyre", torus(radius - tyre, tyre, 40, 7).moved(AXLE))
    rim = radius - 2.0 * tyre
    bag.add(
        "vehicle-satin",
        lathe(
            [
                (rim + 0.004, -0.012),
                (rim + 0.004, 0.012),
                (rim - 0.012, 0.007),
                (rim - 0.012, -0.007),
                (rim + 0.004, -0.012),
            ][::-1],
            40,
        ).moved(AXLE),
    )
    bag.add(
        "vehicle-satin",
        lathe(
            [
                (0.012, -hub_half),
                (0.026, -hub_half + 0.012),
                (0.016, -hub_half + 0.02),
                (0.016, hub_half - 0.02),
                (0.026, hub_half - 0.012),
                (0.012, hub_half),
            ],
            12,
        ).moved(AXLE),
    )
    paths = []
    for k in range(spokes):
        side = 1.0 if k % 2 else -1.0
        outer = 2.0 * np.pi * k / spokes
        inner = outer + (0.9 if k % 4 < 2 else -0.9)
        paths.append(
            np.array(
                [
                    [side * (hub_half - 0.014), 0.025 * np.cos(inner), 0.025 * np.sin(inner)],
                    [0.0, (rim - 0.008) * np.cos(outer), (rim - 0.008) * np.sin(outer)],
                ]
            )
        )
    for path in paths:
        bag.add("vehicle-satin", rod(path, 0.0016, 3))
    return Wheel(bag)


def _saddle(at: Floats) -> Surface:
    """Build a saddle, wide behind and narrow in front, with its top at ``at``."""
    shape = pillow((0.085, 0.135, 0.035), squareness=0.75, sides=20, levels=7)
    points = shape.positions.copy()
    forward = (points[:, 1] + 0.135) / 0.27
    points[:, 0] *= np.interp(forward, [0.0, 0.3, 0.62, 1.0], [0.95, 1.0, 0.38, 0.24])
    points[:, 2] -= 0.010 * np.sin(np.pi * forward)
    points += at + np.array([0.0, 0.03, -0.028])
    return renormalled(Surface(points, shape.normals, shape.uvs, shape.faces))


def _mudguards(
    bag: Bag, rear: Floats, front: Floats, radius: float = 0.365, half: float = 0.024, material: str = "paint"
) -> None:
    for axle, low, high in ((rear, 35.0, 205.0), (front, 50.0, 195.0 - 20.0)):
        spine = arc(axle, radius, low, high, 16)
        edge = arc(axle, radius - 0.012, low, high, 16)
        grid = np.stack(
            [edge + [half, 0, 0], spine + [0.5 * half, 0, 0], spine - [0.5 * half, 0, 0], edge - [half, 0, 0]], 1
        )
        bag.add(material, sheet(grid), sheet(grid, flip=True))
        tip = edge[-1] if axle is rear else edge[0]
        bag.add("vehicle-satin", *(rod([tip + [x, 0, 0], axle + [2.4 * x, 0, 0]], 0.0025, 4) for x in (-half, half)))


def _carrier(bag: Bag, rear: Floats) -> None:
    top = 0.755
    for x in (-0.055, 0.055):
        bag.add("vehicle-satin", rod([(x, -0.30, top), (x, -0.72, top), (0.3 * x, -0.76, top)], 0.006, 5))
        for y in (-0.48, -0.64):
            bag.add("vehicle-satin", rod([(x, y, top), (1.2 * x, rear[1], rear[2])], 0.005, 5))
    for y in (-0.36, -0.50, -0.66):
        bag.add("vehicle-satin", rod([(-0.055, y, top), (0.055, y, top)], 0.005, 5))


def _drive(bag: Bag, bracket: Floats, rear: Floats) -> None:
    """Add chainring, chain guard, cranks at the rider's feet, and pedals."""
    bag.add(
        "vehicle-steel",
        lathe([(0.03, 0.040), (0.085, 0.042), (0.088, 0.046), (0.085, 0.050), (0.0, 0.050)], 24)
        .moved(AXLE)
        .moved(turned(0, 0.0, bracket)),
    )
    for dz in (-0.075, 0.07):
        bag.add("vehicle-steel", rod([bracket + [0.046, 0, dz], rear + [0.046, 0, 0.45 * dz]], 0.006, 5))
    guard = bar(
        np.array([(-0.53, 0.37), (-0.08, 0.385), (0.02, 0.355), (0.04, 0.30), (-0.06, 0.335), (-0.53, 0.345)])[::-1],
        0.052,
        0.062,
    )
    bag.add("vehicle-plastic", guard)
    for k, side in ((0, 1.0), (1, -1.0)):
        pedal = np.array(BICYCLE.foot[k]) - [0.0, 0.0, 0.012]
        start = bracket + [side * 0.065, 0, 0]
        end = np.array([side * 0.075, pedal[1], pedal[2]])
        bag.add(
            "vehicle-satin",
            rod([start - [side * 0.03, 0, 0], start, end], 0.011, 6, caps=True),
            rod([end, end + [side * 0.05, 0, 0]], 0.008, 6),
        )
        bag.add("vehicle-plastic", boxes([pedal - [0.045, 0.045, 0.012]], [pedal + [0.045, 0.045, 0.012]]))
