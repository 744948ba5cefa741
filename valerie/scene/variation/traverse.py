"""All paths of an asset, with the declarations of its manifest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType, Value
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.attributes import ATTRIBUTES, Attribute, Target
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.sensor_parameters import SENSOR_ROOT
from valerie.scene.graph.model import Scene
from valerie.scene.graph.naming import ENVIRONMENT_PATH, SUN_PATH
from valerie.scene.motion.trajectory import Motion
from valerie.scene.variation.variant import apply


@dataclass(frozen=True, slots=True)
class PathEntry:
    """One path of the scene graph.

    Attributes:
        path: e.g. ``scene.car-3.door-1.rot.z``.
        type, unit: type and unit of its values.
        minimum, maximum: the declared range, else the widest sensible range; None if unbounded.
        choices: the known values of a CATEGORICAL path.
        value: current value, with every parameter at its default; degrees for angles.
        declared: True if specs may vary it.
        affects: the stage whose input it is.
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
    """Return every path of an asset: its scene graph in order, then cameras, sun, environment, sensor and trajectories."""
    scene = apply({}, asset)
    holders = [
        *((path, Target.NODE) for path in scene.nodes),
        *((camera.path, Target.CAMERA) for camera in scene.cameras.values()),
        (SUN_PATH, Target.SUN),
        (ENVIRONMENT_PATH, Target.ENVIRONMENT),
        (SENSOR_ROOT, Target.SENSOR),
    ]
    entries = (entry for path, target in holders for entry in _entries(asset, scene, path, target))
    return (*entries, *(declared_entry(definition) for definition in trajectory_parameters(asset.manifest)))


def _entries(asset: SceneAsset, scene: Scene, path: str, target: Target) -> Iterator[PathEntry]:
    for (kind, name), attribute in ATTRIBUTES.items():
        if kind is not target:
            continue
        value = attribute.read(scene, path)
        if value is None:
            continue
        yield _entry(asset, scene, f"{path}.{name}", path, attribute, value)


def trajectory_parameters(manifest: Manifest) -> tuple[ParameterDefinition, ...]:
    """Return the time and the parameters of an asset's own trajectories; empty if it has no trajectory."""
    return Motion(manifest.trajectories, manifest.by_path).parameters if manifest.trajectories else ()


def declared_entry(definition: ParameterDefinition) -> PathEntry:
    """Return the entry of a declared parameter, with its default as value."""
    return PathEntry(
        path=definition.path,
        type=definition.type,
        unit=definition.unit,
        minimum=definition.minimum,
        maximum=definition.maximum,
        choices=definition.choices,
        value=definition.default,
        declared=True,
        affects=definition.affects,
    )


def _entry(asset: SceneAsset, scene: Scene, path: str, target: str, attribute: Attribute, value: Value) -> PathEntry:
    definition = asset.manifest.by_path.get(path)
    if definition is not None:
        minimum, maximum, choices = definition.minimum, definition.maximum, definition.choices
    else:
        minimum, maximum = attribute.minimum, attribute.maximum
        choices = attribute.choices(scene, target)
    if isinstance(value, float):
        # A value computed from a matrix may be 19.999999999999996 instead of 20.
        value = round(value, 9) if math.isfinite(value) else value
    return PathEntry(
        path=path,
        type=attribute.type,
        unit=attribute.unit,
        minimum=minimum,
        maximum=maximum,
        choices=choices,
        value=value,
        declared=definition is not None,
        affects=attribute.affects,
    )
