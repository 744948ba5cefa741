"""Rules for the places of cameras: not inside a house, a parked car or a moving vehicle."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Final

import numpy as np

from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.naming import ROOT
from valerie.scene.legality.movers import Poses, sort_obstacles
from valerie.scene.legality.obstacles import ObstacleMap

#: Room that a camera needs around its centre, metres.
_RADIUS_M: Final = 0.05


class CameraRules:
    """The rules of one manifest for its cameras whose three coordinates are all parameters.

    Args:
        manifest: declares cameras and obstacles.
    """

    def __init__(self, manifest: Manifest) -> None:
        resting, self._movers = sort_obstacles(manifest, _RADIUS_M)
        self._resting = ObstacleMap(resting, _RADIUS_M)
        places = {camera: tuple(f"{ROOT}.{camera}.pos.{axis}" for axis in "xyz") for camera in manifest.cameras}
        self._cameras = tuple(
            self._camera(manifest, name, paths)
            for name, paths in places.items()
            if all(path in manifest.by_path for path in paths)
        )

    def reasons(
        self, assignments: Sequence[Mapping[str, Value]], given: Set[str], poses: Mapping[int, Poses]
    ) -> dict[int, str]:
        """Return the reasons why a camera's place is illegal (``camera-1 is inside car-101``), by index of the variant.

        Args:
            assignments: path to value.
            given: the paths that all of them give.
            poses: the poses of those movers of whose pose they give a part, by index in order.
        """
        near = np.zeros(len(assignments), np.bool_)
        for camera in self._cameras:
            x, y, _ = camera.place.values()
            near |= not camera.paths.isdisjoint(given)
            for number in poses.keys() - camera.within:
                near |= poses[number].near(np.array([x, y]))
        found = ((index, self._reason(assignments[index], poses.keys())) for index in np.flatnonzero(near).tolist())
        return {index: reason for index, reason in found if reason}

    def _reason(self, assignment: Mapping[str, Value], moved: Collection[int]) -> str | None:
        for camera in self._cameras:
            varied = not camera.paths.isdisjoint(assignment)
            if not (varied or moved):
                continue
            x, y, z = (float(assignment.get(path, default)) for path, default in camera.place.items())
            if varied and (obstacle := self._resting.at(x, y, z)):
                return f"{camera.name} is {obstacle.text}"
            for number in range(len(self._movers)) if varied else moved:
                if number in camera.within:
                    continue
                if footprint := self._movers[number].holds(x, y, assignment, z):
                    return f"{camera.name} is {footprint.text}"
        return None

    def _camera(self, manifest: Manifest, name: str, paths: tuple[str, ...]) -> _Camera:
        place = {path: float(manifest.by_path[path].check(manifest.by_path[path].default)) for path in paths}
        x, y, z = place.values()
        within = frozenset(number for number, mover in enumerate(self._movers) if mover.holds(x, y, {}, z))
        return _Camera(name, frozenset(paths), place, within)


@dataclass(frozen=True, slots=True, eq=False)
class _Camera:
    """One camera.

    Attributes:
        paths: paths of its coordinates.
        place: path of x, y and z to default, metres.
        within: indices of the movers that contain it at the default places. It belongs to them and is not judged against them.
    """

    name: str
    paths: frozenset[str]
    place: Mapping[str, float]
    within: frozenset[int]
