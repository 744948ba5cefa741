"""All paths of an asset: what could be varied, and what its manifest declares as variable."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType, Value
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.attributes import ABSENT, ATTRIBUTES, Attribute, Target, characters
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS, SENSOR_ROOT
from valerie.scene.graph.model import POSITIONS, Scene
from valerie.scene.graph.naming import ENVIRONMENT_PATH, SUN_PATH
from valerie.scene.motion.trajectory import Motion
from valerie.scene.variation.applying import apply


@dataclass(frozen=True, slots=True)
class PathEntry:
    """One path of the scene graph.

    Attributes:
        path: e.g. ``scene.car-3.door-1.rot.z``.
        type, unit: of its values.
        minimum, maximum: the declared range where there is one, else the widest that makes sense; None: unbounded.
        choices: of a CATEGORICAL path.
        value: current value, with every parameter at its default; degrees for angles.
        declared: whether specs may vary it.
        affects: the stage that it is an input of.
    """

    path: str
    type: ParameterType
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    value: Value
    declared: bool
    affects: Affects


def traverse(asset: SceneAsset) -> tuple[PathEntry, ...]:
    """Every path of an asset in the order of its scene graph, then cameras, sun, environment, sensor and trajectories."""
    scene = apply({}, asset)
    things = [
        *((path, Target.NODE) for path in scene.nodes),
        *((camera.path, Target.CAMERA) for camera in scene.cameras.values()),
        (SUN_PATH, Target.SUN),
        (ENVIRONMENT_PATH, Target.ENVIRONMENT),
        (SENSOR_ROOT, Target.SENSOR),
    ]
    found = (entry for path, target in things for entry in _entries(asset, scene, path, target))
    return (*found, *(_of_trajectory(one) for one in trajectory_parameters(asset.manifest)))


def _entries(asset: SceneAsset, scene: Scene, path: str, target: Target) -> Iterator[PathEntry]:
    for (kind, name), attribute in ATTRIBUTES.items():
        if kind is not target:
            continue
        value = attribute.read(scene, path)
        if value is None:
            continue
        yield _entry(asset, scene, f"{path}.{name}", path, attribute, value)


def trajectory_parameters(manifest: Manifest) -> tuple[ParameterDefinition, ...]:
    """What can be varied of an asset's own trajectories, and the time; nothing where it has none."""
    return Motion(manifest.trajectories, manifest.by_path).parameters if manifest.trajectories else ()


def _of_trajectory(one: ParameterDefinition) -> PathEntry:
    kind, unit, choices = one.type, one.unit, one.choices
    return PathEntry(one.path, kind, unit, one.minimum, one.maximum, choices, one.default, True, one.affects)


def _entry(asset: SceneAsset, scene: Scene, path: str, thing: str, attribute: Attribute, value: Value) -> PathEntry:
    declared = asset.manifest.by_path.get(path)
    if declared is not None:
        minimum, maximum, choices = declared.minimum, declared.maximum, declared.choices
    else:
        minimum, maximum = attribute.minimum, attribute.maximum
        choices = _choices(scene, thing, path, attribute)
    if isinstance(value, float):
        # Taken back from matrices: nobody wants to read 19.999999999999996.
        value = round(value, 9) if math.isfinite(value) else value
    return PathEntry(
        path=path,
        type=attribute.type,
        unit=attribute.unit,
        minimum=minimum,
        maximum=maximum,
        choices=choices,
        value=value,
        declared=declared is not None,
        affects=attribute.affects,
    )


def _choices(scene: Scene, thing: str, path: str, attribute: Attribute) -> tuple[str, ...]:
    if attribute.type is not ParameterType.CATEGORICAL:
        return ()
    if attribute.target is Target.SENSOR:
        return SENSOR_PARAMETERS[path.removeprefix(f"{SENSOR_ROOT}.")].choices
    if attribute.target is Target.ENVIRONMENT:
        return POSITIONS
    return (*characters(scene, thing), ABSENT)
