"""Furniture of roads and car parks: crash barriers, delineator posts, grass, a shelter for trolleys."""

from __future__ import annotations

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, quads, repeat, sheet, tubes, unit
from urban_street.street.plan import Placement

#: Section of a beam of W shape in front of its posts: metres towards the road, and up.
_BEAM = np.array([
    (0.02, 0.44), (0.055, 0.46), (0.095, 0.475), (0.095, 0.52), (0.03, 0.555), (0.03, 0.635), (0.095, 0.67), (0.095, 0.715),
    (0.055, 0.73), (0.02, 0.75),
])  # fmt: skip
#: Distance of posts, and length of a sloping end, metres.
_POST_M, _RAMP_M = 2.0, 4.0


def crash_barrier(placement: Placement) -> Bag:
    """Build a steel beam on posts along y, facing +x; its size is (length,). The ends slope to the ground."""
    length = placement.size[0]
    bag = Bag()
    y = np.unique(
        np.concatenate([np.linspace(0.0, length, max(round(length / 2.0), 2) + 1), [_RAMP_M, length - _RAMP_M]])
    )
    drop = np.maximum(np.maximum(_RAMP_M - y, y - (length - _RAMP_M)), 0.0) / _RAMP_M
    z = _BEAM[None, :, 1] - 0.68 * drop[:, None]
    beam = np.stack([np.broadcast_to(_BEAM[None, :, 0], z.shape), np.broadcast_to(y[:, None], z.shape), z], -1)
    bag.add("galvanised", sheet(beam), sheet(beam - np.array([0.004, 0.0, 0.0]), flip=True))
    posts = np.arange(0.5 * _POST_M, length, _POST_M)
    tops = 0.72 - 0.68 * np.interp(posts, y, drop)
    low = np.stack([np.full_like(posts, -0.09), posts - 0.05, np.full_like(posts, -0.3)], -1)
    bag.add("galvanised", boxes(low, np.stack([np.full_like(posts, 0.02), posts + 0.05, tops], -1), skip=("-z",)))
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
    count, blades = int(wide * long * density), 14
    root = np.repeat(rng.random((count, 2)) * [wide, long], blades, axis=0)
    size = np.repeat(high * rng.lognormal(-0.25, 0.45, count).clip(0.25, 2.0), blades) * rng.uniform(
        0.5, 1.1, count * blades
    )
    turn = rng.uniform(0.0, 2.0 * np.pi, count * blades)
    lean = rng.uniform(0.15, 0.75, count * blades)
    out = np.stack([np.cos(turn), np.sin(turn)], -1)
    foot = np.concatenate(
        [root + 0.35 * size[:, None] * out * rng.random((len(out), 1)), np.full((len(out), 1), -0.02)], -1
    )
    tip = foot + np.concatenate([out * lean[:, None], np.ones((len(out), 1))], -1) * size[:, None]
    side = np.stack([-out[:, 1], out[:, 0], np.zeros(len(out))], -1) * (0.003 + 0.014 * size[:, None])
    bag = Bag()
    bag.add("grass", _triangles(np.stack([foot - side, foot + side, tip], 1), rng))
    return bag


def board(placement: Placement) -> Bag:
    """Build a board of (width, height) that faces −y, its lower edge at the origin. Its variant is a cell."""
    wide, high = placement.size
    cell = float(placement.variant)
    corners = np.array(
        [[-0.5 * wide, -0.03, 0.0], [0.5 * wide, -0.03, 0.0], [0.5 * wide, -0.03, high], [-0.5 * wide, -0.03, high]]
    )
    uvs = np.array([[0.0, cell + 1.0], [1.0, cell + 1.0], [1.0, cell], [0.0, cell]]) / [1.0, 2.0]
    bag = Bag()
    bag.add("exit-board", quads([corners], [uvs]))
    bag.add("galvanised", quads([(corners + np.array([0.0, 0.02, 0.0]))[::-1]]))
    return bag


def warning_triangle() -> Bag:
    """Build a folding triangle of red reflectors on wire feet, facing −y."""
    bag = Bag()
    corners = np.array([(-0.25, 0.0, 0.06), (0.25, 0.0, 0.06), (0.0, 0.0, 0.49)])
    middle = corners.mean(axis=0)
    inner = middle + 0.62 * (corners - middle)
    following = [1, 2, 0]
    ring = np.stack([corners, corners[following], inner[following], inner], 1)
    bag.add("reflector-red", quads(ring), quads((ring + np.array([0.0, 0.012, 0.0]))[:, ::-1]))
    bag.add(
        "steel",
        tubes([[[x, -0.16, 0.01], [x, 0.0, 0.07], [x, 0.16, 0.01]] for x in (-0.18, 0.18)], np.full((2, 3), 0.006), 5),
    )
    return bag


def trolley_shelter() -> Bag:
    """Build a shelter of 2.3 m × 4.6 m for shopping trolleys: hoops, rails, a curved roof, and two rows of trolleys along y."""
    bag = Bag()
    half, long = 1.15, 2.3
    angle = np.linspace(0.0, np.pi, 13)
    arc = np.stack([-half * np.cos(angle), 0 * angle, 2.0 + 0.42 * np.sin(angle)], -1)
    hoop = np.concatenate([[[-half, 0.0, 0.0]], arc, [[half, 0.0, 0.0]]])
    hoops = np.stack([hoop + np.array([0.0, y, 0.0]) for y in (-long, -0.77, 0.77, long)])
    bag.add("steel", tubes(hoops, np.full(hoops.shape[:2], 0.028), 9))
    rails = [[[x, -long, z], [x, long, z]] for x in (-half, half) for z in (0.35, 0.95)]
    bag.add("steel", tubes(rails, np.full((4, 2), 0.02), 8))
    roof = np.stack([arc + np.array([0.0, y, 0.03]) for y in (-long - 0.15, long + 0.15)])
    bag.add("lens", sheet(roof, flip=True), sheet(roof - np.array([0.0, 0.0, 0.008])))
    for x in (-0.52, 0.52):
        for k in range(9):
            bag.merge(_trolley(), _moved(x, -1.55 + 0.33 * k))
    return bag


def _trolley() -> Bag:
    """Build a shopping trolley of 1 m that points to +y: a basket of wires on a frame with castors, a handle with a grip."""
    bag = Bag()
    half, low, high = 0.27, 0.45, 0.98
    wires = []
    for share in np.linspace(0.0, 1.0, 6):
        z, wide, front = low + (high - low) * share, half - 0.06 * (1.0 - share), 0.42 + 0.06 * share
        wires += [[[-wide, -0.42, z], [-wide + 0.03, front, z]], [[wide, -0.42, z], [wide - 0.03, front, z]],
                  [[-wide + 0.03, front, z], [wide - 0.03, front, z]], [[-wide, -0.42, z], [wide, -0.42, z]]]  # fmt: skip
    for x in np.linspace(-half, half, 8):
        wires += [[[0.78 * x, 0.42, low], [x * 0.9, 0.48, high]], [[0.78 * x, -0.42, low], [0.78 * x, 0.42, low]]]
    for y in np.linspace(-0.42, 0.44, 9):
        wires += [[[side * (half - 0.06), y, low], [side * half, y, high]] for side in (-1.0, 1.0)]
    bag.add("galvanised", tubes(wires, np.full((len(wires), 2), 0.0035), 4))
    frame = [[[side * 0.22, -0.45, 1.02], [side * 0.22, -0.38, 0.2], [side * 0.19, 0.45, 0.16]] for side in (-1.0, 1.0)]
    bag.add("steel", tubes(frame, np.full((2, 3), 0.012), 6))
    bag.add("bin-1", tubes([[[-0.27, -0.47, 1.03], [0.27, -0.47, 1.03]]], np.full((1, 2), 0.018), 8))
    wheel = boxes([[-0.015, -0.05, 0.0]], [[0.015, 0.05, 0.11]])
    bag.add("tyre", repeat(wheel, [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.38, 0.42)]))
    return bag


def _moved(x: float, y: float) -> Floats:
    matrix = np.eye(4)
    matrix[:2, 3] = x, y
    return matrix


def _triangles(corners: Floats, rng: np.random.Generator) -> Surface:
    """Return one-coloured triangles (N, 3, 3) that are lit like the ground they stand on."""
    up = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * 0.6 + np.array([0.0, 0.0, 0.08]))
    up = unit(up + np.array([0.0, 0.0, 1.2]))
    return Surface(
        corners.reshape(-1, 3), np.repeat(up, 3, axis=0), np.repeat(rng.random((len(corners), 2)), 3, axis=0),
        np.arange(3 * len(corners)).reshape(-1, 3),
    )  # fmt: skip
