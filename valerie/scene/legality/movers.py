"""Obstacles that a parameter moves: their footprints go where their nodes go."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray

from valerie.parameters.definitions import Value
from valerie.scene.assets.attributes import ABSENT, FACING_CLASSES
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.graph.naming import ROOT, parse_object_name
from valerie.scene.graph.transforms import cos_sin
from valerie.scene.legality.obstacles import widened

_PLACE: Final = ("pos.x", "pos.y")
_TURNS: Final = ("heading", "rot.z")
_POSE: Final = (*_PLACE, *_TURNS, "scale", "visible", "kind")
#: What touches does not overlap: outlines are rounded, and things stand side by side. Metres.
_TOUCHING_M: Final = 0.01
#: The middle of an outline that stands on the ground, as a share of its length and width: wheels, while bumpers and handlebars
#: may hang over a kerb.
_STANDING: Final = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """One footprint of a mover.

    Attributes:
        footprint: at the default pose.
        kind: the vehicle that it is of, where the mover is one of several; empty if it always counts.
        widened: by the room that somebody needs, at the default pose.
        plain: not widened, metres from the node's default place, at the default pose.
        corners: (N, 2) metres from the node's default place, at the default pose; pulled in by what may touch.
        standing: the same of the part that stands on the ground.
    """

    footprint: Footprint
    kind: str
    widened: shapely.Polygon
    plain: shapely.Polygon
    corners: NDArray[np.float64]
    standing: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A node with footprints at or below it, whose pose a parameter changes, or which a parameter hides.

    Attributes:
        path: of the node.
        outlines: as the manifest lists them.
        keys: attribute of a pose (``pos.x`` …) to its path.
        defaults: attribute to default; those that are declared.
        paths: of its pose, as far as they are declared.
        reach: farthest that an outline reaches from the node's place at its default size, metres.
        radius: metres that somebody needs around its place.
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
        """The node without ``scene.``, as people call it."""
        return self.path.removeprefix(f"{ROOT}.")

    @property
    def has_place(self) -> bool:
        """Whether a parameter puts it elsewhere, or only hides it."""
        return any(name in self.defaults for name in _PLACE)

    @property
    def is_built(self) -> bool:
        """Whether it is what nobody drives, rides or is, such as a house: it belongs beside the ways."""
        named = parse_object_name(self.path.rpartition(".")[2])
        return named is not None and named[0] not in FACING_CLASSES

    def shown(self, assignment: Mapping[str, Value]) -> tuple[Outline, ...]:
        """The outlines that count; none of what is hidden."""
        if self._value("visible", assignment) is False:
            return ()
        kind = self._value("kind", assignment)
        if kind == ABSENT:
            return ()
        return tuple(outline for outline in self.outlines if not outline.kind or outline.kind == kind)

    def holds(self, x: float, y: float, assignment: Mapping[str, Value], z: float = 0.0) -> Footprint | None:
        """The footprint that holds (x, y) and reaches above z, metres: the point is taken back to the default pose."""
        u = x - float(self._value("pos.x", assignment))
        v = y - float(self._value("pos.y", assignment))
        size = self._size(assignment)
        reach = size * self.reach + self.radius
        if u * u + v * v > reach * reach:
            return None
        cos, sin = self._turn(assignment)
        u, v = cos * u + sin * v, cos * v - sin * u
        for one in self.shown(assignment):
            if one.footprint.height_m is not None and z >= size * one.footprint.height_m:
                continue
            if size == 1.0:
                inside = shapely.contains_xy(one.widened, self._place("pos.x") + u, self._place("pos.y") + v)
            else:
                # The room that somebody needs has one size, whichever the thing has.
                inside = size * one.plain.distance(shapely.Point(u / size, v / size)) < self.radius
            if inside:
                return one.footprint
        return None

    def polygons(self, assignment: Mapping[str, Value], *, standing: bool = False) -> tuple[shapely.Polygon, ...]:
        """The outlines that count where they are, or the parts of them that stand on the ground; metres in the world."""
        outlines = self.shown(assignment)
        if not outlines:
            return ()
        cos, sin = self._turn(assignment)
        turn = self._size(assignment) * np.array([[cos, sin], [-sin, cos]])
        place = np.array([float(self._value(name, assignment)) for name in _PLACE])
        return tuple(shapely.Polygon((one.standing if standing else one.corners) @ turn + place) for one in outlines)

    def _turn(self, assignment: Mapping[str, Value]) -> tuple[float, float]:
        """Cosine and sine of the turn away from the default."""
        return cos_sin(
            sum(
                float(self._value(name, assignment)) - float(self.defaults[name])
                for name in _TURNS
                if name in self.defaults
            )
        )

    def _size(self, assignment: Mapping[str, Value]) -> float:
        """How many times as large as by default."""
        return float(self._value("scale", assignment, 1.0)) / float(self.defaults.get("scale", 1.0))

    def _value(self, name: str, assignment: Mapping[str, Value], otherwise: Value = 0.0) -> Value:
        return assignment.get(self.keys[name], self.defaults.get(name, otherwise))

    def _place(self, name: str) -> float:
        return float(self.defaults.get(name, 0.0))


def sort_obstacles(manifest: Manifest, radius: float) -> tuple[tuple[Footprint, ...], tuple[Mover, ...]]:
    """The manifest's obstacles at rest, and those that a parameter moves or hides, by their nodes.

    Args:
        manifest: tells both.
        radius: metres that somebody needs around its place.
    """
    resting: list[Footprint] = []
    moving: dict[str, list[Footprint]] = {}
    for obstacle in manifest.obstacles:
        mover = next((path for path in _upwards(obstacle.path) if _declared(manifest, path)), None)
        (resting if mover is None else moving.setdefault(mover, [])).append(obstacle)
    return tuple(resting), tuple(_mover(manifest, path, footprints, radius) for path, footprints in moving.items())


def _mover(manifest: Manifest, path: str, footprints: list[Footprint], radius: float) -> Mover:
    declared = _declared(manifest, path)
    place = np.array([float(declared.get(name, 0.0)) for name in _PLACE])
    kinds = manifest.by_path[f"{path}.kind"].choices if "kind" in declared else ()
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
    paths = frozenset(keys[name] for name in declared)
    return Mover(path, tuple(outlines), keys, declared, paths, reach, radius)


def _pulled_in(footprint: Footprint) -> shapely.Polygon:
    """A footprint without its rim; of one that is all rim, or in pieces, the rectangle around it."""
    polygon = shapely.Polygon(footprint.polygon)
    smaller = polygon.buffer(-_TOUCHING_M, join_style="mitre")
    if isinstance(smaller, shapely.Polygon) and not smaller.is_empty:
        return smaller
    x0, y0, x1, y1 = polygon.bounds
    return shapely.box(x0, y0, x1, y1)


def _declared(manifest: Manifest, path: str) -> dict[str, Value]:
    definitions = {name: manifest.by_path.get(f"{path}.{name}") for name in _POSE}
    return {name: found.check(found.default) for name, found in definitions.items() if found is not None}


def _upwards(path: str) -> Iterator[str]:
    while path:
        yield path
        path = path.rpartition(".")[0]
