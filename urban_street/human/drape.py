"""Cloth: garments that settle on a posed body.

Position-based dynamics (Müller et al. 2007, doi:10.1016/j.jvcir.2007.01.005) with Jacobi iterations: threads resist stretching,
yield to compression, which forms folds, and stay outside the body. The number of steps is fixed and the arrays are float64, so
the result is a pure function of its input.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from urban_street.human.surface import Indices, Points, edges_of, even_edges, neighbours, vertex_normals

#: Distance that separates the surfaces of different regions in the lookup of the nearest point, metres.
_REGION_STEP: Final = 10.0
#: Fall per step, metres. It is far below gravity's (g/60² = 2.7 mm), since a few Jacobi iterations would let heavy cloth
#: stretch. Only the settled shape matters.
_FALL: Final = 0.00015
_DAMPING: Final = 0.85
_REACH: Final = 0.03


@dataclass(frozen=True, slots=True)
class Fabric:
    """The properties of a cloth.

    Attributes:
        stretch: share of a thread's excess length that one iteration removes.
        compression: the same share of missing length; low values fold easily.
        bending: the same share for the distance of opposite corners of two triangles; high values are stiff.
        thickness: distance of the cloth from the surface under it, metres.
        friction: share of the sideways motion that contact removes.
        steps: iterations of motion and contact.
    """

    stretch: float = 0.9
    compression: float = 0.12
    bending: float = 0.1
    thickness: float = 0.006
    friction: float = 0.4
    steps: int = 40


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """The surface that the cloth lies on.

    Attributes:
        points, normals: (N, 3) a dense sample of the surface, normals outwards.
        regions: (N,) int64. Cloth collides only with its own region, so that an arm does not push the trunk's cloth.
    """

    points: Points
    normals: Points
    regions: Indices


def settle(
    start: Points,
    rest: Points,
    faces: Indices,
    pinned: NDArray[np.bool_],
    regions: Indices,
    under: Obstacle,
    fabric: Fabric,
) -> Points:
    """Let a garment settle.

    Args:
        start: (V, 3) initial positions in the pose, e.g. by skinning.
        rest: (V, 3) the garment's own shape, which gives the lengths of its threads.
        faces: (F, 3).
        pinned: (V,) vertices that do not move.
        regions: (V,) int64, see `Obstacle`.
        under: the body, and the clothes below.

    Returns:
        (V, 3) settled positions, everywhere at least ``fabric.thickness`` off the obstacle (as sampled).
    """
    threads, sides = edges_of(faces)
    opposite = _opposite_corners(faces, sides, len(threads))
    pairs = np.concatenate([threads, opposite])
    lengths = np.linalg.norm(rest[pairs[:, 0]] - rest[pairs[:, 1]], axis=1)
    bends = np.arange(len(pairs)) >= len(threads)
    longer = np.where(bends, fabric.bending, fabric.stretch)
    shorter = np.where(bends, fabric.bending, fabric.compression)
    a, b = np.ascontiguousarray(pairs.T)
    degree = np.maximum(np.bincount(pairs.ravel(), minlength=len(rest)), 1) / 3.0  # Jacobi, over-relaxed
    first, second = (
        sparse.csr_matrix((np.ones(len(end)), (end, np.arange(len(end)))), shape=(len(rest), len(end)))
        for end in (a, b)
    )
    free = ~pinned
    tree = cKDTree(_with_region(under.points, under.regions))
    position, previous = start.copy(), start.copy()
    fall = np.array([0.0, 0.0, -_FALL])
    nearest = np.asarray(tree.query(_with_region(position, regions))[1], np.int64)
    for step in range(fabric.steps):
        position, previous = (
            np.where(free[:, None], position + _DAMPING * (position - previous) + fall, position),
            position,
        )
        # Axes come first, since whole rows are several times faster to gather and sum than triples.
        axes = np.ascontiguousarray(position.T)
        for _ in range(3):
            delta = axes.take(b, axis=1) - axes.take(a, axis=1)
            x, y, z = delta * delta
            length = np.maximum(np.sqrt(x + y + z), 1e-9)
            excess = (length - lengths) / length
            pull = 0.5 * excess * np.where(excess > 0.0, longer, shorter) * delta
            move = np.stack([first @ axis - second @ axis for axis in pull]) / degree
            np.add(axes, move, out=axes, where=free)
        position = np.ascontiguousarray(axes.T)
        if step % 3 == 0:
            nearest = np.asarray(tree.query(_with_region(position, regions))[1], np.int64)
        own = under.regions[nearest] == regions
        position, previous = _push_out(position, previous, under, nearest, fabric, free & own)
    smooth = neighbours(faces, len(rest))
    for factor in (0.5, -0.52, 0.5, -0.52):  # Taubin smoothing removes the iterations' noise and keeps the folds.
        position[free] += (factor * (smooth @ position - position))[free]
    position = np.where(free[:, None], even_edges(position, faces), position)  # hems are stiff
    for _ in range(3):
        nearest = np.asarray(tree.query(_with_region(position, regions))[1], np.int64)
        own = under.regions[nearest] == regions
        position, previous = _push_out(position, position, under, nearest, fabric, own)
    return position


def outside_normals(points: Points, faces: Indices, regions: Indices) -> Obstacle:
    """Return a surface's vertices as an obstacle."""
    return Obstacle(points, vertex_normals(points, faces), regions)


def _push_out(
    position: Points, previous: Points, under: Obstacle, nearest: Indices, fabric: Fabric, movable: NDArray[np.bool_]
) -> tuple[Points, Points]:
    normal = under.normals[nearest]
    offset = position - under.points[nearest]
    height = np.einsum("ij,ij->i", offset, normal)
    # The plane of the nearest point is meaningless far to its side.
    aside = np.linalg.norm(offset - height[:, None] * normal, axis=1)
    touching = movable & (height < fabric.thickness) & (aside < _REACH)
    position = position.copy()
    position[touching] += ((fabric.thickness - height)[:, None] * normal)[touching]
    motion = position - previous
    sideways = motion - np.einsum("ij,ij->i", motion, normal)[:, None] * normal
    position[touching] -= (fabric.friction * sideways)[touching]
    return position, previous


def _with_region(points: Points, regions: Indices) -> Points:
    return np.concatenate([points, _REGION_STEP * regions[:, None]], axis=1)


def _opposite_corners(faces: Indices, sides: Indices, number_of_edges: int) -> Indices:
    """Return the two corners opposite each inner edge, (B, 2)."""
    order = np.argsort(sides.ravel(), kind="stable")
    edge = sides.ravel()[order]
    corner = np.roll(faces, -2, axis=1).ravel()[order]  # the corner that is not on side k
    uses = np.bincount(edge, minlength=number_of_edges)
    first = np.concatenate([[0], np.cumsum(uses)[:-1]])[uses == 2]
    return np.stack([corner[first], corner[first + 1]], axis=1)
