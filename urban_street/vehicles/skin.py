"""Trimmed surfaces: a smooth master surface over a plane domain, cut into panels along outlines.

A body is modelled as in a design studio: one smooth surface defines the sheet metal, and outlines on it define the borders of
doors and lamps. `cut` returns the triangles of such a region, and `flange` gives it an edge, so that a gap between two panels
is a real groove.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from urban_street.solids.surfaces import Bag, Floats, Ints, Surface, unit

#: Domain points closer than this are one point.
_WELD = 1e-7
#: Step of the finite differences for tangents, in domain units.
_STEP = 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class Master:
    """A smooth surface over a rectangle of the plane.

    Attributes:
        points: maps (N, 2) domain points to (N, 3) metres. d/da × d/db points outwards.
        low, high: corners of the domain.
        lines: grid lines of the untrimmed surface's triangles: values of a, values of b.
    """

    points: Callable[[Floats], Floats]
    low: tuple[float, float]
    high: tuple[float, float]
    lines: tuple[Floats, Floats]

    def normals(self, at: Floats) -> Floats:
        """Return the unit normals, (N, 3), at (N, 2) domain points, by central differences (one-sided on the border)."""
        steps = _STEP * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        ends = np.clip(at + steps[:, None], self.low, self.high)
        right, left, above, below = self.points(ends.reshape(-1, 2)).reshape(4, -1, 3)
        return unit(np.cross(right - left, above - below))

    def coarse(self, every: int = 3) -> Master:
        """Return the same surface with fewer lines, for barely visible parts."""
        along, across = (np.unique(np.append(lines[::every], lines[-1])) for lines in self.lines)
        return Master(self.points, self.low, self.high, (along, across))

    @property
    def domain(self) -> BaseGeometry:
        return shapely.box(*self.low, *self.high)


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A region of a master surface: its triangles, and its edge.

    Attributes:
        surface: triangles, with texture coordinates 0.
        rim: (E, 2) vertex indices of the border's edges, with the region on their left.
    """

    surface: Surface
    rim: Ints


def cut(master: Master, region: BaseGeometry, *, offset: float = 0.0) -> Patch:
    """Return the part of a master surface inside ``region`` (in its domain), moved ``offset`` metres along its normals."""
    corners = _triangles(master, region)
    flat = corners.reshape(-1, 2)
    a, b = np.round(flat / _WELD).astype(np.int64).T
    # One number per point is sorted much faster than a pair.
    _, first, inverse = np.unique((a << 32) + b, return_index=True, return_inverse=True)
    at = flat[first]
    faces = inverse.reshape(-1, 3)
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    if not len(faces):
        empty = np.zeros((0, 3))
        return Patch(Surface(empty, empty, np.zeros((0, 2)), faces), np.zeros((0, 2), np.int64))
    normals = master.normals(at)
    positions = master.points(at) + offset * normals
    return Patch(Surface(positions, normals, np.zeros((len(at), 2)), faces), _rim(faces))


def _triangles(master: Master, region: BaseGeometry) -> Floats:
    """Return counter-clockwise domain triangles, (M, 3, 2): whole cells of the grid inside, clipped cells along the outline."""
    if region.is_empty:
        return np.zeros((0, 3, 2))
    a0, b0, a1, b1 = region.bounds
    along, across = (
        _within(lines, low, high) for lines, low, high in zip(master.lines, (a0, b0), (a1, b1), strict=True)
    )
    left, lower = np.meshgrid(along[:-1], across[:-1], indexing="ij")
    right, upper = np.meshgrid(along[1:], across[1:], indexing="ij")
    cells = shapely.box(left.ravel(), lower.ravel(), right.ravel(), upper.ravel())
    shapely.prepare(region)
    inside = shapely.covers(region, cells)
    crossed = shapely.intersects(region, cells) & ~inside
    low = np.stack([left.ravel(), lower.ravel()], -1)[inside]
    high = np.stack([right.ravel(), upper.ravel()], -1)[inside]
    square = np.stack([low, np.stack([high[:, 0], low[:, 1]], -1), high, np.stack([low[:, 0], high[:, 1]], -1)], 1)
    corners = [square[:, [0, 1, 2]], square[:, [0, 2, 3]]]
    pieces = shapely.get_parts(shapely.intersection(region, cells[crossed]))
    pieces = pieces[(shapely.get_type_id(pieces) == 3) & (shapely.area(pieces) > 1e-9)]
    if len(pieces):
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(pieces))
        points = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
        sides = points[:, 1:] - points[:, :1]
        turn = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
        points = np.where((turn < 0.0)[:, None, None], points[:, ::-1], points)
        corners.append(points[np.abs(turn) > 1e-10])
    return np.concatenate(corners)


def _within(lines: Floats, low: float, high: float) -> Floats:
    """Return the grid lines that enclose an interval."""
    first = max(int(np.searchsorted(lines, low, "right")) - 1, 0)
    last = min(int(np.searchsorted(lines, high, "left")), len(lines) - 1)
    return lines[first : max(last, first + 1) + 1]


def _rim(faces: Ints) -> Ints:
    """Return the directed edges with a triangle on only one side, (E, 2)."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    size = int(faces.max()) + 1
    forward = edges[:, 0] * size + edges[:, 1]
    backward = edges[:, 1] * size + edges[:, 0]
    return edges[~np.isin(forward, backward)]


def flange(patch: Patch, depth: float, *, middle: bool = False) -> Surface:
    """Build a strip from the patch's border ``depth`` metres inwards, facing away from the patch.

    Args:
        patch: the patch with the border.
        depth: metres against the normals; negative to go outwards.
        middle: True to include the plane x = 0, at which the mirrored half continues.
    """
    points, normals = patch.surface.positions, patch.surface.normals
    rim = patch.rim
    if not middle and len(rim):
        rim = rim[~(np.abs(points[rim][..., 0]) < 2e-4).all(axis=1)]
    start, stop = points[rim[:, 0]], points[rim[:, 1]]
    inner_start, inner_stop = start - depth * normals[rim[:, 0]], stop - depth * normals[rim[:, 1]]
    corners = np.stack([start, inner_start, inner_stop, stop], 1).reshape(-1, 3)
    sideways = unit(np.cross(stop - start, normals[rim[:, 0]] + normals[rim[:, 1]])) * np.sign(depth)
    faces = (np.arange(len(rim)) * 4)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    faces = faces.reshape(-1, 3)
    if depth < 0.0:
        faces = faces[:, ::-1]
        sideways = -sideways
    return Surface(corners, np.repeat(sideways, 4, axis=0), np.zeros((len(corners), 2)), faces)


def mirrored(surface: Surface) -> Surface:
    """Return the mirror image at the plane x = 0."""
    flip = np.array([-1.0, 1.0, 1.0])
    return Surface(surface.positions * flip, surface.normals * flip, surface.uvs, surface.faces[:, ::-1])


def mirrored_bag(bag: Bag) -> Bag:
    """Return the mirror image of a bag."""
    other = Bag()
    for material, surfaces in bag.surfaces.items():
        other.add(material, *(mirrored(surface) for surface in surfaces))
    return other


def reversed_(surface: Surface) -> Surface:
    """Return the surface with its faces turned to the other side."""
    return Surface(surface.positions, -surface.normals, surface.uvs, surface.faces[:, ::-1])


def along_polyline(points: Floats, step: float) -> Floats:
    """Return points of a polyline, including its corners, at most ``step`` apart, (M, D)."""
    pieces = [points[:1]]
    for start, stop in pairwise(points):
        count = max(int(np.ceil(float(np.linalg.norm(stop - start)) / step)), 1)
        pieces.append(start + (stop - start) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)
