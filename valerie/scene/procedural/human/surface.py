"""Operations on polygon surfaces, each a linear map on vertex attributes: subdivide, cut, smooth.

A map is a sparse (new vertices, old vertices) matrix, so that the same cut applies to positions, skinning weights and
texture coordinates alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Points = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """A surface derived from another one.

    Attributes:
        matrix: sparse (V', V); ``matrix @ attribute`` carries any vertex attribute over.
        faces: (F', 3 or 4) int64.
    """

    matrix: Any
    faces: Indices


def triangles(quads: Indices) -> Indices:
    """Split (F, 4) quads along their first diagonal into (T, 3) triangles; degenerate ones are left out."""
    both = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    keep = (both[:, 0] != both[:, 1]) & (both[:, 1] != both[:, 2]) & (both[:, 0] != both[:, 2])
    return both[keep]


def compact(faces: Indices, count: int) -> Mapped:
    """Drop the vertices, of ``count``, that no face uses."""
    used, inverse = np.unique(faces, return_inverse=True)
    rows = np.arange(len(used))
    matrix = sparse.csr_matrix((np.ones(len(used)), (rows, used)), shape=(len(used), count))
    return Mapped(matrix, inverse.reshape(faces.shape))


def edges_of(faces: Indices) -> tuple[Indices, Indices]:
    """Undirected edges (E, 2), lower index first, ascending; and the edge index of every face side (F, n)."""
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
    low_high = np.sort(sides.reshape(-1, 2), axis=1)
    edges, inverse = np.unique(low_high, axis=0, return_inverse=True)
    return edges, inverse.reshape(faces.shape)


def subdivide(quads: Indices, count: int) -> Mapped:
    """One Catmull–Clark step (Catmull and Clark 1978, doi:10.1016/0010-4485(78)90110-0) on ``count`` vertices.

    Boundary edges follow the cubic B-spline rule. New vertices: the old ones, then edge points, then face points.
    """
    edges, sides = edges_of(quads)
    number_of_faces, number_of_edges = len(quads), len(edges)
    face_points = _averages(quads, count)
    edge_middles = _averages(edges, count)
    uses = np.bincount(sides.ravel(), minlength=number_of_edges)
    inner = uses == 2
    edge_faces = sparse.csr_matrix(
        (np.ones(sides.size), (sides.ravel(), np.repeat(np.arange(number_of_faces), 4))),
        shape=(number_of_edges, number_of_faces),
    )
    half = sparse.diags(np.where(inner, 0.5, 1.0)) @ edge_middles
    edge_points = half + sparse.diags(np.where(inner, 0.25, 0.0)) @ edge_faces @ face_points

    incident_faces = np.bincount(quads.ravel(), minlength=count).astype(np.float64)
    valence = np.maximum(incident_faces, 1.0)
    vertex_faces = sparse.csr_matrix(
        (np.ones(quads.size), (quads.ravel(), np.repeat(np.arange(number_of_faces), 4))),
        shape=(count, number_of_faces),
    )
    vertex_edges = sparse.csr_matrix(
        (np.ones(edges.size), (edges.ravel(), np.repeat(np.arange(number_of_edges), 2))), shape=(count, number_of_edges)
    )
    on_boundary = np.zeros(count, bool)
    on_boundary[edges[~inner].ravel()] = True
    smooth = (
        sparse.diags(1.0 / valence**2) @ vertex_faces @ face_points
        + sparse.diags(2.0 / valence**2) @ vertex_edges @ edge_middles
        + sparse.diags((valence - 3.0) / valence)
    )
    boundary_edges = vertex_edges @ sparse.diags((~inner).astype(np.float64))
    crease = 0.25 * boundary_edges @ edge_middles + sparse.diags(np.full(count, 0.5))
    vertex_points = sparse.diags((~on_boundary).astype(np.float64)) @ smooth + sparse.diags(
        on_boundary.astype(np.float64)
    ) @ crease
    matrix = sparse.vstack([vertex_points, edge_points, face_points]).tocsr()

    edge_of_side = sides + count
    face_point = np.arange(number_of_faces) + count + number_of_edges
    small = [
        np.stack([quads[:, k], edge_of_side[:, k], face_point, edge_of_side[:, k - 1]], axis=1) for k in range(4)
    ]
    return Mapped(matrix, np.stack(small, axis=1).reshape(-1, 4))


def clip(faces: Indices, field: Points, *, snap: float = 0.3) -> Mapped:
    """Keep the part of a triangle surface where ``field`` ≤ 0, with a clean edge along field = 0.

    Args:
        faces: (F, 3).
        field: (V,) values at the vertices, linear along edges.
        snap: crossings closer to a vertex than this share of the edge move the vertex onto the cut, which leaves no slivers.
    """
    count = len(field)
    edges, _ = edges_of(faces)
    a, b = edges.T
    crossing = (field[a] > 0.0) != (field[b] > 0.0)
    a, b = a[crossing], b[crossing]
    share = field[a] / (field[a] - field[b])
    # a vertex moves along the edge whose crossing lies nearest to it
    near = np.concatenate([a, b])
    far = np.concatenate([b, a])
    distance = np.concatenate([share, 1.0 - share])
    order = np.argsort(distance, kind="stable")
    order = order[distance[order] < snap]
    _, first = np.unique(near[order], return_index=True)
    chosen = order[first]
    moved = sparse.identity(count, format="lil")
    values = field.copy()
    for vertex, other, part in zip(near[chosen], far[chosen], distance[chosen], strict=True):
        moved[vertex, vertex] = 1.0 - part
        moved[vertex, other] = part
    values[near[chosen]] = 0.0

    inside = values <= 0.0
    corners = inside[faces]
    kept = faces[corners.all(axis=1) & (values[faces] < 0.0).any(axis=1)]
    mixed = faces[corners.any(axis=1) & ~corners.all(axis=1)]
    cuts: dict[tuple[int, int], int] = {}
    pieces: list[tuple[int, int, int]] = []

    def cut(p: int, q: int) -> int:
        return cuts.setdefault((min(p, q), max(p, q)), count + len(cuts))

    for triangle in mixed.tolist():
        ring: list[int] = []
        for p, q in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            if inside[p]:
                ring.append(p)
            if (values[p] < 0.0 < values[q]) or (values[q] < 0.0 < values[p]):
                ring.append(cut(p, q))
        pieces.extend((ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1))
    new = np.array(list(cuts), np.int64).reshape(-1, 2)
    part = values[new[:, 0]] / (values[new[:, 0]] - values[new[:, 1]])
    rows = np.repeat(np.arange(len(new)), 2)
    weights = np.stack([1.0 - part, part], axis=1)
    added = sparse.csr_matrix((weights.ravel(), (rows, new.ravel())), shape=(len(new), count)) @ moved.tocsr()
    everything = np.concatenate([kept, np.array(pieces, np.int64).reshape(-1, 3)])
    small = compact(everything, count + len(new))
    return Mapped(small.matrix @ sparse.vstack([moved.tocsr(), added]), small.faces)


def vertex_normals(points: Points, faces: Indices) -> Points:
    """(V, 3) unit normals, area-weighted over the triangles or quads around each vertex."""
    # the cross product of the diagonals is twice a quad's area; of two sides, a triangle's
    if faces.shape[1] == 4:
        normals = np.cross(points[faces[:, 2]] - points[faces[:, 0]], points[faces[:, 3]] - points[faces[:, 1]])
    else:
        normals = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    total = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(normals[:, axis], faces.shape[1]), minlength=len(points))
            for axis in range(3)
        ],
        axis=1,
    )
    return normalize(total, fallback=(0.0, 0.0, 1.0))


def normalize(vectors: Points, *, fallback: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Points:
    """Unit vectors along the last axis; a vector without length becomes ``fallback``."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), np.array(fallback))


def neighbours(faces: Indices, count: int) -> Any:
    """Sparse (V, V) matrix whose rows average the vertices that share an edge."""
    edges, _ = edges_of(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    matrix = sparse.csr_matrix((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(count, count))
    degree = np.maximum(np.asarray(matrix.sum(axis=1)).ravel(), 1.0)
    return sparse.diags(1.0 / degree) @ matrix


def boundary_loops(faces: Indices) -> list[Indices]:
    """Closed boundary loops as ordered vertex indices, in the direction of the faces' own sides, longest first."""
    edges, sides = edges_of(faces)
    uses = np.bincount(sides.ravel(), minlength=len(edges))
    directed = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)[uses[sides] == 1]
    following = dict(directed.tolist())
    loops = []
    while following:
        start, current = next(iter(following.items()))
        del following[start]
        loop = [start]
        while current != start and current in following:
            loop.append(current)
            current = following.pop(current)
        loops.append(np.array(loop, np.int64))
    return sorted(loops, key=len, reverse=True)


def _averages(groups: Indices, count: int) -> Any:
    """Sparse (G, V) matrix whose rows average each group's vertices."""
    rows = np.repeat(np.arange(len(groups)), groups.shape[1])
    values = np.full(groups.size, 1.0 / groups.shape[1])
    return sparse.csr_matrix((values, (rows, groups.ravel())), shape=(len(groups), count))
