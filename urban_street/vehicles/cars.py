"""A whole car by part: shell, panels, wheels, cabin and details."""

from __future__ import annotations

import numpy as np

from urban_street.solids.surfaces import Bag
from urban_street.vehicles.backs import BACKS
from urban_street.vehicles.content import RawPart
from urban_street.vehicles.designs import CarDesign
from urban_street.vehicles.details import add_details, add_side_details
from urban_street.vehicles.extras import EXTRAS
from urban_street.vehicles.interior import add_interior
from urban_street.vehicles.panels import Panels
from urban_street.vehicles.shell import Shell
from urban_street.vehicles.skin import mirrored_bag
from urban_street.vehicles.wheels import WheelSize, build_wheel
from urban_street.vehicles.windows import BODY, FRONT_DOOR, REAR_DOOR


def build_body(design: CarDesign, *, fine: bool = True) -> list[RawPart]:
    """Build body and doors: 1 front left, 2 front right, 3 rear left, 4 rear right."""
    shell = Shell(design, fine=fine)
    half = Panels(shell).build()
    add_side_details(half, shell)
    body = Bag()
    body.merge(half.parts[BODY])
    body.merge(mirrored_bag(half.parts[BODY]))
    body.merge(half.both)
    add_interior(body, shell)
    add_details(body, shell)
    if design.back in BACKS:
        BACKS[design.back](body, shell)
    for name in design.extras:
        EXTRAS[name](body, shell)
    parts = [RawPart("body", body)]
    hinge = {FRONT_DOOR: design.doors[0] - 0.03, REAR_DOOR: design.doors[1] - 0.005}
    reach = 0.5 * design.width - 0.07
    doors = (FRONT_DOOR,) if design.two_doors else (FRONT_DOOR, REAR_DOOR)
    for k, (name, side) in enumerate((name, side) for name in doors for side in (-1, 1)):
        bag = half.parts[name] if side > 0 else mirrored_bag(half.parts[name])
        parts.append(RawPart(f"door-{k + 1}", bag, (side * reach, hinge[name], 0.0), "rot.z"))
    return parts


def build_wheels(design: CarDesign, rim: str, *, fine: bool = True) -> list[RawPart]:
    """Build four wheels in the order of the doors."""
    axles = (design.front_axle, design.rear_axle)
    size = WheelSize(design.tyre, design.tyre_width, design.rim_share * design.tyre)
    return wheels(size, rim, 0.5 * design.width - 0.135, axles, fine=fine)


def wheels(
    size: WheelSize, design: str, x: float, axles: tuple[float, ...], *, twin: bool = False, fine: bool = True
) -> list[RawPart]:
    """Build a wheel at each end of each axle, left before right.

    Args:
        design: design of the rims, a key of `RIMS`.
        x: x of the outer faces on the right, metres.
        axles: y of the axles, metres.
        twin: True if all axles but the first have two wheels on each side.
        fine: see `build_wheel`.
    """
    wheel = build_wheel(size, design, fine=fine)
    parts: list[RawPart] = []
    for row, y in enumerate(axles):
        for side in (-1, 1):
            bag = Bag()
            where = np.eye(4)
            where[:3, 3] = (x, y, size.radius)
            bag.merge(wheel, where)
            if twin and row:
                inner = where.copy()
                inner[0, 3] -= size.width + 0.03
                bag.merge(wheel, inner)
            turned = bag if side > 0 else mirrored_bag(bag)
            parts.append(RawPart(f"wheel-{len(parts) + 1}", turned, (side * x, y, size.radius), "rot.x"))
    return parts
