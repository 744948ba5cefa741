"""Furniture of roads outside towns: crash barriers, delineator posts, grass."""

from __future__ import annotations

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, quads, repeat, sheet, unit
from urban_street.street.plan import Placement

#: Section of a beam of W shape in front of its posts: metres towards the road, and up.
_BEAM = np.array([
    (0.02, 0.44), (0.055, 0.46), (0.095, 0.475), (0.095, 0.52), (0.03, 0.555), (0.03, 0.635), (0.095, 0.67), (0.095, 0.715),
    (0.055, 0.73), (0.02, 0.75),
])  # fmt: skip
_POST_M = 2.0


def crash_barrier(placement: Placement) -> Bag:
    """Build a steel beam on posts along y, facing +x; its size is (length,). The ends bend away from the road."""
    length = placement.size[0]
    bag = Bag()
    y = np.unique(np.concatenate([np.linspace(0.0, length, max(round(length / 2.0), 2) + 1), [0.9, length - 0.9]]))
    flare = np.maximum(np.maximum(0.9 - y, y - (length - 0.9)), 0.0) / 0.9
    x = _BEAM[None, :, 0] - 0.25 * flare[:, None] ** 2
    beam = np.stack([x, np.broadcast_to(y[:, None], x.shape), np.broadcast_to(_BEAM[None, :, 1], x.shape)], -1)
    bag.add("galvanised", sheet(beam), sheet(beam - np.array([0.004, 0.0, 0.0]), flip=True))
    posts = np.arange(1.0, length - 0.5, _POST_M)
    post = boxes([[-0.09, -0.05, -0.3]], [[0.02, 0.05, 0.72]], skip=("-z",))
    bag.add("galvanised", repeat(post, np.stack([0 * posts, posts, 0 * posts], -1)))
    return bag


def delineator() -> Bag:
    """Build a white plastic post of 1 m with a slanted black band, and a reflector towards −y."""
    bag = Bag()
    ring = np.array([(-0.06, 0.05), (-0.045, -0.055), (0.045, -0.055), (0.06, 0.05)])

    def shell(low: float, high: float) -> Surface:
        near, far = (np.concatenate([ring, np.full((4, 1), z)], -1) for z in (low, high))
        following = np.roll(np.arange(4), -1)
        return quads(np.stack([near, near[following], far[following], far], 1))

    bag.add("delineator", shell(-0.1, 0.68), shell(0.90, 1.0))
    bag.add("frame-dark", shell(0.68, 0.90))
    bag.add("delineator", quads([np.concatenate([ring, np.full((4, 1), 1.0)], -1)]))
    bag.add("reflector", boxes([[-0.022, -0.062, 0.70]], [[0.022, -0.054, 0.88]]))
    bag.add("reflector", boxes([[-0.022, 0.049, 0.70]], [[0.022, 0.056, 0.88]]))
    return bag


def tufts(placement: Placement) -> Bag:
    """Build grass on a strip along y; its size is (width, length, height, tufts per square metre)."""
    wide, long, high, density = placement.size
    rng = np.random.default_rng(placement.seed)
    count, blades = int(wide * long * density), 9
    root = np.repeat(rng.random((count, 2)) * [wide, long], blades, axis=0)
    size = np.repeat(high * rng.lognormal(-0.25, 0.45, count).clip(0.25, 2.0), blades) * rng.uniform(0.5, 1.1, count * blades)
    turn = rng.uniform(0.0, 2.0 * np.pi, count * blades)
    lean = rng.uniform(0.15, 0.75, count * blades)
    out = np.stack([np.cos(turn), np.sin(turn)], -1)
    foot = np.concatenate([root + 0.35 * size[:, None] * out * rng.random((len(out), 1)), np.full((len(out), 1), -0.02)], -1)
    tip = foot + np.concatenate([out * lean[:, None], np.ones((len(out), 1))], -1) * size[:, None]
    side = np.stack([-out[:, 1], out[:, 0], np.zeros(len(out))], -1) * (0.006 + 0.03 * size[:, None])
    bag = Bag()
    bag.add("grass", _triangles(np.stack([foot - side, foot + side, tip], 1), rng))
    return bag


def _triangles(corners: Floats, rng: np.random.Generator) -> Surface:
    """Return one-coloured triangles (N, 3, 3) that are lit like the ground they stand on."""
    up = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * 0.6 + np.array([0.0, 0.0, 0.08]))
    up = unit(up + np.array([0.0, 0.0, 1.2]))
    return Surface(
        corners.reshape(-1, 3), np.repeat(up, 3, axis=0), np.repeat(rng.random((len(corners), 2)), 3, axis=0),
        np.arange(3 * len(corners)).reshape(-1, 3),
    )  # fmt: skip
