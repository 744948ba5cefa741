"""Obstacles widened by the room that somebody needs: at rest in a grid over the ground, and such that move."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import shapely

from valerie.parameters.definitions import Value
from valerie.scene.attributes import ABSENT
from valerie.scene.manifest import Footprint, Manifest
from valerie.scene.transforms import cos_sin

#: Edge of a grid cell, metres.
_CELL_M: Final = 2.0
_POSE: Final = ("pos.x", "pos.y", "heading", "rot.z", "visible", "kind")


class ObstacleMap:
    """Obstacles at rest, found by grid cell: a place costs one look-up and few point-in-polygon tests.

    Args:
        obstacles: none of which moves.
        radius: metres by which each is widened.
    """

    def __init__(self, obstacles: Iterable[Footprint], radius: float) -> None:
        self._cells: dict[tuple[int, int], list[tuple[shapely.Polygon, Footprint]]] = {}
        for obstacle in obstacles:
            widened = _widened(obstacle, radius)
            for cell in _cells_of(widened):
                self._cells.setdefault(cell, []).append((widened, obstacle))

    def at(self, x: float, y: float, z: float = 0.0) -> Footprint | None:
        """The first obstacle whose widened footprint holds (x, y) and that reaches above z, metres."""
        for polygon, obstacle in self._cells.get((int(x // _CELL_M), int(y // _CELL_M)), ()):
            if (obstacle.height_m is None or z < obstacle.height_m) and shapely.contains_xy(polygon, x, y):
                return obstacle
        return None


@dataclass(frozen=True, slots=True)
class MovingObstacle:
    """An obstacle whose node has a declared pose: its footprint goes where the node goes.

    Attributes:
        footprint: at the default pose.
        polygon: widened, at the default pose.
        path: of the node that moves: the obstacle's own or one above.
        defaults: attribute to default; those of a pose (``pos.x`` …) that vary.
    """

    footprint: Footprint
    polygon: shapely.Polygon
    path: str
    defaults: Mapping[str, Value]

    def holds(self, x: float, y: float, assignment: Mapping[str, Value]) -> bool:
        """Whether (x, y) in metres is inside: the point is taken back to where the obstacle stands by default."""
        if self._value("visible", assignment) is False or self._value("kind", assignment) == ABSENT:
            return False
        x0, y0 = float(self.defaults.get("pos.x", 0.0)), float(self.defaults.get("pos.y", 0.0))
        turned = sum(
            float(self._value(name, assignment)) - float(self.defaults[name])
            for name in ("heading", "rot.z")
            if name in self.defaults
        )
        cos, sin = cos_sin(-turned)
        dx, dy = x - float(self._value("pos.x", assignment)), y - float(self._value("pos.y", assignment))
        return bool(shapely.contains_xy(self.polygon, x0 + cos * dx - sin * dy, y0 + sin * dx + cos * dy))

    def _value(self, name: str, assignment: Mapping[str, Value]) -> Value:
        return assignment.get(f"{self.path}.{name}", self.defaults.get(name, 0.0))


def sort_obstacles(manifest: Manifest, radius: float) -> tuple[ObstacleMap, tuple[MovingObstacle, ...]]:
    """The manifest's obstacles, widened by ``radius`` metres: those at rest, and those that a parameter moves."""
    resting, moving = [], []
    for obstacle in manifest.obstacles:
        mover = next((path for path in _upwards(obstacle.path) if _declared(manifest, path)), None)
        if mover is None:
            resting.append(obstacle)
        else:
            moving.append(MovingObstacle(obstacle, _widened(obstacle, radius), mover, _declared(manifest, mover)))
    return ObstacleMap(resting, radius), tuple(moving)


def _declared(manifest: Manifest, path: str) -> dict[str, Value]:
    definitions = {name: manifest.by_path.get(f"{path}.{name}") for name in _POSE}
    return {name: found.check(found.default) for name, found in definitions.items() if found is not None}


def _upwards(path: str) -> Iterator[str]:
    while path:
        yield path
        path = path.rpartition(".")[0]


def _widened(obstacle: Footprint, radius: float) -> shapely.Polygon:
    widened = shapely.Polygon(obstacle.polygon).buffer(radius, quad_segs=16)
    shapely.prepare(widened)
    return widened


def _cells_of(polygon: shapely.Polygon) -> Iterator[tuple[int, int]]:
    x0, y0, x1, y1 = (int(bound // _CELL_M) for bound in polygon.bounds)
    for i in range(x0, x1 + 1):
        for j in range(y0, y1 + 1):
            if polygon.intersects(shapely.box(i * _CELL_M, j * _CELL_M, (i + 1) * _CELL_M, (j + 1) * _CELL_M)):
                yield i, j
