"""The scene of a variant, and the inputs of its products.

Both follow from the assignment's canonical form: every declared parameter with its value or default, angles within one turn,
and no parameter without visible effect, such as the pose of an absent person.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from valerie.parameters.assignment import CanonicalJson, canonical_json
from valerie.parameters.definitions import Affects, ParameterType, Value
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.attributes import ABSENT, Attribute, Target, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.draft import Draft
from valerie.scene.graph.model import Scene
from valerie.scene.graph.naming import ROOT
from valerie.scene.graph.transforms import Pose
from valerie.scene.legality.ground import ground_height
from valerie.scene.light.solar import CLOCK_PATHS, angles_of, require_one_notation


@dataclass(frozen=True, slots=True)
class Inputs:
    """The inputs of each product of one camera's frame: path to canonical value, ready to be hashed.

    Attributes:
        geometry: inputs of the truth: poses, characters, the camera's pose and focal length.
        background: inputs of the background: all parameters of the scene that are not below a movable node.
        layer: inputs of the movable layer: all parameters of the scene.
        sensor: inputs of the picture: ``sensor.*``.
    """

    geometry: CanonicalJson
    background: CanonicalJson
    layer: CanonicalJson
    sensor: dict[str, Value]


def complete(assignment: Mapping[str, Value], manifest: Manifest) -> dict[str, Value]:
    """Return the canonical form: declared paths in the manifest's order, without those that a hidden node makes irrelevant.

    Args:
        assignment: path to value (degrees); missing values take their defaults.
        manifest: declares the paths.

    Raises:
        UnknownName: the manifest does not declare a path, or a value is not one of the path's choices.
        InvalidInput: a value has the wrong type or is out of range, or the sun is given both by angles and by time.
    """
    prepared = _prepare(manifest)
    values = dict(prepared.defaults)
    for path, value in assignment.items():
        values[path] = manifest.definition(path).check(value, field=path)
    if prepared.clock:
        _set_sun(values, assignment, prepared.clock)
    return _without_hidden(values, prepared.switches)


def _set_sun(values: dict[str, Value], assignment: Mapping[str, Value], clock: tuple[str, ...]) -> None:
    """Replace time and place by the two angles, so that both notations of the sun give the same inputs."""
    notation = {path: values.pop(path) for path in clock}
    if not notation.keys().isdisjoint(assignment):
        require_one_notation(set(assignment))
        values.update(angles_of(notation))


def split(assignment: Mapping[str, Value], manifest: Manifest, camera: str) -> Inputs:
    """Return the inputs of the products of the frame that ``camera`` takes.

    The parameters of other cameras are not among them.

    Raises:
        UnknownName: the manifest has no such camera; or as `complete`.
        InvalidInput: as `complete`.
    """
    values = complete(assignment, manifest)
    prepared = _prepare(manifest)
    try:
        paths = prepared.cameras[camera]
    except KeyError:
        manifest.require_camera(camera)
        raise
    # Most values are defaults, whose text is precomputed.
    defaults, keys, texts = prepared.defaults, prepared.keys, prepared.texts
    entries = {
        path: texts[path] if value is defaults[path] else keys[path] + canonical_json(value)
        for path, value in values.items()
    }
    return Inputs(
        geometry=_object(entries, paths.geometry),
        background=_object(entries, paths.background),
        layer=_object(entries, paths.layer),
        sensor={path: values[path] for path in prepared.sensor if path in values},
    )


def _object(entries: Mapping[str, bytes], paths: tuple[str, ...]) -> CanonicalJson:
    """Return the canonical JSON of an object; ``paths`` are sorted."""
    return CanonicalJson(b"{%b}" % b",".join([entries[path] for path in paths if path in entries]))


def picture_paths_without_movables(manifest: Manifest, camera: str) -> frozenset[str]:
    """Return the paths that affect the picture of ``camera`` without movables, through the scene or the sensor."""
    prepared = _prepare(manifest)
    return frozenset((*prepared.cameras[camera].background, *prepared.sensor))


def apply(assignment: Mapping[str, Value], asset: SceneAsset) -> Scene:
    """Return the scene of one variant; the asset does not change.

    Equal canonical assignments give equal scenes. Nodes, materials and cameras that no parameter touches keep their identity.

    Raises:
        UnknownName, InvalidInput: as `complete`; or the scene lacks something that the manifest declares.
    """
    manifest = asset.manifest
    prepared = _prepare(manifest)
    defaults = prepared.complete_defaults
    values = complete(assignment, manifest)
    if values == defaults:
        return _default_scene(asset)
    things = {
        prepared.attributes[path][0]
        for path in values.keys() | defaults.keys()
        if values.get(path) != defaults.get(path)
    }
    return _written(_default_scene(asset), values, things, manifest)


@lru_cache(maxsize=4)
def _default_scene(asset: SceneAsset) -> Scene:
    """Return the base scene with every parameter at its default."""
    prepared = _prepare(asset.manifest)
    things = {*(thing for thing, _ in prepared.attributes.values()), *asset.manifest.grounded}
    return _written(asset.base, prepared.complete_defaults, things, asset.manifest)


def _written(scene: Scene, values: Mapping[str, Value], things: set[str], manifest: Manifest) -> Scene:
    """Write *all* values of ``things``, so that the result depends only on these values, not on the previous scene."""
    draft, attributes = Draft(scene), _prepare(manifest).attributes
    for path, value in values.items():
        thing, attribute = attributes[path]
        if thing in things:
            attribute.write(draft, thing, value)
    for path in manifest.grounded:
        if path in things:
            draft.pose(path, lambda pose: _on_ground(pose, manifest))
    return draft.finish()


def _on_ground(pose: Pose, manifest: Manifest) -> Pose:
    x, y, _ = pose.position
    return replace(pose, position=(x, y, ground_height(manifest, x, y)))


#: Paths of parameters that hide something, with the paths that each value makes irrelevant.
_Switches = tuple[tuple[str, dict[Value, tuple[str, ...]]], ...]


@dataclass(frozen=True, slots=True)
class _CameraPaths:
    """The paths of the inputs of one camera's products, sorted."""

    geometry: tuple[str, ...]
    background: tuple[str, ...]
    layer: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Prepared:
    """Everything that follows from the manifest, for hot loops.

    Attributes:
        defaults: declared path to default.
        keys: declared path to its key in a JSON object, with the colon.
        texts: declared path to key and default in JSON.
        complete_defaults: the canonical form of the empty assignment.
        attributes: declared path to the path of its node, camera …, and its attribute.
        switches: the parameters that hide something.
        cameras: camera to the paths of the inputs of its products.
        sensor: declared paths of the sensor.
        clock: declared paths of the sun's time and place, which are never part of a canonical form.
    """

    defaults: dict[str, Value]
    keys: dict[str, bytes]
    texts: dict[str, bytes]
    complete_defaults: dict[str, Value]
    attributes: dict[str, tuple[str, Attribute]]
    switches: _Switches
    cameras: dict[str, _CameraPaths]
    sensor: tuple[str, ...]
    clock: tuple[str, ...]


@lru_cache(maxsize=16)
def _prepare(manifest: Manifest) -> _Prepared:
    defaults = {definition.path: definition.check(definition.default) for definition in manifest.parameters}
    attributes = {path: resolve(path, manifest.cameras) for path in defaults}
    switches = tuple(_switches(manifest, attributes))
    clock = tuple(path for path in CLOCK_PATHS if path in defaults)
    by_angles = {path: value for path, value in defaults.items() if path not in clock}
    keys = {path: canonical_json(path) + b":" for path in defaults}
    return _Prepared(
        defaults=defaults,
        keys=keys,
        texts={path: keys[path] + canonical_json(value) for path, value in defaults.items()},
        complete_defaults=_without_hidden(by_angles, switches),
        attributes=attributes,
        switches=switches,
        cameras={camera: _camera_paths(manifest, camera, attributes) for camera in manifest.cameras},
        sensor=tuple(path for path, (_, attribute) in attributes.items() if attribute.target is Target.SENSOR),
        clock=clock,
    )


def _camera_paths(manifest: Manifest, camera: str, attributes: Mapping[str, tuple[str, Attribute]]) -> _CameraPaths:
    layer = [
        path
        for path, (thing, attribute) in sorted(attributes.items())
        if attribute.target is not Target.SENSOR
        and (attribute.target is not Target.CAMERA or thing == f"{ROOT}.{camera}")
    ]
    return _CameraPaths(
        geometry=tuple(path for path in layer if attributes[path][1].affects is Affects.GEOMETRY),
        background=tuple(path for path in layer if not manifest.is_movable(path)),
        layer=tuple(layer),
    )


def _switches(
    manifest: Manifest, attributes: Mapping[str, tuple[str, Attribute]]
) -> Iterator[tuple[str, dict[Value, tuple[str, ...]]]]:
    """Yield the parameters that hide something, root first, since a hidden node hides those below it."""
    for path in sorted(attributes, key=lambda path: path.count(".")):
        thing, attribute = attributes[path]
        below = [other for other in attributes if other != path and other.startswith(f"{thing}.")]
        if attribute.target is Target.NODE and attribute.type is ParameterType.BOOL:
            yield path, {False: tuple(below)}
        elif attribute.target is Target.NODE and attribute.type is ParameterType.CATEGORICAL:
            choices = manifest.definition(path).choices
            if attribute.name == "pose":
                yield path, {choice: (f"{thing}.gait_phase",) for choice in choices if choice not in manifest.gaits}
                continue
            yield (
                path,
                {
                    choice: tuple(
                        other
                        for other in below
                        if choice == ABSENT
                        or any(other.startswith(f"{thing}.{unchosen}.") for unchosen in choices if unchosen != choice)
                    )
                    for choice in choices
                },
            )


def _without_hidden(values: dict[str, Value], switches: _Switches) -> dict[str, Value]:
    for path, hides in switches:
        if path in values:
            for hidden in hides.get(values[path], ()):
                values.pop(hidden, None)
    return values
