"""Reject impossible variants: nothing may be inside something else or outside the asset, and weather may not contradict itself.

The manifest alone decides, without meshes or GL. Obstacles are widened once by the room that a person needs, and a grid over the
ground finds the few of them near a point. Movers are judged by `valerie.scene.legality.mover_rules`,
cameras by `valerie.scene.legality.camera_rules`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.parameters.definitions import Value
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.assets.manifest import Footprint, Manifest, Point
from valerie.scene.graph.naming import ROOT
from valerie.scene.graph.transforms import cos_sin
from valerie.scene.legality.camera_rules import CameraRules
from valerie.scene.legality.mover_rules import MoverRules
from valerie.scene.legality.movers import Mover, Poses, sort_obstacles
from valerie.scene.legality.obstacles import ObstacleMap
from valerie.scene.legality.weather_rules import WEATHER_PATHS, weather_reason

#: Arrays cost more than they save for up to this many variants.
_FEW: Final = 8


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
    return rejection_reasons((assignment,), manifest)[0]


def rejection_reasons(assignments: Sequence[Mapping[str, Value]], manifest: Manifest) -> list[str | None]:
    """Return the `rejection_reason` of each variant, in a fraction of the time."""
    prepared, alike = _prepare(manifest), dict[frozenset[str], list[int]]()
    for index, assignment in enumerate(assignments):
        alike.setdefault(frozenset(assignment), []).append(index)
    reasons: list[str | None] = [None] * len(assignments)
    for given, indices in alike.items():
        for index, reason in _reasons([assignments[i] for i in indices], given, prepared).items():
            reasons[indices[index]] = reason
    return reasons


def _reasons(assignments: Sequence[Mapping[str, Value]], given: Set[str], prepared: _Prepared) -> dict[int, str]:
    """Return the reasons of variants that give the same paths, by index."""
    manifest = prepared.manifest
    poses = {number: prepared.movers[number].poses(assignments) for number in prepared.moved(given)}
    if WEATHER_PATHS.isdisjoint(given) and weather_reason({}, manifest) is None:
        reasons = {}
    else:
        reasons = {i: reason for i, values in enumerate(assignments) if (reason := weather_reason(values, manifest))}
    # What is found last takes precedence.
    reasons |= prepared.cameras.reasons(assignments, given, poses)
    reasons |= prepared.mover_rules.reasons(poses)
    count = len(assignments)
    crowded = np.ones(count, np.bool_) if count <= _FEW else _crowded(assignments, given, poses, prepared)
    for index in np.flatnonzero(crowded).tolist():
        standing = prepared.standing(assignments[index])
        if reason := _obstructed(standing, poses.keys(), assignments[index], prepared) or _overlap(standing, prepared):
            reasons[index] = reason
    return reasons


def _crowded(
    assignments: Sequence[Mapping[str, Value]], given: Set[str], poses: Mapping[int, Poses], prepared: _Prepared
) -> NDArray[np.bool_]:
    """Return (N,) False for those of N variants in which all persons surely have their room."""
    manifest, count = prepared.manifest, len(assignments)
    crowded, settled, (x0, y0, x1, y1) = np.zeros(count, np.bool_), _settled(manifest, tuple(poses)), manifest.extent
    distance = 2.0 * manifest.person_radius_m + 1e-9
    places: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for person in prepared.persons:
        # A person of which the variants give nothing stands at the same place in all of them.
        varied = not person.paths.isdisjoint(given)
        standing = [list(person.circles(values, manifest.reaches)) for values in (assignments if varied else ({},))]
        indices = np.repeat(np.arange(len(standing)), [len(circles) for circles in standing])
        points = np.array([circle[2:] for circles in standing for circle in circles]).reshape(-1, 2)
        x, y = points.T
        touched = (x < x0) | (x > x1) | (y < y0) | (y > y1) | settled.near(x, y)
        for those in poses.values():
            if varied:
                touched |= those.near(points, indices)
            else:
                for point in points:
                    crowded |= those.near(point)
        crowded |= np.bincount(indices[touched], minlength=len(standing)) > 0
        own = np.array([circles[0][2:] if circles else (np.nan, np.nan) for circles in standing])
        reach = np.array(
            [max((math.dist(circles[0][2:], c[2:]) for c in circles), default=0.0) for circles in standing]
        )
        for other, its_reach in places:
            crowded |= np.hypot(*(own - other).T) < distance + reach + its_reach
        places.append((own, reach))
    return crowded


def _obstructed(
    standing: Sequence[_Circle], moved: Iterable[int], assignment: Mapping[str, Value], prepared: _Prepared
) -> str | None:
    """Return the reason why persons cannot stand where they do, regardless of each other."""
    x0, y0, x1, y1 = prepared.manifest.extent
    settled, movers = _settled(prepared.manifest, tuple(moved)), [prepared.movers[index] for index in moved]
    for name, pose, x, y in standing:
        if not (x0 <= x <= x1 and y0 <= y <= y1):
            return f"{name} in the pose {pose} reaches out of the asset" if pose else f"{name} is outside the asset"
        held = (footprint for mover in movers if (footprint := mover.holds(x, y, assignment)))
        if footprint := settled.at(x, y) or next(held, None):
            return f"{name} in the pose {pose} reaches {footprint.text}" if pose else f"{name} stands {footprint.text}"
    return None


def _overlap(standing: Sequence[_Circle], prepared: _Prepared) -> str | None:
    distance = 2.0 * prepared.manifest.person_radius_m
    for index, (name, _, x, y) in enumerate(standing):
        for other, _, other_x, other_y in standing[:index]:
            if name != other and (x - other_x) ** 2 + (y - other_y) ** 2 < distance * distance:
                return f"{other} and {name} overlap"
    return None


#: A circle of the ground that a person needs: name, pose (empty for the person's own circle), and the middle's x and y, metres.
_Circle = tuple[str, str, float, float]


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

    @property
    def paths(self) -> frozenset[str]:
        """Return the paths that decide where it stands."""
        return frozenset((self.x, self.y, self.character, self.visible, self.pose, self.heading))

    def circles(self, assignment: Mapping[str, Value], reaches: Mapping[str, Sequence[Point]]) -> Iterator[_Circle]:
        """Yield the circles of the ground that it needs, its own first; none if it is absent or hidden."""
        get = assignment.get
        if get(self.character, self.default_character) == ABSENT or get(self.visible, self.default_visible) is False:
            return
        x, y = float(get(self.x, self.default_x)), float(get(self.y, self.default_y))
        yield self.name, "", x, y
        pose = str(get(self.pose, self.default_pose))
        if further := reaches.get(pose):
            cos, sin = cos_sin(float(get(self.heading, self.default_heading)))
            for across, ahead in further:
                yield self.name, pose, x + cos * across - sin * ahead, y + sin * across + cos * ahead


@dataclass(frozen=True, slots=True)
class _Prepared:
    """Everything that follows from the manifest.

    Attributes:
        resting: the obstacles at rest.
        movers: all others.
        owners: path of each pose parameter of a mover to the index of the mover.
    """

    manifest: Manifest
    persons: tuple[_Person, ...]
    resting: tuple[Footprint, ...]
    movers: tuple[Mover, ...]
    owners: Mapping[str, int]
    mover_rules: MoverRules
    cameras: CameraRules

    def moved(self, given: Set[str]) -> tuple[int, ...]:
        """Return the indices of the movers of whose pose a variant gives a part, one of these paths, in order."""
        return tuple(sorted({self.owners[path] for path in self.owners.keys() & given}))

    def standing(self, assignment: Mapping[str, Value]) -> list[_Circle]:
        """Return the circles of the ground that all persons need, in their order."""
        reaches = self.manifest.reaches
        return [circle for person in self.persons for circle in person.circles(assignment, reaches)]


@lru_cache(maxsize=16)
def _prepare(manifest: Manifest) -> _Prepared:
    radius = manifest.person_radius_m
    resting, movers = sort_obstacles(manifest, radius)
    owners = {path: index for index, mover in enumerate(movers) for path in mover.paths}
    return _Prepared(
        manifest=manifest,
        persons=tuple(_person(manifest, path) for path in manifest.persons if f"{path}.pos.x" in manifest.by_path),
        resting=resting,
        movers=movers,
        owners=owners,
        mover_rules=MoverRules(manifest, resting, movers),
        cameras=CameraRules(manifest),
    )


@lru_cache(maxsize=32)
def _settled(manifest: Manifest, moved: tuple[int, ...]) -> ObstacleMap:
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
