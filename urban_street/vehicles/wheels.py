"""Wheels: a tyre, a rim of one of several designs, brake disc and nuts. The axle is x, with the outside at +x."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, Surface, lathe, merge, repeat, sheet

#: Designs of rims: number of spokes, share of the sector that a spoke fills at hub and rim, split spokes.
RIMS: Final = {
    "five": (5, 0.62, 0.30, False),
    "double": (5, 0.72, 0.52, True),
    "ten": (10, 0.50, 0.34, False),
    "star": (7, 0.56, 0.26, False),
    "turbine": (9, 0.66, 0.44, False),
    "steel": (0, 0.0, 0.0, False),
    "six": (6, 0.52, 0.36, False),
    "mesh": (12, 0.40, 0.30, True),
    "aero": (5, 0.98, 0.90, False),
    "cover": (8, 0.74, 0.66, False),
    "hub-cap": (0, 0.0, 0.0, False),
}
#: Transform from the z axis of a surface of revolution to the wheel's x.
_UPRIGHT = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


class WheelSize(NamedTuple):
    """The size of a wheel, metres: radius and width of the tyre, radius of the rim."""

    radius: float
    width: float
    rim_radius: float


def build_wheel(size: WheelSize, design: str, *, fine: bool = True) -> Bag:
    """Build a wheel around the origin with its outer face at +x; about 1,200 triangles."""
    radius, width, rim_radius = size
    bag = Bag()
    sides = 24 if fine else 12
    half = 0.5 * width
    wall = radius - rim_radius
    tyre = [
        (rim_radius - 0.006, -half + 0.012), (rim_radius + 0.25 * wall, -half - 0.004), (radius - 0.38 * wall, -half - 0.006),
        (radius - 0.10 * wall, -half + 0.012), (radius, -half + 0.034), (radius, half - 0.034),
        (radius - 0.10 * wall, half - 0.012), (radius - 0.38 * wall, half + 0.006), (rim_radius + 0.25 * wall, half + 0.004),
        (rim_radius - 0.006, half - 0.012),
    ]  # fmt: skip
    bag.add("vehicle-tyre", lathe(tyre, sides).moved(_UPRIGHT))
    # barrel, seen through the spokes, and lip
    lip = [(rim_radius - 0.004, half - 0.008), (rim_radius - 0.012, half - 0.002), (rim_radius - 0.022, half - 0.010)]
    bag.add("vehicle-rim", lathe(lip, sides).moved(_UPRIGHT))
    barrel = [(rim_radius - 0.022, half - 0.010), (rim_radius - 0.040, half - 0.05), (rim_radius - 0.045, -half + 0.03)]
    bag.add("vehicle-rim-dark", lathe(barrel, sides).moved(_UPRIGHT))
    inside = half - 0.085
    disc = 0.72 * rim_radius
    bag.add(
        "vehicle-disc",
        lathe(
            [
                (disc, inside - 0.02),
                (disc, inside),
                (0.42 * disc, inside),
                (0.42 * disc, inside + 0.02),
                (0.0, inside + 0.02),
            ],
            sides,
        ).moved(_UPRIGHT),
    )
    bag.add("vehicle-gap", lathe([(rim_radius, -half + 0.04), (0.0, -half + 0.04)], sides).moved(_UPRIGHT))
    spokes, hub_share, rim_share, split = RIMS[design]
    if spokes:
        bag.add(
            "vehicle-rim",
            _spokes(rim_radius, half, spokes, hub_share, rim_share, split=split, swept=design == "turbine", fine=fine),
        )
        hub = 0.24 * rim_radius
        face = half - 0.020
        bag.add(
            "vehicle-rim",
            lathe(
                [
                    (hub, face - 0.03),
                    (hub * 0.98, face - 0.004),
                    (hub * 0.55, face),
                    (hub * 0.5, face + 0.004),
                    (0.0, face + 0.006),
                ],
                14 if fine else 7,
            ).moved(_UPRIGHT),
        )
        if fine:
            nut = lathe([(0.011, face - 0.002), (0.0, face + 0.008)], 5).moved(_UPRIGHT)
            around = 0.4 * np.pi * np.arange(5)
            places = 0.72 * hub * np.stack([0.0 * around, np.cos(around), np.sin(around)], -1)
            bag.add("vehicle-disc", repeat(nut, places))
    else:
        bag.add("vehicle-rim", _trim_disc(rim_radius, half))
    return bag


def _spokes(
    rim: float, half: float, count: int, hub_share: float, rim_share: float, *, split: bool, swept: bool, fine: bool
) -> Surface:
    """Build spokes from hub to rim, each a ridge with sloping flanks, dished towards the hub."""
    radii = np.linspace(0.20 * rim, rim - 0.018, 4 if fine else 3)
    share = (radii - radii[0]) / (radii[-1] - radii[0])
    face = half - 0.012 - 0.022 * np.sin(np.pi * (1.0 - share)) * (1.0 - share) - 0.008 * (1.0 - share)
    sector = 2.0 * np.pi / count
    arc = np.minimum(sector * (hub_share + (rim_share - hub_share) * share) * radii, sector * radii * 0.98)
    arc = arc * (0.42 + 0.58 * (radii[0] / radii))  # spokes get narrower outwards
    lean = 0.35 * share**1.5 if swept else 0.0 * share
    # Across a spoke: foot, shoulder, crown, shoulder, foot. Distant views need only the shoulders.
    shoulders = ((-0.46, 0.004), (-0.18, 0.0), (0.18, 0.0), (0.46, 0.004))
    across = ((-0.62, 0.034), *shoulders, (0.62, 0.034)) if fine else (shoulders[0], shoulders[-1])
    pieces = []
    for k in range(count):
        arms = (-1.0, 1.0) if split else (0.0,)
        for arm in arms:
            spread = arm * (0.10 + 0.16 * share) * sector
            width = arc * (0.42 if split else 1.0)
            angle = k * sector + spread + lean
            rows = []
            for offset, drop in across:
                turn = angle + offset * width / radii
                rows.append(np.stack([face - drop, radii * np.cos(turn), radii * np.sin(turn)], -1))
            pieces.append(_creased(np.stack(rows, 0)))
    return merge(pieces)


def _creased(grid: Floats) -> Surface:
    """Build a grid of strips with sharp edges between rows. Each strip is smooth along its columns."""
    return merge([sheet(grid[k : k + 2], flip=False) for k in range(len(grid) - 1)])


def _trim_disc(rim: float, half: float) -> Surface:
    """Build a wheel cover with holes all around."""
    face = half - 0.014
    outside = [(rim - 0.018, face - 0.010), (0.86 * rim, face), (0.80 * rim, face - 0.004)]
    inside = [
        (0.55 * rim, face - 0.004),
        (0.40 * rim, face + 0.012),
        (0.16 * rim, face + 0.016),
        (0.15 * rim, face + 0.022),
        (0.0, face + 0.024),
    ]
    pieces = [lathe(outside, 40).moved(_UPRIGHT), lathe(inside, 30).moved(_UPRIGHT)]
    count = 12
    for k in range(count):
        start = 2.0 * np.pi * k / count
        angle = start + np.linspace(0.0, 0.62, 4) * 2.0 * np.pi / count
        inner = np.stack([np.full(4, face - 0.004), 0.55 * rim * np.cos(angle), 0.55 * rim * np.sin(angle)], -1)
        outer = np.stack([np.full(4, face - 0.004), 0.80 * rim * np.cos(angle), 0.80 * rim * np.sin(angle)], -1)
        pieces.append(sheet(np.stack([inner, outer], 1), flip=True))
    return merge(pieces)
