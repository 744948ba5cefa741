"""Lamp posts, signs, signals, bollards, bins, planters, hedges, railings."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from urban_street.solids.surfaces import (
    Bag,
    Surface,
    boxes,
    fan,
    lathe,
    quads,
    repeat,
    sheet,
    tubes,
)
from urban_street.street.foliage import clad
from urban_street.street.plan import Placement
from valerie.scene.graph.model import Light
from valerie.scene.graph.transforms import Pose

#: The lamp of a post. It points down from the middle of the lantern's lens, 0.12 m² of some 12,000 cd/m², warm white (3,000 K).
#: Posts 20 to 30 m apart give the road some 10 lx, within the range of EN 13201 for residential streets (P classes: 2 … 15 lx).
LANTERN: Final = Light(
    color=(1.0, 0.71, 0.42),
    intensity=1500.0,
    inner=math.radians(35.0),
    outer=math.radians(76.0),
    radius=0.18,
    switch="street",
    glowing=("lantern",),
    luminance=12_000.0,
)
#: Pose of the lamp in the post's frame: the light's +y points down.
LANTERN_PLACE: Final = Pose((1.725, 0.0, 7.28), (270.0, 0.0, 0.0)).matrix()


def lamp_post() -> Bag:
    """Build a tapered steel post of 8 m with an arm over the road (+x) and a flat lantern."""
    bag = Bag()
    bag.add("steel", lathe([(0.085, 0.0), (0.085, 1.0), (0.062, 1.06), (0.042, 6.6)], 12))
    t = np.linspace(0.0, 1.0, 9)
    arm = np.stack([1.5 * t**1.3, 0.0 * t, 6.6 + 0.75 * np.sin(0.5 * np.pi * t)], -1)
    bag.add("steel", tubes(arm[None], np.linspace(0.042, 0.03, 9)[None], 9))
    bag.add("steel", boxes([[1.35, -0.13, 7.31]], [[2.05, 0.13, 7.40]]))
    bag.add("lantern", quads([[(1.45, 0.11, 7.308), (2.0, 0.11, 7.308), (2.0, -0.11, 7.308), (1.45, -0.11, 7.308)]]))
    bag.add("frame-dark", boxes([[-0.09, -0.06, 0.35]], [[-0.083, 0.06, 0.75]]))
    return bag


def post(height: float = 2.9, radius: float = 0.032) -> Bag:
    """Build the post of a sign."""
    bag = Bag()
    bag.add("steel", lathe([(radius, 0.0), (radius, height), (0.0, height + 0.01)], 10))
    return bag


def bollard() -> Bag:
    bag = Bag()
    bag.add(
        "iron",
        lathe([(0.075, 0.0), (0.07, 0.1), (0.05, 0.14), (0.048, 0.78), (0.062, 0.82), (0.06, 0.9), (0.0, 0.96)], 12),
    )
    bag.add("lens", lathe([(0.0505, 0.62), (0.0505, 0.72)], 12))
    return bag


def signal() -> Bag:
    """Build a three-lamp signal head, 2.4 m above the foot, facing −y."""
    bag = Bag()
    bag.add("frame-dark", boxes([[-0.15, -0.1, 2.4]], [[0.15, 0.12, 3.3]]))
    bag.add("frame-dark", boxes([[-0.24, 0.12, 2.3]], [[0.24, 0.135, 3.4]]))
    for material, z in (("signal-red", 3.15), ("signal-off", 2.85), ("signal-off", 2.55)):
        bag.add(material, signal_lens(z))
        bag.add("visor", signal_visor(z))
    return bag


def signal_lens(z: float) -> Surface:
    """Build a lens of a signal head at a height, facing −y."""
    angle = np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
    circle = np.stack([0.1 * np.cos(angle), np.full(16, -0.105), 0.1 * np.sin(angle)], -1)
    return fan(circle + np.array([0.0, 0.0, z]))


def signal_visor(z: float) -> Surface:
    """Build the visor above a lens."""
    hood = np.linspace(0.15 * np.pi, 0.85 * np.pi, 9)
    ring = np.stack([0.115 * np.cos(hood), np.zeros(9), z + 0.115 * np.sin(hood)], -1)
    return sheet(np.stack([ring + np.array([0.0, -0.1, 0.0]), ring + np.array([0.0, -0.26, -0.01])], 1), flip=True)


def bins(seed: int) -> Bag:
    """Build two wheeled refuse bins side by side along x, with their hinges at +y."""
    bag = Bag()
    rng = np.random.default_rng(seed)
    for k, x in enumerate((-0.33, 0.33)):
        material = f"bin-{rng.integers(3)}" if k else "bin-0"
        wide, deep, high = 0.27, 0.30, 1.0
        bottom = np.array([(-0.22, -0.22), (0.22, -0.22), (0.22, 0.24), (-0.22, 0.24)])
        top = np.array([(-wide, -deep), (wide, -deep), (wide, deep), (-wide, deep)])
        rows = []
        for a in range(4):
            b = (a + 1) % 4
            rows.append([(x + bottom[a, 0], bottom[a, 1], 0.06), (x + bottom[b, 0], bottom[b, 1], 0.06),
                         (x + top[b, 0], top[b, 1], high), (x + top[a, 0], top[a, 1], high)])  # fmt: skip
        bag.add(material, quads(rows))
        lid = [
            [
                (x - 0.29, -0.33, high),
                (x + 0.29, -0.33, high),
                (x + 0.29, 0.33, high + 0.1),
                (x - 0.29, 0.33, high + 0.1),
            ]
        ]
        bag.add(material, quads(lid), boxes([[x - 0.29, -0.33, high - 0.05]], [[x + 0.29, 0.33, high]], skip=("-z",)))
        bag.add(
            "tyre",
            boxes([[x - 0.24, 0.16, 0.0], [x + 0.19, 0.16, 0.0]], [[x - 0.19, 0.34, 0.18], [x + 0.24, 0.34, 0.18]]),
        )
    return bag


def hedge(placement: Placement) -> Bag:
    """Build a clipped hedge along y; its size is (thickness, length, height)."""
    thick, long, high = placement.size
    rng = np.random.default_rng(placement.seed)
    return clad(np.array([-0.5 * thick, 0.0, 0.0]), np.array([0.5 * thick, long, high]), 40.0, 0.09, rng)


def planter(placement: Placement) -> Bag:
    """Build a wooden box with shrubs; its size is (thickness, length)."""
    thick, long = placement.size
    rng = np.random.default_rng(placement.seed)
    bag = clad(np.array([-0.42 * thick, 0.08, 0.45]), np.array([0.42 * thick, long - 0.08, 0.85]), 200.0, 0.10, rng)
    bag.add("planter", boxes([[-0.5 * thick, 0.0, 0.0]], [[0.5 * thick, long, 0.5]], skip=("-z",)))
    return bag


def iron_railing(length: float) -> Bag:
    """Build garden railings along y on a low kerb."""
    bag = Bag()
    bag.add("stone", boxes([[-0.1, 0.0, 0.0]], [[0.1, length, 0.25]], skip=("-z",), tile=2.0))
    y = np.arange(0.08, length - 0.05, 0.12)
    picket = boxes([[-0.009, -0.009, 0.25]], [[0.009, 0.009, 1.12]], skip=("-z",))
    bag.add("iron", repeat(picket, np.stack([0 * y, y, 0 * y], -1)))
    bag.add("iron", boxes([[-0.02, 0.0, 0.36], [-0.02, 0.0, 0.98]], [[0.02, length, 0.40], [0.02, length, 1.02]]))
    return bag


def low_wall(length: float) -> Bag:
    """Build a rendered garden wall along y with a stone coping."""
    bag = Bag()
    bag.add("brick-red", boxes([[-0.1, 0.0, 0.0]], [[0.1, length, 0.75]], skip=("-z", "+z"), tile=4.0))
    bag.add("stone", boxes([[-0.14, 0.0, 0.75]], [[0.14, length, 0.83]], tile=2.0))
    return bag
