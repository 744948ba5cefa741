"""Shoes: uppers cut from the feet of the second skin, on soles lofted along each foot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from urban_street.human import surface
from urban_street.human.body import Body
from urban_street.human.clothing import SecondSkin, share
from urban_street.human.surface import Indices, Points

_FOOT = ("foot", "ball", "calf")


@dataclass(frozen=True, slots=True)
class ShoeCut:
    """The cut of a shoe, in metres.

    Attributes:
        height: height of the opening above the foot's sole.
        sole: thickness under the ball of the foot.
        heel: thickness under the heel.
        ease: room around the foot.
        welt: overhang of the sole.
    """

    height: float = 0.075
    sole: float = 0.018
    heel: float = 0.026
    ease: float = 0.006
    welt: float = 0.004


@dataclass(frozen=True, slots=True, eq=False)
class ShoePart:
    """A part of a shoe in the rest pose.

    Attributes:
        points: (V, 3) metres; weights: (V, bones); faces: (F, 3).
        uvs: (V, 2), across (0.5 on top of the foot) and along (0 heel … 1 toe).
    """

    points: Points
    weights: Points
    faces: Indices
    uvs: Points


def build_shoe(cut: ShoeCut, body: Body, skin: SecondSkin, side: str, ground: float) -> tuple[ShoePart, ShoePart]:
    """Build upper and sole of one shoe.

    Args:
        side: ``l`` or ``r``.
        ground: height of the bare foot's sole in the rest pose, metres.
    """
    own = share(skin.weights, _FOOT, f"_{side}") > 0.5
    faces = surface.triangles(skin.quads)
    # The opening rises slightly towards the back, as in real shoes.
    heel = body.head(f"foot_{side}")[1] - 0.04
    opening = ground + cut.height + 0.12 * np.clip(heel - skin.rest[:, 1], 0.0, 0.1)
    piece = surface.clip(faces, np.where(own, skin.rest[:, 2] - opening, 1.0))
    points, weights = piece.matrix @ skin.rest, piece.matrix @ skin.weights
    smooth = surface.neighbours(piece.faces, len(points))
    normals = surface.vertex_normals(points, piece.faces)
    for _ in range(4):
        normals = surface.normalize(smooth @ normals)
    points = points + cut.ease * normals
    edge = np.unique(np.concatenate(surface.boundary_loops(piece.faces)))
    loose = np.ones(len(points))
    loose[edge] = 0.0
    for factor in (0.6, -0.5) * 6:  # leather bridges hollows
        points = points + (factor * loose)[:, None] * (smooth @ points - points)
    points[:, 2] = np.maximum(points[:, 2], ground - 0.002)
    middle, forward, length = _axis(points, body, side)
    upper = ShoePart(points, weights, piece.faces, _upper_uvs(points, middle, forward, length))
    return _turn_in(upper), _sole(cut, upper, middle, forward, length, ground)


def _axis(points: Points, body: Body, side: str) -> tuple[Points, Points, float]:
    """Return the heel's end, the direction to the toes (both with z = 0), and the length."""
    direction = (body.tail(f"ball_{side}") - body.head(f"foot_{side}")) * np.array([1.0, 1.0, 0.0])
    forward = surface.normalize(direction)
    along = points @ forward
    ankle = body.head(f"foot_{side}") * np.array([1.0, 1.0, 0.0])
    return ankle + (along.min() - ankle @ forward) * forward, forward, float(np.ptp(along))


def _upper_uvs(points: Points, heel: Points, forward: Points, length: float) -> Points:
    right = np.array([forward[1], -forward[0], 0.0])
    offset = points - heel
    across, up = offset @ right, points[:, 2] - points[:, 2].min()
    return np.stack([0.5 + np.arctan2(across, up + 0.005) / np.pi, offset @ forward / length], axis=1)


def _turn_in(upper: ShoePart) -> ShoePart:
    """Add an edge of 4 mm and an inside to the opening."""
    loop = surface.boundary_loops(upper.faces)[0]
    normals = surface.vertex_normals(upper.points, upper.faces)[loop]
    edge = upper.points[loop]
    down = np.array([0.0, 0.0, -1.0])
    rings = [edge, edge - 0.004 * normals, edge - 0.005 * normals + 0.02 * down]
    count, size = len(upper.points), len(loop)
    ids = [np.arange(count + k * size, count + (k + 1) * size) for k in range(3)]
    return ShoePart(
        points=np.concatenate([upper.points, *rings]),
        weights=np.concatenate([upper.weights, *[upper.weights[loop]] * 3]),
        faces=np.concatenate([upper.faces, surface.strip(ids[0], ids[1]), surface.strip(ids[1], ids[2])]),
        uvs=np.concatenate([upper.uvs, *[upper.uvs[loop]] * 3]),
    )


def _sole(cut: ShoeCut, upper: ShoePart, heel: Points, forward: Points, length: float, ground: float) -> ShoePart:
    """Return a closed slab under the upper, with an outline from the upper's width at 26 places along the foot."""
    right = np.array([forward[1], -forward[0], 0.0])
    low = upper.points[upper.points[:, 2] < ground + 0.03]
    along, across = (low - heel) @ forward, (low - heel) @ right
    # cosine spacing rounds both ends
    stations = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 26))
    place = stations * length
    left = np.array([across[np.abs(along - p) < 0.012].min() for p in place])
    side = np.array([across[np.abs(along - p) < 0.012].max() for p in place])
    taper = np.sqrt(np.clip(1.0 - ((2.0 * stations - 1.0) ** 2) ** 5, 0.0, 1.0))
    centre = 0.5 * (left + side)
    half = (0.5 * (side - left) + cut.welt) * taper
    ends = place + cut.welt * (2.0 * stations - 1.0)
    outline_along = np.concatenate([ends, ends[-2:0:-1]])
    outline_across = np.concatenate([centre + half, (centre - half)[-2:0:-1]])
    flat = heel[:2] + outline_along[:, None] * forward[:2] + outline_across[:, None] * right[:2]
    share_along = np.clip(outline_along / length, 0.0, 1.0)
    bottom = ground - np.interp(share_along, [0.0, 0.3, 0.55, 1.0], [cut.heel, cut.heel, cut.sole, cut.sole])
    bottom = bottom + 0.012 * np.clip((share_along - 0.78) / 0.22, 0.0, 1.0) ** 2  # toe spring
    top = np.full_like(bottom, ground + 0.006)
    shrunk = flat.mean(axis=0) + 0.97 * (flat - flat.mean(axis=0))
    rings = [
        np.column_stack([shrunk, top]),
        np.column_stack([flat, top - 0.002]),
        np.column_stack([flat, bottom + 0.003]),
        np.column_stack([shrunk, bottom]),
    ]
    size = len(flat)
    # Edges between top, wall and bottom are sharp, so each surface has its own rings.
    points = np.concatenate([rings[0], rings[0], rings[1], rings[1], rings[2], rings[2], rings[3], rings[3]])
    ids = [np.arange(k * size, (k + 1) * size) for k in range(8)]
    faces = [surface.strip(ids[a], ids[b]) for a, b in ((1, 2), (3, 4), (5, 6))]
    faces += [_cap(ids[0]), _cap(ids[7])[:, ::-1]]
    weights = upper.weights[cKDTree(upper.points).query(points)[1]]
    uvs = np.stack([np.linspace(0.0, 1.0, 8)[np.repeat(np.arange(8), size)], np.tile(share_along, 8)], axis=1)
    return ShoePart(points, weights, np.concatenate(faces), uvs)


def _cap(ring: Indices) -> Indices:
    """Return triangles across an outline that runs up one side and down the other."""
    half = len(ring) // 2
    right, left = ring[: half + 1], np.concatenate([ring[:1], ring[: half - 1 : -1]])
    faces = []
    for k in range(half):
        faces += [(right[k], right[k + 1], left[k + 1]), (right[k], left[k + 1], left[k])]
    table = np.array(faces, np.int64)
    keep = (table[:, 0] != table[:, 1]) & (table[:, 1] != table[:, 2]) & (table[:, 0] != table[:, 2])
    triangles: Indices = table[keep]
    return triangles
