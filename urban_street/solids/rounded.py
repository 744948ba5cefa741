"""Small rounded solids: pillows, rods, rings, bars."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from urban_street.solids.surfaces import Floats, Surface, lathe, merge, sheet, tubes, unit


def turned(axis: int, degrees: float, at: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """Return the (4, 4) transform of a turn about one axis (0 x, 1 y, 2 z) through the origin, then of a move to ``at``."""
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = [k for k in range(3) if k != axis]
    matrix = np.eye(4)
    matrix[first, first] = matrix[second, second] = cos
    sign = -1.0 if axis == 1 else 1.0
    matrix[first, second], matrix[second, first] = -sign * sin, sign * sin
    matrix[:3, 3] = np.asarray(at, np.float64)
    return matrix


def pillow(half: Sequence[float], *, squareness: float = 0.35, sides: int = 16, levels: int = 7) -> Surface:
    """Build a rounded box around the origin: a superellipsoid with a ``squareness`` from 1 (ellipsoid) towards 0 (box)."""
    polar = np.linspace(-0.5 * np.pi, 0.5 * np.pi, levels)
    around = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)

    def power(value: Floats) -> Floats:
        return np.asarray(np.sign(value) * np.abs(value) ** squareness)

    ring = np.stack([power(np.cos(around)), power(np.sin(around))], -1)
    flat = np.maximum(power(np.cos(polar)), 0.0)
    points = np.concatenate(
        [ring[:, None] * flat[None, :, None], np.broadcast_to(power(np.sin(polar))[None, :, None], (sides, levels, 1))],
        -1,
    )
    return sheet(points * np.asarray(half, np.float64), closed=True)


def rod(path: ArrayLike, radius: float | ArrayLike, sides: int = 8, *, caps: bool = False) -> Surface:
    """Build a round bar along an (M, 3) polyline."""
    line = np.asarray(path, np.float64)
    radii = np.broadcast_to(np.asarray(radius, np.float64), len(line)).copy()
    if caps:
        first, last = unit(line[:1] - line[1:2])[0], unit(line[-1:] - line[-2:-1])[0]
        line = np.concatenate([[line[0] + 1e-4 * first], line, [line[-1] + 1e-4 * last]])
        radii = np.concatenate([[1e-5], radii, [1e-5]])
    return tubes(line[None], radii[None], sides)


def torus(radius: float, thickness: float, sides: int = 24, around: int = 8) -> Surface:
    """Build a ring about z."""
    angle = np.linspace(0.0, 2.0 * np.pi, around + 1)
    return lathe(np.stack([radius + thickness * np.cos(angle), thickness * np.sin(angle)], -1), sides)


def bar(outline: ArrayLike, low: float, high: float) -> Surface:
    """Build a prism along x over a closed convex (M, 2) outline of (y, z), counter-clockwise seen from +x; smooth around."""
    ring = np.asarray(outline, np.float64)
    points = np.stack([np.concatenate([np.full((len(ring), 1), x), ring], -1) for x in (low, high)], 1)
    wall = sheet(points, closed=True)
    ends = []
    for x, order in ((high, slice(None)), (low, slice(None, None, -1))):
        corner = np.concatenate([np.full((len(ring), 1), x), ring], -1)[order]
        middle = corner.mean(axis=0)
        fan = np.arange(len(ring))
        ends.append(
            Surface(
                np.concatenate([corner, middle[None]]),
                np.tile([1.0 if x == high else -1.0, 0.0, 0.0], (len(ring) + 1, 1)),
                np.zeros((len(ring) + 1, 2)),
                np.stack([fan, np.roll(fan, -1), np.full_like(fan, len(ring))], -1),
            )
        )
    return merge([wall, *ends])


def rounded_outline(half_y: float, half_z: float, radius: float, *, steps: int = 3) -> Floats:
    """Return a rectangle with rounded corners around the origin, (M, 2), counter-clockwise."""
    corners = []
    for k, (sy, sz) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = 0.5 * np.pi * (k + np.linspace(0.0, 1.0, steps + 1))
        corners.append(
            np.stack(
                [sy * (half_y - radius) + radius * np.cos(angle), sz * (half_z - radius) + radius * np.sin(angle)], -1
            )
        )
    return np.concatenate(corners)


def renormalled(surface: Surface) -> Surface:
    """Return a bent solid with the normals of its triangles."""
    corners = surface.positions[surface.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    _, group = np.unique(np.round(surface.positions, 6), axis=0, return_inverse=True)
    index = group[surface.faces.ravel()]
    sums = np.stack([np.bincount(index, np.repeat(area[:, k], 3), int(group.max()) + 1) for k in range(3)], -1)
    return Surface(surface.positions, unit(np.asarray(sums[group], np.float64)), surface.uvs, surface.faces)
