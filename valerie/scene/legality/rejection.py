"""Reject impossible variants: no person, vehicle, house or camera may be inside something else or outside the asset.

The manifest alone decides, without meshes or GL. Obstacles are widened once by the room that a person needs, and a grid over the
ground finds the few of them near a point. Movers are judged by `valerie.scene.legality.mover_rules`,
cameras by `valerie.scene.legality.camera_rules`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from valerie.parameters.definitions import Value
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.graph.naming import ROOT
from valerie.scene.legality.camera_rules import CameraRules
from valerie.scene.legality.mover_rules import MoverRules
from valerie.scene.legality.movers import Mover, sort_obstacles
from valerie.scene.legality.obstacles import ObstacleMap


def rejection_reason(assignment: Mapping[str, Value], manifest: Manifest) -> str | None:
    """Return the reason why a variant is impossible (``person-1 stands inside building-3``); None if it is not.

    A person is judged if its position is a parameter. A visible vehicle is judged if the variant gives its place, heading, kind
    or visibility. A camera is judged if its three coordinates are parameters: against everything if the variant gives one of
    them, else against those vehicles. Everything else stays where the asset's author put it.

    Args:
        assignment: path to value, valid for the manifest; missing values take their defaults.
        manifest: declares persons, obstacles and cameras.
    """
    prepared = _prepare(manifest)
    x0, y0, x1, y1 = manifest.extent
    standing: list[tuple[str, float, float]] = []
    for person in prepared.persons:
        get = assignment.get
        if (
            get(person.character, person.default_character) == ABSENT
            or get(person.visible, person.default_visible) is False
        ):
            continue
        x, y = float(get(person.x, person.default_x)), float(get(person.y, person.default_y))
        if not (x0 <= x <= x1 and y0 <= y <= y1):
            return f"{person.name} is outside the asset"
        if footprint := prepared.at(x, y, assignment):
            return f"{person.name} stands {footprint.text}"
        standing.append((person.name, x, y))
    if len(standing) > 1 and (overlap := _overlap(standing, 2.0 * manifest.person_radius_m)):
        return overlap
    if reason := prepared.mover_rules.reason(assignment):
        return reason
    return prepared.cameras.reason(assignment)


def _overlap(standing: list[tuple[str, float, float]], distance: float) -> str | None:
    for index, (name, x, y) in enumerate(standing):
        for other, other_x, other_y in standing[:index]:
            if (x - other_x) ** 2 + (y - other_y) ** 2 < distance * distance:
                return f"{other} and {name} overlap"
    return None


@dataclass(frozen=True, slots=True)
class _Person:
    """Paths and defaults of one person."""

    name: str
    x: str
    y: str
    character: str
    visible: str
    default_x: float
    default_y: float
    default_character: Value
    default_visible: Value


@dataclass(frozen=True, slots=True)
class _Prepared:
    """Everything that follows from the manifest.

    Attributes:
        settled: obstacles at rest, and houses at their default places.
        resting: only the obstacles at rest.
        built, vehicles: movers such as houses, and all other movers.
        of_built: paths of the pose parameters of ``built``.
    """

    persons: tuple[_Person, ...]
    settled: ObstacleMap
    resting: ObstacleMap
    built: tuple[Mover, ...]
    vehicles: tuple[Mover, ...]
    of_built: frozenset[str]
    mover_rules: MoverRules
    cameras: CameraRules

    def at(self, x: float, y: float, assignment: Mapping[str, Value]) -> Footprint | None:
        """Return the footprint that a person at (x, y) would stand in; None if there is room."""
        if self.of_built.isdisjoint(assignment):
            footprint = self.settled.at(x, y)
        else:
            footprint = self.resting.at(x, y) or _first(self.built, x, y, assignment)
        return footprint or _first(self.vehicles, x, y, assignment)


def _first(movers: tuple[Mover, ...], x: float, y: float, assignment: Mapping[str, Value]) -> Footprint | None:
    return next((footprint for mover in movers if (footprint := mover.holds(x, y, assignment))), None)


@lru_cache(maxsize=16)
def _prepare(manifest: Manifest) -> _Prepared:
    radius = manifest.person_radius_m
    resting, movers = sort_obstacles(manifest, radius)
    built = tuple(mover for mover in movers if mover.is_built)
    settled = {id(obstacle) for obstacle in resting} | {
        id(outline.footprint) for mover in built for outline in mover.shown({})
    }
    return _Prepared(
        persons=tuple(_person(manifest, path) for path in manifest.persons if f"{path}.pos.x" in manifest.by_path),
        settled=ObstacleMap([obstacle for obstacle in manifest.obstacles if id(obstacle) in settled], radius),
        resting=ObstacleMap(resting, radius),
        built=built,
        vehicles=tuple(mover for mover in movers if not mover.is_built),
        of_built=frozenset(path for mover in built for path in mover.paths),
        mover_rules=MoverRules(manifest, resting, movers),
        cameras=CameraRules(manifest),
    )


def _person(manifest: Manifest, path: str) -> _Person:
    def default(attribute: str, otherwise: Value) -> Value:
        definition = manifest.by_path.get(f"{path}.{attribute}")
        return otherwise if definition is None else definition.check(definition.default)

    return _Person(
        name=path.removeprefix(f"{ROOT}."),
        x=f"{path}.pos.x",
        y=f"{path}.pos.y",
        character=f"{path}.character",
        visible=f"{path}.visible",
        default_x=float(default("pos.x", 0.0)),
        default_y=float(default("pos.y", 0.0)),
        default_character=default("character", ""),
        default_visible=default("visible", True),
    )
