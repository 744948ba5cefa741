"""Large bodies: boxes with a rounded plan, cut into panels and panes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from urban_street.solids.surfaces import Bag, Floats, sheet
from urban_street.vehicles.shell import rounded, shrunk
from urban_street.vehicles.skin import Master, cut, flange, mirrored


class Hull:
    """The half x ≥ 0 of a rounded box. Its domain is (metres along the plan from the middle of the tail, height).

    Args:
        ends: y of tail and nose, metres.
        width: width, metres.
        heights: heights of the lower and the upper edge, metres.
        corners: radii in plan of tail and nose corner, metres.
        inset: (height, metres inwards) of the section.
        rake: (height, metres backwards) of the nose.
        columns, rows: largest sizes of the triangles on flat parts, metres.
    """

    def __init__(
        self,
        ends: tuple[float, float],
        width: float,
        heights: tuple[float, float],
        *,
        corners: tuple[float, float],
        inset: Sequence[tuple[float, float]],
        rake: Sequence[tuple[float, float]] = ((0.0, 0.0),),
        columns: float = 0.6,
        rows: float = 0.35,
    ) -> None:
        (tail, nose), (low, high) = ends, heights
        half = 0.5 * width
        self.half, self.tail, self.nose, self.low, self.high = half, tail, nose, low, high
        r0, r1 = corners
        turn = np.linspace(0.0, 0.5 * np.pi, 9)
        # nose and tail are slightly bowed
        bow0, bow1 = np.linspace(0.0, half - r0, 5)[:-1], np.linspace(half - r1, 0.0, 5)[1:]
        back = np.stack([half - r0 + r0 * np.sin(turn), tail + 0.04 + r0 - r0 * np.cos(turn)], -1)
        front = np.stack([half - r1 + r1 * np.cos(turn), nose - 0.06 - r1 + r1 * np.sin(turn)], -1)
        line = np.concatenate(
            [
                np.stack([bow0, tail + 0.04 * (bow0 / (half - r0)) ** 2], -1),
                back,
                front,
                np.stack([bow1, nose - 0.06 * (bow1 / (half - r1)) ** 2], -1),
            ]
        )
        self._arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        self.length = float(self._arc[-1])
        self._line = line
        slope = np.gradient(line, self._arc, axis=0)
        slope[0], slope[-1] = (1.0, 0.0), (-1.0, 0.0)
        normal = np.stack([slope[:, 1], -slope[:, 0]], -1)
        self._normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        self._flank = (float(self._arc[len(bow0) + 8]), float(line[len(bow0) + 8, 1]))
        self._inset, self._rake = np.array(inset), np.array(rake)
        start, stop = self._flank[0], float(self._arc[len(bow0) + 9])
        flat = np.linspace(start, stop, int((stop - start) / columns) + 2)
        a = np.unique(np.concatenate([self._arc[: len(bow0) + 9 : 1], flat, self._arc[len(bow0) + 9 :]]))
        bends = np.concatenate([self._inset[:, 0], self._rake[:, 0]])
        levels = np.linspace(low, high, int((high - low) / rows) + 2)
        b = np.unique(np.round(np.concatenate([levels, bends[(bends > low) & (bends < high)]]), 4))
        self.master = Master(self._points, (0.0, low), (self.length, high), (a, b))

    def _points(self, at: Floats) -> Floats:
        a, z = at[:, 0], at[:, 1]
        xy = np.stack([np.interp(a, self._arc, self._line[:, k]) for k in (0, 1)], -1)
        normal = np.stack([np.interp(a, self._arc, self._normal[:, k]) for k in (0, 1)], -1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        xy = xy - normal * np.interp(z, *self._inset.T)[:, None]
        ahead = np.clip((a - (self.length - self.half - 0.4)) / 0.5, 0.0, 1.0)
        xy[:, 1] -= np.interp(z, *self._rake.T) * ahead * ahead * (3.0 - 2.0 * ahead)
        xy[:, 0] = np.where((a <= 0.0) | (a >= self.length), 0.0, xy[:, 0])
        return np.column_stack([xy, z])

    def flank_a(self, y: float) -> float:
        """Return the domain coordinate of a place on the flank."""
        return self._flank[0] + y - self._flank[1]

    def side(self, y0: float, y1: float, z0: float, z1: float, rounding: float = 0.0) -> BaseGeometry:
        """Return a rectangle on the flank."""
        return self._shape(shapely.box(self.flank_a(y0), z0, self.flank_a(y1), z1), rounding)

    def front(self, x0: float, x1: float, z0: float, z1: float, rounding: float = 0.0) -> BaseGeometry:
        """Return a rectangle on the nose, with ``x`` in metres along it from the middle."""
        return self._shape(shapely.box(self.length - x1, z0, self.length - x0, z1), rounding)

    def back(self, x0: float, x1: float, z0: float, z1: float, rounding: float = 0.0) -> BaseGeometry:
        """Return a rectangle on the tail."""
        return self._shape(shapely.box(x0, z0, x1, z1), rounding)

    def arch(self, y: float, z: float, radius: float) -> BaseGeometry:
        """Return a wheel arch, open below."""
        angle = np.linspace(0.0, np.pi, 25)
        circle = [(self.flank_a(y) + radius * np.cos(t), z + radius * np.sin(t)) for t in angle]
        return shapely.Polygon(
            [*circle, (self.flank_a(y) - radius, self.low - 1), (self.flank_a(y) + radius, self.low - 1)]
        )

    def _shape(self, shape: BaseGeometry, rounding: float) -> BaseGeometry:
        inside = shapely.intersection(shape, self.master.domain)
        return rounded(inside, rounding, self.master.domain) if rounding else inside

    def panel(
        self,
        material: str,
        region: BaseGeometry,
        *,
        gap: float = 0.0,
        offset: float = 0.0,
        depth: float = 0.02,
        edge: str = "vehicle-gap",
    ) -> Bag:
        """Build a panel from a region of the right half, with an edge."""
        bag = Bag()
        shape = shrunk(region, gap, self.master.domain) if gap else region
        patch = cut(self.master, shape, offset=offset)
        bag.add(material, patch.surface)
        if depth:
            bag.add(edge, flange(patch, depth))
        return bag

    def lid(self, material: str, crown: float) -> Bag:
        """Build the roof over the upper edge."""
        a = np.linspace(0.0, self.length, 40)
        edge = self.master.points(np.column_stack([a, np.full_like(a, self.high)]))
        u = np.array([1.0, 0.9, 0.6, 0.0, -0.6, -0.9, -1.0])
        lift = crown * np.clip(edge[:, :1] / self.half, 0.0, 1.0) * (1.0 - np.abs(u) ** 2.5)
        points = np.stack(
            np.broadcast_arrays(edge[:, None, 0] * u, edge[:, None, 1] + 0.0 * u, edge[:, None, 2] + lift), -1
        )
        bag = Bag()
        bag.add(material, sheet(points))
        return bag

    def liner(self, y: float, z: float, radius: float, depth: float) -> Bag:
        """Build the inside of a wheel arch on the right."""
        angle = np.linspace(0.0, np.pi, 15)
        yz = np.stack([y + radius * np.cos(angle), z + radius * np.sin(angle)], -1)
        outer = np.column_stack([np.full(15, self.half - 0.012), yz])
        inner = outer - np.array([depth, 0.0, 0.0])
        bag = Bag()
        bag.add("vehicle-gap", sheet(np.stack([outer, inner], 1)))
        return bag


def both_sides(bag: Bag) -> Bag:
    """Return a bag with its mirror image."""
    whole = Bag()
    whole.merge(bag)
    for material, surfaces in bag.surfaces.items():
        whole.add(material, *(mirrored(surface) for surface in surfaces))
    return whole
