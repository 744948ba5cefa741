"""Build the ground of a place from its shapes: closed surfaces that meet vertex to vertex."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from urban_street.solids.surfaces import Bag, Floats, Surface, merge, quads
from urban_street.street.plan import Placement
from urban_street.street.shapes import Edge, Mark, Slab, Strip, Sweep
from urban_street.street.textures.surfacing import TILES

#: Width of the stone around a slab, size of its worn edge, and depth of its foot below the road, metres.
_KERB, _BEVEL, _FOOT = 0.18, 0.02, -0.03


def build_sweep(placement: Placement) -> Bag:
    """Build the strips of the placement's class. Pieces of all classes have the same corners along their common edges."""
    sweep = placement.shape
    assert isinstance(sweep, Sweep)
    bag = Bag()
    line = _Line(sweep.line)
    cuts = _cuts(sweep, line.length)
    left, low = _course(sweep.edge, cuts), 0.0
    for strip in sweep.strips:
        right = _course(strip.edge, cuts)
        if strip.object_class == placement.object_class:
            _add_strip(bag, line, cuts, (left, right), (low, strip.height), strip, sweep.marks)
        left, low = right, strip.height
    return bag


class _Line:
    """A line with its pieces' normals, mitred at the corners."""

    def __init__(self, corners: tuple[tuple[float, float], ...]) -> None:
        self._points = np.asarray(corners, np.float64)
        pieces = np.diff(self._points, axis=0)
        lengths = np.linalg.norm(pieces, axis=1)
        self._along = np.concatenate([[0.0], np.cumsum(lengths)])
        right = np.stack([pieces[:, 1], -pieces[:, 0]], -1) / lengths[:, None]
        both = np.concatenate([right[:1], right[:-1] + right[1:], right[-1:]])
        both[1:-1] /= (both[1:-1] * right[1:]).sum(axis=1, keepdims=True)
        self._right = both
        self.length = float(self._along[-1])

    def at(self, along: Floats, across: Floats) -> Floats:
        """Return the places, (N, 2), at metres along the line and metres to its right."""
        columns = [np.interp(along, self._along, part[:, k]) for part in (self._points, self._right) for k in (0, 1)]
        return np.stack([columns[0] + across * columns[2], columns[1] + across * columns[3]], -1)


def _course(edge: Edge, cuts: Floats) -> Floats:
    """Return an edge's distance from the line at every cut."""
    if isinstance(edge, tuple):
        knots = np.asarray(edge)
        return np.asarray(np.interp(cuts, knots[:, 0], knots[:, 1]))
    return np.full_like(cuts, edge)


def _cuts(sweep: Sweep, length: float) -> Floats:
    """Return where all strips are cut across: at even steps, ends of markings, and bends of edges."""
    knots = [end for mark in sweep.marks for end in mark.along]
    knots += [s for strip in sweep.strips if isinstance(strip.edge, tuple) for s, _ in strip.edge]
    even = np.linspace(0.0, length, max(int(np.ceil(length / sweep.step)), 1) + 1)
    cuts = np.unique(np.round(np.concatenate([even, [k for k in knots if 0.0 < k < length]]), 4))
    return np.asarray(cuts[np.concatenate([[True], np.diff(cuts) > 1e-3])])


def _add_strip(
    bag: Bag, line: _Line, cuts: Floats, edges: tuple[Floats, Floats], heights: tuple[float, float], strip: Strip,
    marks: tuple[Mark, ...],
) -> None:  # fmt: skip
    left, right = edges
    low, high = left.max() + 1e-3, right.min() - 1e-3
    mine = [mark for mark in marks if mark.across[0] < high and mark.across[1] > low]
    inner = sorted({round(t, 4) for mark in mine for t in mark.across if low < t < high})
    columns = [left, *(np.full_like(cuts, t) for t in inner), right]
    share = [np.where(right > left, (c - left) / np.maximum(right - left, 1e-9), 0.0) for c in columns]
    z = [heights[0] + s * (heights[1] - heights[0]) for s in share]
    middle = 0.5 * (cuts[:-1] + cuts[1:])
    for k, (one, other) in enumerate(pairwise(columns)):
        names = np.full(len(middle), strip.material, dtype=object)
        for mark in mine:
            across = 0.5 * (one + other)[:-1]
            names[(mark.along[0] < middle) & (middle < mark.along[1])
                  & (mark.across[0] < across) & (across < mark.across[1])] = mark.material  # fmt: skip
        corners = _pieces(line, cuts, (one, other), (z[k], z[k + 1]))
        for name in dict.fromkeys(names.tolist()):
            here = (names == name) & ((other - one)[:-1] + (other - one)[1:] > 1e-6)
            uvs = _texels(name, cuts, (one - left, other - left))
            bag.add(name, quads(corners[here], uvs[here]))


def _pieces(line: _Line, cuts: Floats, across: tuple[Floats, Floats], z: tuple[Floats, Floats]) -> Floats:
    """Return the pieces between two edges, (N, 4, 3), counter-clockwise from above."""
    one, other = (np.concatenate([line.at(cuts, t), h[:, None]], -1) for t, h in zip(across, z, strict=True))
    return np.stack([one[:-1], other[:-1], other[1:], one[1:]], 1)


def _texels(material: str, cuts: Floats, across: tuple[Floats, Floats]) -> Floats:
    wide, long = TILES.get(material, (2.0, 2.0))
    (u0, u1), v = (t / wide for t in across), -cuts / long
    one, other = np.stack([u0, v], -1), np.stack([u1, v], -1)
    return np.stack([one[:-1], other[:-1], other[1:], one[1:]], 1)


def build_slab(placement: Placement) -> Bag:
    """Build a slab: upright kerb stones with a worn edge, and its top."""
    slab = placement.shape
    assert isinstance(slab, Slab)
    outline = np.asarray(slab.outline, np.float64)
    bag = Bag()
    following = np.roll(outline, -1, axis=0)
    inset = _inset(outline, _BEVEL)
    rings = [(outline, _FOOT), (outline, slab.height - _BEVEL), (inset, slab.height)]
    for (low, z0), (high, z1) in pairwise(rings):
        corners = [
            _raised(low, z0),
            _raised(np.roll(low, -1, 0), z0),
            _raised(np.roll(high, -1, 0), z1),
            _raised(high, z1),
        ]
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(following - outline, axis=1))])
        u0, u1 = along[:-1] / 2.0, along[1:] / 2.0
        v0, v1 = np.full_like(u0, -z0 / 2.0), np.full_like(u0, -z1 / 2.0 - 0.01)
        uvs = np.stack(
            [np.stack([u0, v0], -1), np.stack([u1, v0], -1), np.stack([u1, v1], -1), np.stack([u0, v1], -1)], 1
        )
        bag.add("kerb", quads(np.stack(corners, 1), uvs))
    whole = shapely.Polygon(inset)
    top = whole.buffer(-_KERB, join_style="mitre")
    bag.add("kerb", _level(whole.difference(top), slab.height, "kerb"))
    bag.add(slab.material, _level(top, slab.height, slab.material))
    return bag


def _inset(outline: Floats, by: float) -> Floats:
    """Return an outline moved inwards, corner by corner."""
    edge = np.roll(outline, -1, 0) - outline
    inwards = np.stack([-edge[:, 1], edge[:, 0]], -1) / np.linalg.norm(edge, axis=1, keepdims=True)
    both = inwards + np.roll(inwards, 1, 0)
    return np.asarray(outline + by * both / np.maximum((both * inwards).sum(axis=1, keepdims=True), 0.2))


def _raised(points: Floats, z: float) -> Floats:
    return np.concatenate([points, np.full((len(points), 1), z)], -1)


def _level(area: shapely.Geometry, z: float, material: str) -> Surface:
    """Return level triangles over an area, facing up."""
    wide, long = TILES.get(material, (2.0, 2.0))
    parts = []
    for triangle in shapely.constrained_delaunay_triangles(area).geoms:
        corners = np.asarray(shapely.orient_polygons(triangle).exterior.coords)[:3]
        uvs = corners * [1.0 / wide, -1.0 / long]
        parts.append(Surface(_raised(corners, z), np.tile([0.0, 0.0, 1.0], (3, 1)), uvs, np.array([[0, 1, 2]])))
    return merge(parts)
