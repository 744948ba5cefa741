"""Things on the ground that belong to a pose: a stroller, a wheelchair, a walking frame, a dog.

They are objects of their own, since they touch the ground: Cityscapes labels buggies, wheelchairs and animals ``dynamic``. Their
frame is that of the figure (`postures`): the origin is below the person's hips, +y is ahead. Lengths are metres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Final

import numpy as np

from urban_street.human.postures import FOOTREST_M, HOLDING, SEAT_M, Hand
from urban_street.solids.rounded import pillow, renormalled, rod, torus, turned
from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, sheet
from valerie.scene.graph.model import Material, Mesh

#: Materials of all aids, by name.
MATERIALS: Final[Mapping[str, Material]] = MappingProxyType(
    {
        material.name: material
        for material in (
            Material("aid-steel", (0.55, 0.56, 0.57), metallic=1.0, roughness=0.30),
            Material("aid-frame", (0.030, 0.032, 0.036), metallic=0.3, roughness=0.45),
            Material("aid-rubber", (0.022, 0.022, 0.022), roughness=0.85),
            Material("aid-padding", (0.020, 0.021, 0.024), roughness=0.9),
            Material("aid-canopy", (0.045, 0.075, 0.125), roughness=0.85, double_sided=True),
            Material("aid-blanket", (0.55, 0.50, 0.42), roughness=0.95),
            Material("aid-fur", (0.36, 0.21, 0.095), roughness=0.95, specular=0.4),
            Material("aid-muzzle", (0.30, 0.18, 0.085), roughness=0.9, specular=0.4),
            Material("aid-nose", (0.010, 0.009, 0.009), roughness=0.25),
            Material("aid-collar", (0.42, 0.02, 0.02), roughness=0.6),
        )
    }
)
#: Place of the dog, and of the ring of its collar in the figure's frame.
_DOG: Final = np.array([0.46, 0.62, 0.0])
COLLAR_RING: Final = _DOG + [0.0, 0.34, 0.51]


def _hand(pose: str) -> Floats:
    """Return the place of the right hand in a pose."""
    hand = HOLDING[pose].right
    assert isinstance(hand, Hand)
    return np.asarray(hand.place)


def _wheel(radius: float, tyre: float, at: Floats, *, spokes: int = 0, hub: float = 0.03) -> dict[str, list[Surface]]:
    """Return a wheel that turns about x: tyre and hub, and spokes or a disc."""
    upright = turned(1, 90.0, at)
    parts = {"aid-rubber": [torus(radius - tyre, tyre, 40, 10).moved(upright)]}
    parts["aid-steel"] = [rod([at - [0.022, 0, 0], at + [0.022, 0, 0]], hub, 12, caps=True)]
    for angle in np.linspace(0.0, 2.0 * np.pi, spokes, endpoint=False):
        way = np.array([0.0, np.cos(angle), np.sin(angle)])
        parts["aid-steel"].append(rod([at + 0.8 * hub * way, at + (radius - 1.6 * tyre) * way], 0.0022, 4))
    if spokes:
        parts["aid-steel"].append(torus(radius - 2.0 * tyre, 0.5 * tyre, 40, 6).moved(upright))
    else:
        parts["aid-frame"] = [rod([at - [0.008, 0, 0], at + [0.008, 0, 0]], radius - 1.5 * tyre, 24, caps=True)]
    return parts


def _add(bag: Bag, parts: Mapping[str, list[Surface]]) -> None:
    for material, surfaces in parts.items():
        bag.add(material, *surfaces)


def _at(surface: Surface, place: object, degrees: float = 0.0, axis: int = 0) -> Surface:
    """Return a surface that was built around the origin, turned about an axis and moved to a place."""
    return surface.moved(turned(axis, degrees, np.asarray(place, np.float64)))


def _curve(points: object, count: int = 14) -> Floats:
    """Return a polyline with its corners rounded, (count, 3)."""
    path = np.asarray(points, np.float64)
    for _ in range(2):
        path = np.concatenate(
            [
                path[:1],
                *np.stack([0.75 * path[:-1] + 0.25 * path[1:], 0.25 * path[:-1] + 0.75 * path[1:]], 1),
                path[-1:],
            ]
        )
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(even, length, path[:, axis]) for axis in range(3)], axis=1)


def stroller() -> Bag:
    """Build a stroller with a hood and four wheels, which is pushed by its bar."""
    bag = Bag()
    _, y, z = _hand("stroller")
    bar = _curve([(-0.25, y + 0.10, z - 0.07), (-0.25, y, z), (0.25, y, z), (0.25, y + 0.10, z - 0.07)], 20)
    bag.add("aid-frame", rod(bar, 0.011, 8))
    bag.add("aid-rubber", rod([(-0.20, y, z), (0.20, y, z)], 0.0155, 10, caps=True))
    for x in (-0.25, 0.25):
        bag.add(
            "aid-frame",
            rod([(x, y + 0.10, z - 0.07), (x, y + 0.42, 0.60), (x, y + 0.80, 0.13)], 0.012, 8, caps=True),
            rod([(x, y + 0.42, 0.60), (1.08 * x, y + 0.14, 0.14)], 0.012, 8, caps=True),
            rod([(x, y + 0.24, 0.33), (x, y + 0.66, 0.31)], 0.009, 8),
        )
        _add(bag, _wheel(0.14, 0.020, np.array([1.16 * x, y + 0.14, 0.14]), spokes=10))
        _add(bag, _wheel(0.095, 0.018, np.array([0.92 * x, y + 0.82, 0.095])))
        bag.add("aid-frame", rod([(x, y + 0.80, 0.13), (0.92 * x, y + 0.82, 0.095)], 0.010, 6))
    bag.add("aid-frame", rod([(-0.27, y + 0.14, 0.14), (0.27, y + 0.14, 0.14)], 0.009, 8))
    # the shell in which the child lies, its blanket, and the basket below
    shell = pillow((0.225, 0.40, 0.15), squareness=0.55, sides=36, levels=13)
    points = shell.positions.copy()
    points[:, 2] = np.minimum(points[:, 2], 0.075 + 0.10 * np.clip(-points[:, 1] / 0.4, -0.4, 1.0))
    bag.add(
        "aid-canopy",
        _at(renormalled(Surface(points, shell.normals, shell.uvs, shell.faces)), (0, y + 0.53, 0.62)),
    )
    blanket = pillow((0.19, 0.30, 0.075), squareness=0.7, sides=28, levels=9)
    bag.add("aid-blanket", _at(blanket, (0.0, y + 0.60, 0.685), 4.0))
    bag.add(
        "aid-padding",
        _at(pillow((0.20, 0.24, 0.075), squareness=0.4, sides=24, levels=7), (0, y + 0.45, 0.34)),
    )
    around, over = np.meshgrid(
        np.linspace(-0.5, 0.5, 19) * np.pi, np.radians(np.linspace(-8.0, 112.0, 15)), indexing="ij"
    )
    hood = np.stack(
        [
            0.235 * np.sin(around),
            -0.36 * np.cos(over) * np.cos(around) ** 0.7,
            0.33 * np.sin(over) * np.cos(around) ** 0.6,
        ],
        -1,
    )
    hood[..., 2] *= 1.0 + 0.02 * np.cos(5.0 * over)
    bag.add("aid-canopy", sheet(hood + [0.0, y + 0.53, 0.70], flip=True))
    return bag


def wheelchair() -> Bag:
    """Build a wheelchair with large driving wheels and hand rims, to sit in."""
    bag = Bag()
    for side in (-1.0, 1.0):
        hub = np.array([side * 0.275, -0.05, 0.305])
        _add(bag, _wheel(0.305, 0.014, hub, spokes=20, hub=0.026))
        rim = hub + [side * 0.028, 0.0, 0.0]
        bag.add("aid-steel", _at(torus(0.258, 0.008, 40, 8), rim, 90.0, 1))
        x = side * 0.225
        seat, foot = SEAT_M - 0.055, FOOTREST_M - 0.012
        bag.add(
            "aid-frame",
            rod(
                _curve(
                    [(x, -0.30, 0.94), (x, -0.235, 0.94), (x, -0.215, 0.90), (x, -0.20, seat), (x, -0.20, 0.16)], 24
                ),
                0.0115,
                8,
            ),
            rod(
                _curve([(x, -0.20, seat), (x, 0.34, seat), (0.9 * x, 0.44, 0.36), (0.75 * x, 0.50, foot)], 24),
                0.0115,
                8,
            ),
            rod([(x, -0.20, 0.18), (x, 0.34, 0.21), (x, 0.34, seat)], 0.010, 8),
            rod([(x, 0.30, 0.21), (x, 0.30, 0.11)], 0.012, 8),
        )
        bag.add("aid-rubber", rod([(x, -0.40, 0.94), (x, -0.28, 0.94)], 0.017, 10, caps=True))
        _add(bag, _wheel(0.075, 0.017, np.array([x, 0.27, 0.075])))
        bag.add(
            "aid-padding",
            pillow((0.005, 0.15, 0.075), squareness=0.3, sides=16, levels=7).moved(
                turned(0, 0.0, (side * 0.243, 0.0, seat + 0.085))
            ),
        )
        bag.add(
            "aid-frame",
            boxes(
                [[min(0.02 * side, 0.165 * side), 0.44, foot - 0.012]], [[max(0.02 * side, 0.165 * side), 0.62, foot]]
            ),
        )
    bag.add(
        "aid-padding",
        pillow((0.215, 0.235, 0.030), squareness=0.25, sides=32, levels=9).moved(
            turned(0, 0.0, (0.0, 0.045, SEAT_M - 0.035))
        ),
    )
    bag.add(
        "aid-padding",
        _at(pillow((0.215, 0.018, 0.185), squareness=0.25, sides=32, levels=9), (0.0, -0.222, 0.70), 3.0),
    )
    bag.add("aid-frame", rod([(-0.275, -0.05, 0.305), (0.275, -0.05, 0.305)], 0.012, 8))
    return bag


def walking_frame() -> Bag:
    """Build a walking frame of steel tubes with two wheels in front."""
    bag = Bag()
    x, y, z = _hand("walking-frame")
    for side in (-1.0, 1.0):
        front, rear = (side * (x + 0.045), y + 0.27, 0.05), (side * (x + 0.05), y - 0.20, 0.02)
        tube = _curve(
            [
                rear,
                (side * x, y - 0.12, z - 0.02),
                (side * x, y - 0.09, z),
                (side * x, y + 0.10, z),
                (side * x, y + 0.16, z - 0.04),
                front,
            ],
            30,
        )
        bag.add("aid-steel", rod(tube, 0.0125, 10, caps=True))
        bag.add("aid-rubber", rod([(side * x, y - 0.085, z), (side * x, y + 0.085, z)], 0.018, 10, caps=True))
        bag.add("aid-rubber", rod([(rear[0], rear[1], 0.0), (rear[0], rear[1], 0.05)], 0.017, 10, caps=True))
        _add(bag, _wheel(0.055, 0.013, np.array([side * (x + 0.075), y + 0.27, 0.055])))
        bag.add(
            "aid-steel", rod([(side * (x + 0.018), y - 0.17, 0.34), (side * (x + 0.022), y + 0.20, 0.38)], 0.009, 8)
        )
    for height, share in ((0.70, 0.19), (0.42, 0.22)):
        bag.add("aid-steel", rod([(-x - 0.012, y + share, height), (x + 0.012, y + share, height)], 0.011, 8))
    return bag


def dog(step: int, steps: int) -> Bag:
    """Build a dog of a retriever's size that walks.

    Args:
        step: instant of the walk, of ``steps`` in its cycle.
    """
    bag = Bag()

    def limb(points: object, radii: list[float], flat: float = 1.0) -> Surface:
        path = _curve(points, 4 * len(radii))
        size = np.interp(np.linspace(0.0, 1.0, len(path)), np.linspace(0.0, 1.0, len(radii)), radii)
        tube = rod(path, size, 22, caps=True)
        places = tube.positions.copy()
        middle = path.mean(axis=0)[0]
        places[:, 0] = middle + flat * (places[:, 0] - middle)
        return _at(renormalled(Surface(places, tube.normals, tube.uvs, tube.faces)), _DOG)

    trunk = [(0, -0.36, 0.47), (0, -0.24, 0.475), (0, -0.05, 0.46), (0, 0.12, 0.45), (0, 0.26, 0.46), (0, 0.36, 0.49)]
    bag.add("aid-fur", limb(trunk, [0.03, 0.095, 0.122, 0.120, 0.114, 0.114, 0.130, 0.146, 0.148, 0.115, 0.04], 0.80))
    bag.add(
        "aid-fur",
        limb([(0, 0.24, 0.52), (0, 0.35, 0.60), (0, 0.43, 0.69)], [0.06, 0.115, 0.100, 0.088, 0.080, 0.05], 0.85),
    )
    bag.add(
        "aid-fur",
        limb(
            [(0, 0.36, 0.71), (0, 0.42, 0.735), (0, 0.49, 0.725), (0, 0.53, 0.70)],
            [0.02, 0.064, 0.082, 0.084, 0.078, 0.060, 0.03],
        ),
    )
    bag.add(
        "aid-muzzle",
        limb([(0, 0.49, 0.705), (0, 0.56, 0.685), (0, 0.625, 0.675)], [0.056, 0.048, 0.044, 0.040, 0.022], 0.9),
    )
    bag.add(
        "aid-fur",
        limb([(0, -0.35, 0.50), (0, -0.46, 0.47), (0, -0.56, 0.40), (0, -0.62, 0.38)], [0.042, 0.036, 0.028, 0.012]),
    )
    bag.add("aid-collar", _at(torus(0.088, 0.012, 28, 8), _DOG + [0.0, 0.335, 0.585], -48.0))
    bag.add(
        "aid-nose",
        pillow((0.018, 0.012, 0.013), squareness=0.8, sides=12, levels=7).moved(
            turned(0, 0.0, _DOG + [0, 0.648, 0.684])
        ),
    )
    for side in (-1.0, 1.0):
        ear = pillow((0.014, 0.040, 0.062), squareness=0.9, sides=16, levels=9)
        bag.add("aid-fur", _at(ear, _DOG + [side * 0.078, 0.405, 0.705], side * 16.0, 1))
        bag.add(
            "aid-nose",
            pillow((0.010, 0.010, 0.011), squareness=1.0, sides=10, levels=7).moved(
                turned(0, 0.0, _DOG + [side * 0.044, 0.522, 0.735])
            ),
        )
        # A walking dog moves the legs of one side half a cycle before those of the other.
        for hind, offset in ((False, 0.0), (True, 0.25)):
            phase = 2.0 * np.pi * (step / steps + offset + (0.5 if side > 0.0 else 0.0))
            swing, lift = 0.09 * np.sin(phase), 0.05 * max(0.0, np.cos(phase))
            x = side * 0.085
            if hind:
                path = [
                    (x, -0.25, 0.54),
                    (x, -0.20 + 0.4 * swing, 0.30),
                    (x, -0.33 + 0.8 * swing, 0.17 + lift),
                    (x, -0.29 + swing, 0.03 + lift),
                ]
                bag.add("aid-fur", limb(path, [0.02, 0.085, 0.098, 0.080, 0.052, 0.034, 0.026, 0.024, 0.030], 0.72))
            else:
                path = [
                    (x, 0.25, 0.53),
                    (x, 0.22 + 0.3 * swing, 0.28),
                    (x, 0.24 + 0.8 * swing, 0.14 + lift),
                    (x, 0.25 + swing, 0.03 + lift),
                ]
                bag.add("aid-fur", limb(path, [0.02, 0.072, 0.074, 0.054, 0.038, 0.031, 0.027, 0.025, 0.030], 0.8))
            toe = path[-1]
            paw = pillow((0.033, 0.048, 0.028), squareness=0.8, sides=16, levels=7)
            bag.add("aid-fur", _at(paw, _DOG + [toe[0], toe[1] + 0.022, toe[2] - 0.002]))
    return bag


_BUILDERS: Final[Mapping[str, Callable[[], Bag]]] = MappingProxyType(
    {"stroller": stroller, "wheelchair": wheelchair, "walking-frame": walking_frame}
)
#: Poses with an aid that stands on the ground.
AIDED: Final = (*_BUILDERS, "dog")


#: Pose to the middles of the further circles of ground that it needs besides the person's own (`Manifest.reaches`).
REACHES: Final[Mapping[str, tuple[tuple[float, float], ...]]] = MappingProxyType(
    {
        "sitting": ((0.0, 0.55),),
        "kneeling": ((0.0, 0.35), (0.0, -0.35)),
        "wheelchair": ((0.0, 0.32),),
        "stroller": ((0.0, 0.70), (0.0, 1.10)),
        "bicycle": ((0.44, -0.35), (0.44, 0.24), (0.44, 0.83)),
        "crutches": ((0.0, 0.20),),
        "walking-frame": ((0.0, 0.35),),
        "box": ((0.0, 0.35),),
        "dog": ((0.46, 0.45), (0.46, 0.95)),
    }
)


@lru_cache(maxsize=32)
def aid(pose: str, step: int, steps: int) -> tuple[Mesh, ...]:
    """Return the meshes of a pose's aid, one per material, in the figure's frame.

    Args:
        pose: one of `AIDED`.
        step: instant of the walk, of ``steps``; only a dog's legs follow it.
    """
    return (dog(step, steps) if pose == "dog" else _BUILDERS[pose]()).meshes()
