"""Obstacles that a parameter moves or hides. Their footprints move with their nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray

from valerie.parameters.definitions import Value
from valerie.scene.assets.attributes import ABSENT, FACING_CLASSES
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.graph.naming import ROOT, parse_object_name
from valerie.scene.graph.transforms import cos_sin
from valerie.scene.legality.obstacles import Polygons, widened

#: (K,) indices of variants.
Indices = NDArray[np.int64]
#: Outlines at their places in the world: (K,) indices of variants, and (K,) polygons, metres.
Placed = list[tuple[Indices, Polygons]]

_PLACE: Final = ("pos.x", "pos.y")
_TURNS: Final = ("heading", "rot.z")
_SHOWN: Final = ("visible", "kind")
_POSE: Final = (*_PLACE, *_TURNS, *_SHOWN, "scale")
#: Largest overlap of legal outlines, metres: outlines are rounded, and touching is legal.
_TOUCHING_M: Final = 0.01
#: Inner share of an outline, in length and width, that stands on the ground: wheels do, while bumpers and handlebars may
#: overhang a kerb.
_STANDING: Final = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """One footprint of a mover.

    Attributes:
        footprint: the footprint at the default pose, as in all other attributes.
        kind: the kind of vehicle with this footprint; empty for all kinds.
        widened: the footprint and the room that a person needs around it.
        plain: the footprint, metres from the node's default place.
        corners: (N, 2) corners of the footprint without its rim, metres from the node's default place.
        standing: (N, 2) corners of the part that stands on the ground, likewise.
    """

    footprint: Footprint
    kind: str
    widened: shapely.Polygon
    plain: shapely.Polygon
    corners: NDArray[np.float64]
    standing: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A node with footprints at or below it that a parameter moves or hides.

    Attributes:
        outlines: its outlines in the manifest's order.
        keys: attribute of its pose (``pos.x`` …) to path.
        defaults: declared attribute to default.
        paths: paths of the declared attributes.
        reach: largest distance of an outline from the node's place at its default size, metres.
        radius: room that a person needs, metres.
    """

    path: str
    outlines: tuple[Outline, ...]
    keys: Mapping[str, str]
    defaults: Mapping[str, Value]
    paths: frozenset[str]
    reach: float
    radius: float

    @property
    def name(self) -> str:
        """Return the path of the node without ``scene.``."""
        return self.path.removeprefix(f"{ROOT}.")

    @property
    def has_place(self) -> bool:
        """Return True if a parameter moves it, not only hides or turns it."""
        return any(name in self.defaults for name in _PLACE)

    @property
    def is_built(self) -> bool:
        """Return True if it is neither vehicle nor person, such as a house. It must stay off the ways."""
        name = parse_object_name(self.path.rpartition(".")[2])
        return name is not None and name[0] not in FACING_CLASSES

    def shown(self, assignment: Mapping[str, Value]) -> tuple[Outline, ...]:
        """Return the outlines that count: none for a hidden mover."""
        if self._value("visible", assignment) is False:
            return ()
        kind = self._value("kind", assignment)
        if kind == ABSENT:
            return ()
        return tuple(outline for outline in self.outlines if not outline.kind or outline.kind == kind)

    def holds(self, x: float, y: float, assignment: Mapping[str, Value], z: float = 0.0) -> Footprint | None:
        """Return the footprint that contains (x, y) and reaches above z, metres, after a move back to the default pose."""
        u = x - float(self._value("pos.x", assignment))
        v = y - float(self._value("pos.y", assignment))
        size = self._size(assignment)
        reach = size * self.reach + self.radius
        if u * u + v * v > reach * reach:
            return None
        cos, sin = self._turn(assignment)
        u, v = cos * u + sin * v, cos * v - sin * u
        for outline in self.shown(assignment):
            if outline.footprint.height_m is not None and z >= size * outline.footprint.height_m:
                continue
            if size == 1.0:
                inside = shapely.contains_xy(outline.widened, self._place("pos.x") + u, self._place("pos.y") + v)
            else:
                # The room that a person needs does not grow with the mover.
                inside = size * outline.plain.distance(shapely.Point(u / size, v / size)) < self.radius
            if inside:
                return outline.footprint
        return None

    def poses(self, assignments: Sequence[Mapping[str, Value]]) -> Poses:
        """Return its poses in variants that give the same paths."""
        count, given = len(assignments), assignments[0].keys()

        def each(names: Iterable[str], value: Callable[[Mapping[str, Value]], Any]) -> list[Any]:
            # What no variant gives is the same in all of them.
            alike = given.isdisjoint(self.keys[name] for name in names)
            return [value(assignments[0])] * count if alike else [value(assignment) for assignment in assignments]

        shown: dict[tuple[Value, ...], list[int]] = {}
        for index, kind in enumerate(each(_SHOWN, lambda values: tuple(self._value(name, values) for name in _SHOWN))):
            shown.setdefault(kind, []).append(index)
        return Poses(
            self,
            tuple((self.shown(assignments[indices[0]]), np.array(indices)) for indices in shown.values()),
            np.array(each(_PLACE, lambda values: [float(self._value(name, values)) for name in _PLACE])),
            np.array(each(_TURNS, self._turn)),
            np.array(each(("scale",), self._size)),
        )

    def _turn(self, assignment: Mapping[str, Value]) -> tuple[float, float]:
        """Return cosine and sine of the turn from the default heading."""
        return cos_sin(
            sum(
                float(self._value(name, assignment)) - float(self.defaults[name])
                for name in _TURNS
                if name in self.defaults
            )
        )

    def _size(self, assignment: Mapping[str, Value]) -> float:
        """Return the size relative to the default."""
        return float(self._value("scale", assignment, 1.0)) / float(self.defaults.get("scale", 1.0))

    def _value(self, name: str, assignment: Mapping[str, Value], otherwise: Value = 0.0) -> Value:
        return assignment.get(self.keys[name], self.defaults.get(name, otherwise))

    def _place(self, name: str) -> float:
        return float(self.defaults.get(name, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """The poses of a mover in N variants.

    Attributes:
        shown: outlines that count, and the indices of the variants in which they do.
        place: (N, 2) metres, world.
        turn: (N, 2) cosine and sine of the turn from the default heading.
        size: (N,) relative to the default.
    """

    mover: Mover
    shown: tuple[tuple[tuple[Outline, ...], Indices], ...]
    place: NDArray[np.float64]
    turn: NDArray[np.float64]
    size: NDArray[np.float64]

    def polygons(self, of: Indices | None = None, *, standing: bool = False) -> Placed:
        """Return the outlines that count.

        Args:
            of: indices of the variants, in order; None: all.
            standing: only the parts that stand on the ground.
        """
        placed = []
        for outlines, shown in self.shown:
            variants = shown if of is None else np.intersect1d(shown, of, assume_unique=True)
            cos, sin = self.size[variants] * self.turn[variants].T
            turns = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
            for outline in outlines:
                corners = (outline.standing if standing else outline.corners) @ turns + self.place[variants, None]
                placed.append((variants, shapely.polygons(corners)))
        return placed

    @property
    def reach(self) -> NDArray[np.float64]:
        """Return (N,) metres: nothing farther from the mover's place is in its room."""
        return self.size * self.mover.reach + self.mover.radius

    def near(self, points: NDArray[np.float64], variants: Indices | None = None) -> NDArray[np.bool_]:
        """Return (K,) True where a point may be in the mover's room.

        Args:
            points: (K, 2) or (2,) metres.
            variants: (K,) index of the variant of each point; None: one point in each variant, or the same in all.
        """
        place, reach = (self.place, self.reach) if variants is None else (self.place[variants], self.reach[variants])
        u, v = (points - place).T
        near: NDArray[np.bool_] = u * u + v * v <= reach**2
        return near


def sort_obstacles(manifest: Manifest, radius: float) -> tuple[tuple[Footprint, ...], tuple[Mover, ...]]:
    """Return the manifest's obstacles at rest, and its movers.

    Args:
        manifest: declares obstacles and parameters.
        radius: room that a person needs, metres.
    """
    resting: list[Footprint] = []
    moving: dict[str, list[Footprint]] = {}
    for obstacle in manifest.obstacles:
        mover = next((path for path in _upwards(obstacle.path) if _declared(manifest, path)), None)
        (resting if mover is None else moving.setdefault(mover, [])).append(obstacle)
    return tuple(resting), tuple(_mover(manifest, path, footprints, radius) for path, footprints in moving.items())


def _mover(manifest: Manifest, path: str, footprints: list[Footprint], radius: float) -> Mover:
    defaults = _declared(manifest, path)
    place = np.array([float(defaults.get(name, 0.0)) for name in _PLACE])
    kinds = manifest.by_path[f"{path}.kind"].choices if "kind" in defaults else ()
    outlines = []
    for footprint in footprints:
        child = footprint.path.removeprefix(path).removeprefix(".").partition(".")[0]
        outline = _pulled_in(footprint)
        middle = np.asarray(outline.centroid.coords[0])
        corners = np.asarray(outline.exterior.coords, np.float64)
        outlines.append(
            Outline(
                footprint,
                child if child in kinds else "",
                widened(footprint, radius),
                shapely.affinity.translate(shapely.Polygon(footprint.polygon), *-place),
                corners - place,
                middle + _STANDING * (corners - middle) - place,
            )
        )
    reach = max(float(np.linalg.norm(np.asarray(footprint.polygon) - place, axis=1).max()) for footprint in footprints)
    keys = {name: f"{path}.{name}" for name in _POSE}
    paths = frozenset(keys[name] for name in defaults)
    return Mover(path, tuple(outlines), keys, defaults, paths, reach, radius)


def _pulled_in(footprint: Footprint) -> shapely.Polygon:
    """Return a footprint without its rim; the rectangle around it if nothing or several pieces remain."""
    polygon = shapely.Polygon(footprint.polygon)
    smaller = polygon.buffer(-_TOUCHING_M, join_style="mitre")
    if isinstance(smaller, shapely.Polygon) and not smaller.is_empty:
        return smaller
    x0, y0, x1, y1 = polygon.bounds
    return shapely.box(x0, y0, x1, y1)


def _declared(manifest: Manifest, path: str) -> dict[str, Value]:
    definitions = {name: manifest.by_path.get(f"{path}.{name}") for name in _POSE}
    return {
        name: definition.check(definition.default) for name, definition in definitions.items() if definition is not None
    }


def _upwards(path: str) -> Iterator[str]:
    while path:
        yield path
        path = path.rpartition(".")[0]
