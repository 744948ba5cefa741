"""Surfaces and primitives: boxes, sheets, tubes, surfaces of revolution, extrusions.

All primitives are batched: one call builds all window frames of a house. Coordinates are metres in the object's frame (z up).
Normals point out of the solid, faces are counter-clockwise seen from outside, and texture coordinates are metres divided by the
texture's tile size, with v downwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.scene.graph.model import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles without a material.

    Attributes:
        positions: (V, 3) metres.
        normals: (V, 3) unit normals.
        uvs: (V, 2) texture coordinates.
        faces: (F, 3) indices.
    """

    positions: Floats
    normals: Floats
    uvs: Floats
    faces: Ints

    def moved(self, matrix: Floats) -> Surface:
        """Return the surface after a (4, 4) affine map that preserves handedness."""
        linear = matrix[:3, :3]
        normals = self.normals @ np.linalg.inv(linear)
        return Surface(self.positions @ linear.T + matrix[:3, 3], unit(normals), self.uvs, self.faces)

    def selected(self, mask: NDArray[np.bool_]) -> Surface:
        """Return only the faces with a true ``mask``, (F,), and the vertices that they use."""
        faces = self.faces[mask]
        vertices, compact = np.unique(faces, return_inverse=True)
        return Surface(self.positions[vertices], self.normals[vertices], self.uvs[vertices], compact.reshape(-1, 3))

    def textured(self, uvs: Floats) -> Surface:
        """Return the same triangles with other texture coordinates."""
        return Surface(self.positions, self.normals, uvs, self.faces)


@dataclass(slots=True)
class Bag:
    """Surfaces by material, in order of first use. They become one mesh per material."""

    surfaces: dict[str, list[Surface]] = field(default_factory=dict)

    def add(self, material: str, *surfaces: Surface) -> None:
        self.surfaces.setdefault(material, []).extend(surfaces)

    def merge(self, other: Bag, matrix: Floats | None = None) -> None:
        """Add the surfaces of another bag, transformed by ``matrix`` if not None."""
        for material, surfaces in other.surfaces.items():
            self.add(material, *(surfaces if matrix is None else [surface.moved(matrix) for surface in surfaces]))

    def meshes(self) -> tuple[Mesh, ...]:
        """Return one mesh per material, without empty surfaces."""
        merged = ((material, merge(surfaces)) for material, surfaces in self.surfaces.items())
        return tuple(to_mesh(surface, material) for material, surface in merged if len(surface.faces))


def to_mesh(surface: Surface, material: str) -> Mesh:
    """Return the surface as a mesh of the scene."""
    return Mesh(
        surface.positions.astype(np.float32),
        unit(surface.normals).astype(np.float32),
        surface.uvs.astype(np.float32),
        surface.faces.astype(np.uint32),
        material,
    )


def unit(vectors: Floats) -> Floats:
    """Return (…, 3) vectors scaled to length 1. A zero vector becomes +z."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), np.array([0.0, 0.0, 1.0]))


def pose(x: float, y: float, z: float, heading: float = 0.0) -> Floats:
    """Return the (4, 4) transform of a turn by ``heading`` (radians, counter-clockwise from above), then of a move."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def merge(surfaces: Iterable[Surface]) -> Surface:
    """Return all surfaces as one."""
    parts = list(surfaces)
    if not parts:
        return Surface(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 3), np.int64))
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    return Surface(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uvs for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )


def repeat(surface: Surface, offsets: ArrayLike) -> Surface:
    """Return copies of a surface, one at each of the (N, 3) offsets."""
    where = np.asarray(offsets, np.float64).reshape(-1, 3)
    count, size = len(where), len(surface.positions)
    return Surface(
        (surface.positions[None] + where[:, None]).reshape(-1, 3),
        np.tile(surface.normals, (count, 1)),
        np.tile(surface.uvs, (count, 1)),
        (surface.faces[None] + (np.arange(count) * size)[:, None, None]).reshape(-1, 3),
    )


def quads(corners: ArrayLike, uvs: ArrayLike | None = None, *, tile: float = 1.0) -> Surface:
    """Build flat quadrilaterals.

    Args:
        corners: (N, 4, 3), counter-clockwise seen from outside.
        uvs: (N, 4, 2); by default metres along the first edge (u) and down across it (v), divided by ``tile``.
        tile: metres per texture repeat.
    """
    points = np.asarray(corners, np.float64).reshape(-1, 4, 3)
    normals = unit(np.cross(points[:, 2] - points[:, 0], points[:, 3] - points[:, 1]))
    if uvs is None:
        along = unit(points[:, 1] - points[:, 0])
        up = np.cross(normals, along)
        u = np.einsum("nkc,nc->nk", points, along) / tile
        v = -np.einsum("nkc,nc->nk", points, up) / tile
        coordinates = np.stack([u, v], -1)
    else:
        coordinates = np.asarray(uvs, np.float64).reshape(-1, 4, 2)
    count = len(points)
    faces = (np.arange(count) * 4)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return Surface(
        points.reshape(-1, 3), np.repeat(normals, 4, axis=0), coordinates.reshape(-1, 2), faces.reshape(-1, 3)
    )


#: Corners of the unit cube's faces, counter-clockwise from outside, with a horizontal first edge if there is one.
_FACES = {
    "-x": ((0, 1, 0), (0, 0, 0), (0, 0, 1), (0, 1, 1)),
    "+x": ((1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)),
    "-y": ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)),
    "+y": ((1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1)),
    "-z": ((0, 1, 0), (1, 1, 0), (1, 0, 0), (0, 0, 0)),
    "+z": ((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
}


def boxes(low: ArrayLike, high: ArrayLike, *, skip: Sequence[str] = (), tile: float = 1.0) -> Surface:
    """Build axis-aligned boxes between the (N, 3) corners ``low`` and ``high``, without the faces named in ``skip``."""
    lower = np.asarray(low, np.float64).reshape(-1, 1, 1, 3)
    upper = np.asarray(high, np.float64).reshape(-1, 1, 1, 3)
    corners = np.array([_FACES[name] for name in _FACES if name not in skip], np.float64)[None]
    return quads((lower + (upper - lower) * corners).reshape(-1, 4, 3), tile=tile)


def sheet(points: ArrayLike, uvs: ArrayLike | None = None, *, closed: bool = False, flip: bool = False) -> Surface:
    """Build a smooth surface over an (M, N, 3) grid of points.

    Normals point along d/drow × d/dcolumn, or to the other side with ``flip``. With ``closed`` the last row joins the first,
    and ``uvs`` have one row more, (M + 1, N, 2), since the seam needs both values.
    """
    grid = np.asarray(points, np.float64)
    if closed:
        grid = np.concatenate([grid, grid[:1]])
    rows, columns = grid.shape[:2]
    flat = grid.reshape(-1, 3)
    faces = _grid_faces(rows, columns, flip=flip)
    corners = flat[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    weights = np.repeat(area, 3, axis=0)
    sums = [np.bincount(faces.ravel(), weights[:, k], len(flat)) for k in range(3)]
    normals = np.asarray(np.stack(sums, -1), np.float64)
    if closed:
        normals[:columns] += normals[-columns:]
        normals[-columns:] = normals[:columns]
    coordinates = np.zeros((len(flat), 2)) if uvs is None else np.asarray(uvs, np.float64).reshape(-1, 2)
    solid = np.linalg.norm(area, axis=1) > 1e-12
    return Surface(flat, unit(normals), coordinates, faces[solid])


def _grid_faces(rows: int, columns: int, *, flip: bool) -> Ints:
    """Return the triangles of a grid of vertices, row by row, ((rows − 1)(columns − 1)·2, 3)."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], -1).reshape(-1, 3)
    return faces[:, ::-1] if flip else faces


def tubes(paths: ArrayLike, radii: ArrayLike, sides: int, *, tile: tuple[float, float] = (1.0, 1.0)) -> Surface:
    """Build round tubes without caps along (N, M, 3) polylines with (N, M) radii.

    ``tile`` is the texture's extent in metres around and along.
    """
    centre = np.asarray(paths, np.float64)
    radius = np.broadcast_to(np.asarray(radii, np.float64), centre.shape[:2])
    count, steps = centre.shape[:2]
    tangent = unit(_slope(centre))
    # A fixed direction per tube, far from parallel to its pieces, keeps the rings from twisting.
    chord = unit(centre[:, -1] - centre[:, 0])
    helper = np.where(np.abs(chord[:, 2:]) < 0.75, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))[:, None]
    side = unit(np.cross(helper, tangent))
    up = np.cross(tangent, side)
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    normals = side[:, :, None] * np.cos(angle)[:, None] + up[:, :, None] * np.sin(angle)[:, None]
    points = centre[:, :, None] + normals * radius[:, :, None, None]
    length = np.linalg.norm(np.diff(centre, axis=1), axis=-1)
    along = np.concatenate([np.zeros((count, 1)), np.cumsum(length, axis=1)], axis=1)
    around = angle / (2.0 * np.pi) * np.maximum(np.round(2.0 * np.pi * radius[:, :1] / tile[0]), 1.0)[:, :, None]
    uvs = np.stack(np.broadcast_arrays(around, -along[:, :, None] / tile[1]), -1)
    tube = _grid_faces(steps, sides + 1, flip=True)
    faces = (tube[None] + (np.arange(count) * steps * (sides + 1))[:, None, None]).reshape(-1, 3)
    return Surface(points.reshape(-1, 3), normals.reshape(-1, 3), uvs.reshape(-1, 2), faces)


def _slope(line: Floats) -> Floats:
    """Return differences along axis 1, (N, M, 3): central inside, one-sided at the ends."""
    ends = np.concatenate([line[:, :1], line, line[:, -1:]], axis=1)
    return np.asarray(ends[:, 2:] - ends[:, :-2])


def lathe(profile: ArrayLike, sides: int, *, tile: float = 1.0) -> Surface:
    """Build a surface of revolution about z from an (M, 2) profile of (radius, z).

    The outside is to the right of the profile's direction: away from the axis for an upward profile.
    """
    line = np.asarray(profile, np.float64)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    radius, height = line[:, 0], line[:, 1]
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    points = np.concatenate(
        [ring[:, None] * radius[None, :, None], np.broadcast_to(height[None, :, None], (sides, len(line), 1))], -1
    )
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    turns = np.linspace(0.0, 1.0, sides + 1) * 2.0 * np.pi * float(radius.max()) / tile
    uvs = np.stack(np.broadcast_arrays(turns[:, None], -along[None] / tile), -1)
    return sheet(points, uvs, closed=True)


def extrude(profile: ArrayLike, start: float, stop: float, *, tile: float = 1.0) -> Surface:
    """Build flat strips along x from ``start`` to ``stop`` with an open (M, 2) profile of (y, z), closed at both ends.

    The outside is to the left of the profile's direction seen from +x. For a moulding on a wall that faces −y, the profile thus
    runs from the wall's foot outwards and up. The ends are fans, so the profile should be nearly convex.
    """
    line = np.asarray(profile, np.float64)
    lower, upper = line[:-1], line[1:]

    def at(x: float, yz: Floats) -> Floats:
        return np.concatenate([np.full((len(yz), 1), x), yz], -1)

    strips = quads(np.stack([at(start, lower), at(stop, lower), at(stop, upper), at(start, upper)], 1), tile=tile)
    return merge([strips, fan(at(stop, line[::-1]), tile=tile), fan(at(start, line), tile=tile)])


def fan(outline: ArrayLike, *, tile: float = 1.0, uvs: ArrayLike | None = None) -> Surface:
    """Build a flat convex polygon from its (N, 3) outline, counter-clockwise seen from outside."""
    points = np.asarray(outline, np.float64)
    following = np.roll(points, -1, axis=0)
    normal = unit(np.cross(points, following).sum(axis=0)[None])
    along = unit((points[1] - points[0])[None])[0]
    if uvs is None:
        coordinates = np.stack([points @ along, -(points @ np.cross(normal[0], along))], -1) / tile
    else:
        coordinates = np.asarray(uvs, np.float64)
    last = np.arange(1, len(points) - 1)
    faces = np.stack([np.zeros_like(last), last, last + 1], -1)
    return Surface(points, np.repeat(normal, len(points), axis=0), coordinates, faces)
