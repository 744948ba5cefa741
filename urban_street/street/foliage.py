"""Foliage as cards: bent squares with a drawn spray of leaves each, what lies between the leaves cut out.

Wood grows to the foot of every card, so no leaf floats. Cards are bent along and across and turned at random about their twigs,
so that no crown shows edges of flat squares from any side.
"""

from __future__ import annotations

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, lathe, repeat, tubes, unit
from urban_street.street.species import Species
from urban_street.street.textures.sprays import CELLS
from urban_street.street.wood import build_wood

_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
_UP = np.array([0.0, 0.0, 1.0])
#: Height of a trunk's lowest ring, metres: below the ground, since trunks lean.
_FOOT = -0.06
#: Widths of a card at its foot, middle and tip as shares of its side: sprays leave the corners empty.
_WIDTHS = (0.36, 0.94, 0.70)
#: Share of a crown's radius within which leaves are shade leaves.
_SHADE = 0.62


def build_tree(species: Species, rng: np.random.Generator, kind: str) -> Bag:
    """Build one tree with its foot at the origin. Materials: ``bark-of-<kind>``, ``spray-<kind>``, ``spray-<kind>-shade``.

    Args:
        species: its shape.
        rng: source of its random choices.
        kind: its name in `species.SPECIES`.
    """
    shape = species.shape
    feet, outward, inside = _crown(species, rng)
    bag = build_wood(shape, feet, rng, bark=f"bark-of-{kind}", leader=species.leader, foot=_FOOT)
    count = shape.leaves
    feet, outward, inside = (np.repeat(part, count, axis=0) for part in (feet, outward, inside))
    lift = -species.hang + rng.normal(0.0, 0.25, len(feet))
    along = unit(outward + lift[:, None] * _UP + rng.normal(0.0, 0.45, outward.shape))
    facing = outward * rng.uniform(0.2, 1.0, (len(feet), 1)) + 0.6 * _UP + rng.normal(0.0, 0.55, outward.shape)
    side = shape.leaf * rng.uniform(0.8, 1.15, len(feet))
    light = unit(outward + 0.35 * _UP)
    shaded = inside < _SHADE
    for mask, name in ((~shaded, f"spray-{kind}"), (shaded, f"spray-{kind}-shade")):
        if mask.any():
            bag.add(name, cards(feet[mask], along[mask], facing[mask], side[mask], light[mask], rng))
    if species.stakes:
        _add_stakes(bag, shape.fork)
    return bag


def cards(
    feet: Floats, along: Floats, facing: Floats, side: Floats, light: Floats, rng: np.random.Generator
) -> Surface:
    """Build bent cards, each with one of the drawn sprays, mirrored at random.

    Args:
        feet: (N, 3) places of the twigs' feet, metres.
        along: (N, 3) unit directions of the twigs.
        facing: (N, 3) directions that the upper sides roughly face.
        side: (N,) length of the edges, metres.
        light: (N, 3) unit directions out of the foliage, towards which normals lean, so that it is shaded as one mass.
        rng: source of the random choices.
    """
    count = len(feet)
    across = unit(np.cross(along, facing))
    normal = np.cross(across, along)
    # The upper side looks out of the foliage, so that both sides of a card are lit from where they are seen.
    inward = np.sum(normal * light, axis=1, keepdims=True) < 0.0
    across, normal = np.where(inward, -across, across), np.where(inward, -normal, normal)
    u, v = (grid.ravel() for grid in np.meshgrid((-0.5, 0.0, 0.5), (0.0, 0.5, 1.0)))
    u *= np.repeat(_WIDTHS, 3)
    bend, fold = rng.uniform(-0.05, 0.32, (count, 1)), rng.uniform(0.05, 0.30, (count, 1))
    sink = bend * v**2 + fold * np.abs(2.0 * u)
    points = feet[:, None] + side[:, None, None] * (
        v[:, None] * along[:, None] + u[:, None] * across[:, None] - sink[..., None] * normal[:, None]
    )
    # The slopes of the fold turn the normals outwards, as round bunches of leaves would.
    tilt = normal[:, None] + 0.8 * (2.0 * u)[:, None] * across[:, None] + 0.5 * (v - 0.4)[:, None] * along[:, None]
    normals = unit(unit(tilt) + 1.3 * light[:, None])
    cell = rng.integers(0, CELLS, (count, 2))
    mirror = rng.choice([-1.0, 1.0], (count, 1))
    uvs = (np.stack([cell[:, :1] + 0.5 + mirror * u, cell[:, 1:] + 1.0 - np.broadcast_to(v, (count, 9))], -1)) / CELLS
    square = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [3, 4, 7], [3, 7, 6], [4, 5, 8], [4, 8, 7]])
    faces = (np.arange(count) * 9)[:, None, None] + square
    return Surface(points.reshape(-1, 3), normals.reshape(-1, 3), uvs.reshape(-1, 2), faces.reshape(-1, 3))


def clad(low: Floats, high: Floats, per_square_metre: float, leaf: float, rng: np.random.Generator) -> Bag:
    """Build a box of clipped greenery: a dark core, and cards that stand out of all sides but the lower.

    Cards show dozens of leaves each, so there are far fewer of them than ``per_square_metre``.
    """
    side = 3.5 * leaf
    size, level = high - low, np.array([1.0, 1.0, 0.0])
    # Cards reach out by half their side.
    inset = np.minimum(0.5 * side, 0.35 * size)
    core = np.minimum(inset + 0.08, 0.4 * size)
    bag = Bag()
    bag.add("hedge-core", boxes([low + core * level], [high - core], skip=("-z",)))
    normals = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    areas = np.abs(normals) @ (np.prod(size) / size)
    face = rng.choice(5, max(int(areas.sum() * (40.0 + 0.12 * per_square_metre)), 1), p=areas / areas.sum())
    normal = normals[face]
    first, last = low + inset * level, high - inset
    place = first + rng.random((len(face), 3)) * (last - first)
    place = np.where(normal < 0.0, first, np.where(normal > 0.0, last, place))
    along = unit(0.3 * normal + 0.5 * _UP + rng.normal(0.0, 0.6, normal.shape))
    reach = np.full(len(face), side) * rng.uniform(0.8, 1.1, len(face))
    bag.add(
        "spray-hedge",
        cards(place - 0.5 * side * along, along, normal + 0.3 * _UP, reach, unit(normal + 0.2 * _UP), rng),
    )
    return bag


def _crown(species: Species, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Return the feet of twigs, (N, 3), mostly near the outline of an uneven crown, their unit directions outwards, and their
    distance from the axis as a share of the outline's.
    """
    shape = species.shape
    count, card = shape.clusters, shape.leaf
    heights, radii = np.array(species.crown).T
    even = np.linspace(0.0, 1.0, 200)
    outline = np.interp(even, heights, radii)
    share = np.cumsum(outline + 0.12)
    height = np.interp((np.arange(count) + rng.uniform(0.0, 1.0, count)) / count, share / share[-1], even)
    azimuth = np.arange(count) * _GOLDEN_ANGLE + rng.normal(0.0, 0.25, count) + rng.uniform(0.0, 2.0 * np.pi)
    flat = np.stack([np.cos(azimuth), np.sin(azimuth), 0.0 * azimuth], -1)
    rise = np.gradient(outline, even)
    slope = np.interp(height, even, rise) * shape.radius / (shape.height - shape.fork)
    outward = unit(flat - np.clip(slope, -3.0, 1.5)[:, None] * _UP)
    lobes = unit(rng.normal(size=(8, 3)) * [1.0, 1.0, 0.7])
    bulge = 0.70 + 0.34 * np.max((unit(flat + (2.0 * height[:, None] - 1.0) * _UP) @ lobes.T) ** 5, axis=1)
    inside = rng.uniform(0.1, 1.0, count) ** 0.5
    reach = (shape.radius - 0.5 * card) * np.interp(height, even, outline) * bulge * inside
    top, bottom = shape.height - 0.6 * card, shape.fork + 0.1
    feet = flat * reach[:, None] + (bottom + (top - bottom) * height)[:, None] * _UP
    return feet, outward, inside


def _add_stakes(bag: Bag, fork: float) -> None:
    """Add three stakes with crossbars and straps around the trunk."""
    high = min(fork - 0.25, 1.75)
    angle = np.arange(3) * 2.0 * np.pi / 3.0 + 0.4
    ring = 0.34 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], -1)
    bag.add("stake", repeat(lathe([(0.035, 0.0), (0.035, high), (0.0, high + 0.02)], 8), ring))
    ends = np.stack([ring, np.roll(ring, 1, axis=0)], 1) + np.array([0.0, 0.0, high - 0.12])
    bag.add("stake", tubes(ends, 0.028, 6))
    straps = np.stack([ring, 0.05 * unit(ring)], 1) + np.array([0.0, 0.0, high - 0.25])
    bag.add("strap", tubes(straps, 0.018, 6))
