"""Reject impossible variants: nothing may be inside something else or outside the asset, and weather may not contradict itself.

The manifest alone decides, without meshes or GL. Obstacles are widened once by the room that a person needs, and a grid over the
ground finds the few of them near a point. Movers are judged by `valerie.scene.legality.mover_rules`,
cameras by `valerie.scene.legality.camera_rules`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from valerie.parameters.definitions import Value
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.graph.naming import ROOT
from valerie.scene.graph.transforms import cos_sin
from valerie.scene.legality.camera_rules import CameraRules
from valerie.scene.legality.mover_rules import MoverRules
from valerie.scene.legality.movers import Mover, sort_obstacles
from valerie.scene.legality.obstacles import ObstacleMap
from valerie.scene.legality.weather_rules import weather_reason


def rejection_reason(assignment: Mapping[str, Value], manifest: Manifest) -> str | None:
    """Return the reason why a variant is impossible (``person-1 stands inside building-3``); None if it is not.

    A person is judged if its position is a parameter. A visible vehicle is judged if the variant gives its place, heading, kind
    or visibility. A camera is judged if its three coordinates are parameters: against everything if the variant gives one of
    them, else against those vehicles. Everything else stays where the asset's author put it. Weather is judged by
    `valerie.scene.legality.weather_rules`.

    Args:
        assignment: path to value, valid for the manifest; missing values take their defaults.
        manifest: declares persons, obstacles and cameras.
    """
    prepared = _prepare(manifest)
    x0, y0, x1, y1 = manifest.extent
    moved = prepared.moved(assignment)
    settled, movers = _settled(manifest, moved), [prepared.movers[index] for index in sorted(moved)]
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
        held = (footprint for mover in movers if (footprint := mover.holds(x, y, assignment)))
        if footprint := settled.at(x, y) or next(held, None):
            return f"{person.name} stands {footprint.text}"
        standing.append((person.name, x, y))
        pose = str(get(person.pose, person.default_pose))
        for there in _reached(manifest, pose, x, y, float(get(person.heading, person.default_heading))):
            if not (x0 <= there[0] <= x1 and y0 <= there[1] <= y1):
                return f"{person.name} in the pose {pose} reaches out of the asset"
            held = (footprint for mover in movers if (footprint := mover.holds(*there, assignment)))
            if footprint := settled.at(*there) or next(held, None):
                return f"{person.name} in the pose {pose} reaches {footprint.text}"
            standing.append((person.name, *there))
    if len(standing) > 1 and (overlap := _overlap(standing, 2.0 * manifest.person_radius_m)):
        return overlap
    if reason := prepared.mover_rules.reason(assignment) or prepared.cameras.reason(assignment):
        return reason
    return weather_reason(assignment, manifest)


def _reached(manifest: Manifest, pose: str, x: float, y: float, heading: float) -> Iterator[tuple[float, float]]:
    """Yield the world's places of the further circles that a pose takes of the ground."""
    cos, sin = cos_sin(heading)
    for across, ahead in manifest.reaches.get(pose, ()):
        yield x + cos * across - sin * ahead, y + sin * across + cos * ahead


def _overlap(standing: list[tuple[str, float, float]], distance: float) -> str | None:
    for index, (name, x, y) in enumerate(standing):
        for other, other_x, other_y in standing[:index]:
            if name != other and (x - other_x) ** 2 + (y - other_y) ** 2 < distance * distance:
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
    pose: str
    heading: str
    default_x: float
    default_y: float
    default_character: Value
    default_visible: Value
    default_pose: Value
    default_heading: float


@dataclass(frozen=True, slots=True)
class _Prepared:
    """Everything that follows from the manifest.

    Attributes:
        resting: the obstacles at rest.
        movers: all others.
        owners: path of each pose parameter of a mover to the index of the mover.
    """

    persons: tuple[_Person, ...]
    resting: tuple[Footprint, ...]
    movers: tuple[Mover, ...]
    owners: Mapping[str, int]
    mover_rules: MoverRules
    cameras: CameraRules

    def moved(self, assignment: Mapping[str, Value]) -> frozenset[int]:
        """Return the indices of the movers of whose pose a variant gives a part."""
        return frozenset(self.owners[path] for path in self.owners.keys() & assignment.keys())


@lru_cache(maxsize=16)
def _prepare(manifest: Manifest) -> _Prepared:
    radius = manifest.person_radius_m
    resting, movers = sort_obstacles(manifest, radius)
    return _Prepared(
        persons=tuple(_person(manifest, path) for path in manifest.persons if f"{path}.pos.x" in manifest.by_path),
        resting=resting,
        movers=movers,
        owners={path: index for index, mover in enumerate(movers) for path in mover.paths},
        mover_rules=MoverRules(manifest, resting, movers),
        cameras=CameraRules(manifest),
    )


@lru_cache(maxsize=32)
def _settled(manifest: Manifest, moved: frozenset[int]) -> ObstacleMap:
    """Return the map of everything but some movers, at its default place."""
    prepared = _prepare(manifest)
    others = (mover for index, mover in enumerate(prepared.movers) if index not in moved)
    outlines = (outline.footprint for mover in others for outline in mover.shown({}))
    return ObstacleMap((*prepared.resting, *outlines), manifest.person_radius_m)


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
        pose=f"{path}.pose",
        heading=f"{path}.heading",
        default_x=float(default("pos.x", 0.0)),
        default_y=float(default("pos.y", 0.0)),
        default_character=default("character", ""),
        default_visible=default("visible", True),
        default_pose=default("pose", ""),
        default_heading=float(default("heading", 0.0)),
    )
