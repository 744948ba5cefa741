"""Operations on polygon surfaces as linear maps on vertex attributes: subdivide, cut, smooth.

A map is a sparse (new vertices, old vertices) matrix, so that the same cut applies to positions, skinning weights and texture
coordinates.
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
        matrix: sparse (V', V); ``matrix @ attribute`` maps any vertex attribute.
        faces: (F', 3 or 4) int64.
    """

    matrix: Any
    faces: Indices


def triangles(quads: Indices) -> Indices:
    """Split (F, 4) quads along their first diagonal into (T, 3) triangles, without degenerate ones."""
    both = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    keep = (both[:, 0] != both[:, 1]) & (both[:, 1] != both[:, 2]) & (both[:, 0] != both[:, 2])
    solid: Indices = both[keep]
    return solid


def compact(faces: Indices, count: int) -> Mapped:
    """Drop the vertices, ``count`` in all, that no face uses."""
    vertices, inverse = np.unique(faces, return_inverse=True)
    rows = np.arange(len(vertices))
    matrix = sparse.csr_matrix((np.ones(len(vertices)), (rows, vertices)), shape=(len(vertices), count))
    return Mapped(matrix, inverse.reshape(faces.shape))


def edges_of(faces: Indices) -> tuple[Indices, Indices]:
    """Return undirected edges, (E, 2), lower index first, ascending; and the edge index of every face side, (F, n)."""
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
    low_high = np.sort(sides.reshape(-1, 2), axis=1)
    base = int(faces.max()) + 1 if faces.size else 1
    keys, inverse = np.unique(low_high[:, 0] * base + low_high[:, 1], return_inverse=True)
    return np.stack([keys // base, keys % base], axis=1), inverse.reshape(faces.shape)


def subdivide(quads: Indices, count: int) -> Mapped:
    """Apply one Catmull–Clark step (Catmull and Clark 1978, doi:10.1016/0010-4485(78)90110-0) to ``count`` vertices.

    Boundary edges follow the cubic B-spline rule. The new vertices are the old ones, then edge points, then face points.
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
    vertex_points = (
        sparse.diags((~on_boundary).astype(np.float64)) @ smooth + sparse.diags(on_boundary.astype(np.float64)) @ crease
    )
    matrix = sparse.vstack([vertex_points, edge_points, face_points]).tocsr()

    edge_of_side = sides + count
    face_point = np.arange(number_of_faces) + count + number_of_edges
    small = [np.stack([quads[:, k], edge_of_side[:, k], face_point, edge_of_side[:, k - 1]], axis=1) for k in range(4)]
    return Mapped(matrix, np.stack(small, axis=1).reshape(-1, 4))


def clip(faces: Indices, field: Points, *, snap: float = 0.3) -> Mapped:
    """Keep the part of a triangle surface with ``field`` ≤ 0, with a clean edge along field = 0.

    Args:
        faces: (F, 3).
        field: (V,) values at the vertices, linear along edges.
        snap: crossings closer to a vertex than this share of the edge move the vertex onto the cut, so that no slivers
            are left.
    """
    count = len(field)
    edges, _ = edges_of(faces)
    a, b = edges.T
    crossing = (field[a] > 0.0) != (field[b] > 0.0)
    a, b = a[crossing], b[crossing]
    share = field[a] / (field[a] - field[b])
    # A vertex moves along the edge with its nearest crossing.
    near = np.concatenate([a, b])
    far = np.concatenate([b, a])
    distance = np.concatenate([share, 1.0 - share])
    order = np.argsort(distance, kind="stable")
    order = order[distance[order] < snap]
    _, first = np.unique(near[order], return_index=True)
    nearest = order[first]
    moved = _shifted(count, near[nearest], far[nearest], distance[nearest])
    values = field.copy()
    values[near[nearest]] = 0.0

    inside = values <= 0.0
    corners = inside[faces]
    whole = faces[corners.all(axis=1) & (values[faces] < 0.0).any(axis=1)]
    crossed = faces[corners.any(axis=1) & ~corners.all(axis=1)]
    cuts: dict[tuple[int, int], int] = {}
    pieces: list[tuple[int, int, int]] = []

    def cut(p: int, q: int) -> int:
        return cuts.setdefault((min(p, q), max(p, q)), count + len(cuts))

    for triangle in crossed.tolist():
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
    crossings = sparse.csr_matrix((weights.ravel(), (rows, new.ravel())), shape=(len(new), count)) @ moved
    everything = np.concatenate([whole, np.array(pieces, np.int64).reshape(-1, 3)])
    small = compact(everything, count + len(new))
    return Mapped(small.matrix @ sparse.vstack([moved, crossings]), small.faces)


def vertex_normals(points: Points, faces: Indices) -> Points:
    """Return (V, 3) unit normals, area-weighted over the triangles or quads around each vertex."""
    # the cross product of the diagonals is twice a quad's area; of two sides, a triangle's
    if faces.shape[1] == 4:
        normals = np.cross(points[faces[:, 2]] - points[faces[:, 0]], points[faces[:, 3]] - points[faces[:, 1]])
    else:
        normals = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    total: Points = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(normals[:, axis], faces.shape[1]), minlength=len(points))
            for axis in range(3)
        ],
        axis=1,
    )
    return normalize(total, fallback=(0.0, 0.0, 1.0))


def normalize(vectors: Points, *, fallback: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Points:
    """Return unit vectors along the last axis. A vector without length becomes ``fallback``."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), np.array(fallback))


def neighbours(faces: Indices, count: int) -> Any:
    """Return a sparse (V, V) matrix whose rows average the vertices that share an edge."""
    edges, _ = edges_of(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    matrix = sparse.csr_matrix((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(count, count))
    degree = np.maximum(np.asarray(matrix.sum(axis=1)).ravel(), 1.0)
    return sparse.diags(1.0 / degree) @ matrix


def boundary_loops(faces: Indices) -> list[Indices]:
    """Return closed boundary loops as ordered vertex indices, in the direction of the faces' sides, longest first."""
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
    """Return a sparse (G, V) matrix whose rows average each group's vertices."""
    rows = np.repeat(np.arange(len(groups)), groups.shape[1])
    values = np.full(groups.size, 1.0 / groups.shape[1])
    return sparse.csr_matrix((values, (rows, groups.ravel())), shape=(len(groups), count))


def even_edges(points: Points, faces: Indices, rounds: int = 8) -> Points:
    """Smooth the open edges: each of their vertices moves towards its two neighbours."""
    even = points.copy()
    for loop in boundary_loops(faces):
        for _ in range(rounds):
            edge = even[loop]
            even[loop] = edge + 0.25 * (np.roll(edge, 1, axis=0) + np.roll(edge, -1, axis=0) - 2.0 * edge)
    return even


def unweld(faces: Indices, corner_uvs: Points, *, wraps: bool = True) -> tuple[Indices, Points, Indices]:
    """Give every corner its texture coordinate. Vertices are doubled along seams.

    Args:
        faces: (F, 3).
        corner_uvs: (F, 3, 2) texture coordinates of each face's corners.
        wraps: True if u has period 1; a face across the wrap then gets coordinates beyond 1.

    Returns:
        (V',) old vertex of each new vertex, (V', 2) its texture coordinates, (F, 3) new faces.
    """
    uvs = corner_uvs.copy()
    if wraps:
        across = np.ptp(uvs[..., 0], axis=1) > 0.5
        low = across[:, None] & (uvs[..., 0] < 0.5)
        uvs[..., 0] += low
    # One number combines coordinates between −2 and 6, in millionths, with the vertex.
    u, v = (np.round(uvs.reshape(-1, 2) * 1e6).astype(np.int64) + 2_000_000).T
    keys = (faces.ravel() * 8_000_000 + u) * 8_000_000 + v
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return faces.ravel()[first], uvs.reshape(-1, 2)[first], inverse.reshape(faces.shape)


def strip(first: Indices, second: Indices) -> Indices:
    """Return the triangles, (2·n, 3), between two closed rings of equal length. They face left of the first ring's direction.

    A ring that follows a surface's own sides (`boundary_loops`) gets a strip that continues the surface.
    """
    p, q, r, s = first, np.roll(first, -1), second, np.roll(second, -1)
    return np.concatenate([np.stack([q, p, r], axis=1), np.stack([q, r, s], axis=1)])


def simplify(points: Points, faces: Indices, target: int, *, locked: NDArray[np.bool_] | None = None) -> Mapped:
    """Collapse short, flat edges until about ``target`` triangles are left. Open edges keep their vertices.

    Independent edges collapse to their middles in rounds, cheapest first. The cost of an edge is its length, increased where
    the surface bends.
    """
    count = len(points)
    matrix = sparse.identity(count, format="csr")
    current, keep_out = points, np.zeros(count, bool) if locked is None else locked.copy()
    for _ in range(12):
        surplus = (len(faces) - target) // 2
        if surplus <= 0:
            break
        edges, sides = edges_of(faces)
        uses = np.bincount(sides.ravel(), minlength=len(edges))
        fixed = keep_out.copy()
        fixed[edges[uses != 2].ravel()] = True
        pairs = _collapsible(current, faces, edges, fixed, min(surplus, len(faces) // 8))
        if len(pairs) == 0:
            break
        step = _shifted(len(current), pairs[:, 0], pairs[:, 1], np.full(len(pairs), 0.5))
        goal = np.arange(len(current))
        goal[pairs[:, 1]] = pairs[:, 0]
        merged = goal[faces]
        alive = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 0] != merged[:, 2])
        small = compact(merged[alive], len(current))
        forward = small.matrix @ step
        keep_out = (small.matrix @ keep_out.astype(np.float64)) > 0.5
        matrix, current, faces = forward @ matrix, forward @ current, small.faces
    return Mapped(matrix, faces)


def _collapsible(
    points: Points, faces: Indices, edges: Indices, fixed: NDArray[np.bool_], number: int
) -> NDArray[np.int64]:
    """Return up to ``number`` edges, cheapest first, whose neighbourhoods do not touch."""
    count = len(points)
    normals = vertex_normals(points, faces)
    free = ~fixed[edges].any(axis=1)
    a, b = edges.T
    length = np.linalg.norm(points[b] - points[a], axis=1)
    bend = np.abs(1.0 - np.einsum("ij,ij->i", normals[a], normals[b]))
    cost = length * (1.0 + 100.0 * bend)
    ring: list[list[int]] = [[] for _ in range(count)]
    for p, q in zip(*edges.T.tolist(), strict=True):
        ring[p].append(q)
        ring[q].append(p)
    blocked = bytearray(count)
    pairs: list[tuple[int, int]] = []
    limit = np.sort(cost[free])[min(6 * number, int(free.sum()) - 1)] if free.any() else 0.0
    candidates = np.flatnonzero(free & (cost <= limit))
    cheapest = edges[candidates[np.argsort(cost[candidates], kind="stable")]]
    for p, q in zip(*cheapest.T.tolist(), strict=True):
        # the link condition: more than two common neighbours would pinch the surface
        if blocked[p] or blocked[q] or len(set(ring[p]).intersection(ring[q])) != 2:
            continue
        for k in (*ring[p], *ring[q]):
            blocked[k] = 1
        pairs.append((p, q))
        if len(pairs) == number:
            break
    return np.array(pairs, np.int64).reshape(-1, 2)


def _shifted(count: int, vertices: Indices, others: Indices, shares: Points) -> Any:
    """Return a sparse (count, count) identity, except that ``vertices`` move by ``shares`` of the way to ``others``."""
    diagonal = np.ones(count)
    diagonal[vertices] = 1.0 - shares
    return (sparse.diags(diagonal) + sparse.csr_matrix((shares, (vertices, others)), shape=(count, count))).tocsr()
