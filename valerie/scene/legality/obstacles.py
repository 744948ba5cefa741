"""Obstacles at rest: a grid of outlines widened by the room that a person needs, and the plain outlines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from valerie.scene.assets.manifest import Footprint

#: (N,) polygons.
Polygons = NDArray[np.object_]

#: Edge of a grid cell, metres.
_CELL_M: Final = 2.0


class ObstacleMap:
    """Obstacles at rest by grid cell. A query costs one look-up and a few point-in-polygon tests.

    Args:
        obstacles: obstacles that do not move.
        radius: metres by which to widen each.
    """

    def __init__(self, obstacles: Iterable[Footprint], radius: float) -> None:
        self._cells: dict[tuple[int, int], list[tuple[shapely.Polygon, Footprint]]] = {}
        polygons: list[shapely.Polygon] = []
        for obstacle in obstacles:
            polygon = widened(obstacle, radius)
            polygons.append(polygon)
            for cell in _cells_of(polygon):
                self._cells.setdefault(cell, []).append((polygon, obstacle))
        self._tree = shapely.STRtree(polygons)

    def at(self, x: float, y: float, z: float = 0.0) -> Footprint | None:
        """Return the first obstacle whose widened footprint contains (x, y) and that reaches above z, metres."""
        for polygon, obstacle in self._cells.get((int(x // _CELL_M), int(y // _CELL_M)), ()):
            if (obstacle.height_m is None or z < obstacle.height_m) and shapely.contains_xy(polygon, x, y):
                return obstacle
        return None

    def near(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (n,) True where a widened footprint contains or touches a point (x, y), metres, whatever its height."""
        touched = np.zeros(len(x), np.bool_)
        touched[self._tree.query(shapely.points(x, y), predicate="intersects")[0]] = True
        return touched


class Outlines:
    """The outlines of obstacles at rest, and queries for overlaps with them.

    Args:
        obstacles: none of which moves.
    """

    def __init__(self, obstacles: Sequence[Footprint]) -> None:
        self._obstacles = tuple(obstacles)
        self._tree = shapely.STRtree([shapely.make_valid(shapely.Polygon(obstacle.polygon)) for obstacle in obstacles])

    def first(self, polygons: Polygons, but: Set[int]) -> dict[int, Footprint]:
        """Return the first obstacle, in the manifest's order, below each of N polygons, by index of the polygon.

        Args:
            polygons: metres, world.
            but: indices of obstacles to ignore.
        """
        first: dict[int, int] = {}
        for index, obstacle in zip(*self._tree.query(polygons, predicate="intersects").tolist(), strict=True):
            if obstacle not in but:
                first[index] = min(first.get(index, obstacle), obstacle)
        return {index: self._obstacles[obstacle] for index, obstacle in first.items()}

    def below(self, polygons: Polygons) -> frozenset[int]:
        """Return the indices of all obstacles that polygons (metres, world) overlap."""
        return frozenset(self._tree.query(polygons, predicate="intersects")[1].tolist())


def widened(obstacle: Footprint, radius: float) -> shapely.Polygon:
    """Return the ground of an obstacle and ``radius`` metres around it, prepared for fast tests."""
    polygon = shapely.Polygon(obstacle.polygon).buffer(radius, quad_segs=16)
    shapely.prepare(polygon)
    return polygon


def _cells_of(polygon: shapely.Polygon) -> Iterator[tuple[int, int]]:
    x0, y0, x1, y1 = (int(bound // _CELL_M) for bound in polygon.bounds)
    for i in range(x0, x1 + 1):
        for j in range(y0, y1 + 1):
            if polygon.intersects(shapely.box(i * _CELL_M, j * _CELL_M, (i + 1) * _CELL_M, (j + 1) * _CELL_M)):
                yield i, j
