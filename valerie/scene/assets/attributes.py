"""The table of attributes that can vary, by kind of target. `valerie.scene.variation` reads it.

A new attribute is a new row: name, kind of target, type, unit, range, the stage whose input it is, and functions that read its
value from a scene and write it into a draft.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Final, cast

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import Affects, ParameterType, Value
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS, SENSOR_ROOT
from valerie.scene.graph.draft import CameraAngle, CameraPose, Draft, cloth_materials, figures, paint_materials
from valerie.scene.graph.model import CLEAR_VISIBILITY_M, POSITIONS, Scene
from valerie.scene.graph.naming import ENVIRONMENT_PATH, ROOT, SUN_PATH, parse_object_name
from valerie.scene.graph.transforms import Pose
from valerie.scene.light.solar import CLOCK

#: The choice that hides a person or a vehicle, instead of a character or kind.
ABSENT: Final = "absent"
#: Classes whose objects have a front. Their rotation about z is called heading.
FACING_CLASSES: Final = frozenset(
    {"person", "rider", "car", "truck", "bus", "caravan", "trailer", "train", "motorcycle", "bicycle"}
)

_PEOPLE: Final = frozenset({"person", "rider"})
#: Classes whose objects show one of several kinds.
_CHANGING: Final = FACING_CLASSES - _PEOPLE | {"traffic-light"}

Read = Callable[[Scene, str], Value | None]
Write = Callable[[Draft, str, Value], None]
Choices = Callable[[Scene, str], tuple[str, ...]]


def _no_choices(_scene: Scene, _path: str) -> tuple[str, ...]:
    return ()


class Target(StrEnum):
    """The kinds of targets that have attributes."""

    NODE = "node"
    CAMERA = "camera"
    SUN = "sun"
    ENVIRONMENT = "environment"
    SENSOR = "sensor"


@dataclass(frozen=True, slots=True)
class Attribute:
    """One attribute of one kind of target.

    Attributes:
        name: the end of a path, e.g. ``pos.x``.
        minimum, maximum: the widest sensible range. An asset declares its own.
        affects: the stage whose input it is.
        read: returns the value at a path (degrees for angles), or None if the target lacks the attribute.
        write: writes a value into a draft. Grounded nodes get their z afterwards.
        choices: returns the values of a CATEGORICAL attribute at a path that the scene has.
    """

    name: str
    target: Target
    type: ParameterType
    unit: str
    minimum: float | None
    maximum: float | None
    affects: Affects
    read: Read
    write: Write
    choices: Choices = _no_choices


def target_of(path: str, cameras: Iterable[str]) -> Target:
    """Return the kind of target at a path without attribute.

    Args:
        path: e.g. ``scene.person-1`` or ``sensor``.
        cameras: names of the scene's cameras.
    """
    if path == SENSOR_ROOT:
        return Target.SENSOR
    if path == SUN_PATH:
        return Target.SUN
    if path == ENVIRONMENT_PATH:
        return Target.ENVIRONMENT
    return Target.CAMERA if path.removeprefix(f"{ROOT}.") in cameras else Target.NODE


def resolve(path: str, cameras: Iterable[str], *, field: str = "") -> tuple[str, Attribute]:
    """Split a parameter path into the target's path and its attribute: the longest ending that names an attribute.

    Raises:
        UnknownName: the target has no such attribute. The message lists near matches.
    """
    parts = path.split(".")
    for length in (2, 1):
        target, name = ".".join(parts[:-length]), ".".join(parts[-length:])
        if target and (attribute := ATTRIBUTES.get((target_of(target, cameras), name))):
            return target, attribute
    target = target_of(".".join(parts[:-1]), cameras)
    names = [name for kind, name in ATTRIBUTES if kind is target]
    raise UnknownName(f"{target} attribute", parts[-1], names, field=field or path)


def _number(value: Value, name: str) -> float:
    if isinstance(value, str | bool):
        raise InvalidInput("takes a number", field=name, value=value)
    return float(value)


_AXES: Final = {"x": 0, "y": 1, "z": 2}


def _with(values: tuple[float, float, float], axis: int, value: float) -> tuple[float, float, float]:
    x, y, z = (value if i == axis else v for i, v in enumerate(values))
    return x, y, z


def _position(axis: int) -> tuple[Read, Write]:
    def read(scene: Scene, path: str) -> Value:
        return float(scene.nodes[path].transform[axis, 3])

    def write(draft: Draft, path: str, value: Value) -> None:
        number = _number(value, path)
        draft.pose(path, lambda pose: replace(pose, position=_with(pose.position, axis, number)))

    return read, write


def _rotation(axis: int, *, heading: bool = False) -> tuple[Read, Write]:
    def read(scene: Scene, path: str) -> Value | None:
        name = parse_object_name(path.rpartition(".")[2])
        if heading and (name is None or name[0] not in FACING_CLASSES):
            return None
        return Pose.of(scene.nodes[path].transform).angles[axis]

    def write(draft: Draft, path: str, value: Value) -> None:
        number = _number(value, path)
        draft.pose(path, lambda pose: replace(pose, angles=_with(pose.angles, axis, number)))

    return read, write


def _read_scale(scene: Scene, path: str) -> Value | None:
    x, y, z = Pose.of(scene.nodes[path].transform).scale
    return x if math.isclose(x, y, rel_tol=1e-9) and math.isclose(x, z, rel_tol=1e-9) else None


def _write_scale(draft: Draft, path: str, value: Value) -> None:
    number = _number(value, path)
    draft.pose(path, lambda pose: replace(pose, scale=(number, number, number)))


def _read_visible(scene: Scene, path: str) -> Value:
    return scene.nodes[path].visible


def _write_visible(draft: Draft, path: str, value: Value) -> None:
    draft.show(path, bool(value))


def characters(scene: Scene, path: str) -> tuple[str, ...]:
    """Return the characters of a person: the direct children of its node whose names state no class."""
    return _looks(scene, path, _PEOPLE)


def kinds(scene: Scene, path: str) -> tuple[str, ...]:
    """Return the kinds of a vehicle, or the phases of a signal: its node's direct children whose names state no class."""
    return _looks(scene, path, _CHANGING)


def faces(scene: Scene, path: str) -> tuple[str, ...]:
    """Return the faces of a traffic sign: the direct children of its node whose names state no class."""
    return _looks(scene, path, frozenset({"traffic-sign"}))


def _looks(scene: Scene, path: str, classes: frozenset[str]) -> tuple[str, ...]:
    name = parse_object_name(path.rpartition(".")[2])
    if name is None or name[0] not in classes:
        return ()
    children = [node.name for node in scene.nodes.values() if node.parent == path]
    return tuple(name for name in children if parse_object_name(name) is None)


def _chosen(looks: Choices) -> tuple[Read, Write, Choices]:
    def read(scene: Scene, path: str) -> Value | None:
        names = looks(scene, path)
        visible = [name for name in names if scene.nodes[f"{path}.{name}"].visible]
        return (visible[0] if visible else ABSENT) if names else None

    def write(draft: Draft, path: str, value: Value) -> None:
        draft.choose(path, None if value == ABSENT else str(value))

    def choices(scene: Scene, path: str) -> tuple[str, ...]:
        return (*looks(scene, path), ABSENT)

    return read, write, choices


def _stance(field: str) -> tuple[Read, Write]:
    def read(scene: Scene, path: str) -> Value | None:
        bodies = figures(scene, path)
        return cast("Value", getattr(bodies[0].stance, field)) if bodies else None

    def write(draft: Draft, path: str, value: Value) -> None:
        draft.stance(path, **{field: value})

    return read, write


def _cloth(field: str) -> tuple[Read, Write]:
    def read(scene: Scene, path: str) -> Value | None:
        materials = cloth_materials(scene, path)
        return float(getattr(scene.materials[materials[0]], field)) if materials else None

    def write(draft: Draft, path: str, value: Value) -> None:
        draft.cloth(path, **{field: _number(value, path)})

    return read, write


def _read_colour(scene: Scene, path: str) -> Value | None:
    materials = paint_materials(scene, path)
    if not materials:
        return None
    material = scene.materials[materials[0]]
    return next((name for name, paint in scene.paints.items() if paint.base_color == material.base_color), None)


def _write_colour(draft: Draft, path: str, value: Value) -> None:
    draft.paint(path, str(value))


def _camera_position(axis: int) -> tuple[Read, Write]:
    def read(scene: Scene, path: str) -> Value:
        return float(Draft(scene).camera(path).position[axis])

    def write(draft: Draft, path: str, value: Value) -> None:
        number = _number(value, path)
        draft.camera_pose(path, lambda pose: replace(pose, position=_with(pose.position, axis, number)))

    return read, write


def _camera_angle(name: CameraAngle) -> tuple[Read, Write]:
    def read(scene: Scene, path: str) -> Value:
        return float(getattr(CameraPose.of(Draft(scene).camera(path)), name))

    def write(draft: Draft, path: str, value: Value) -> None:
        number = _number(value, path)
        draft.camera_pose(path, lambda pose: pose.with_angle(name, number))

    return read, write


def _read_focal_length(scene: Scene, path: str) -> Value:
    return Draft(scene).camera(path).focal_length_mm


def _write_focal_length(draft: Draft, path: str, value: Value) -> None:
    draft.focal_length(path, _number(value, path))


def _sun(field: str, *, angle: bool) -> tuple[Read, Write]:
    def read(scene: Scene, _: str) -> Value:
        value = float(getattr(scene.sun, field))
        return math.degrees(value) if angle else value

    def write(draft: Draft, path: str, value: Value) -> None:
        number = _number(value, path)
        draft.sun(**{field: math.radians(number) if angle else number})

    return read, write


#: Linear RGB of a light by the last part of the attribute's name.
_CHANNELS: Final = {"red": 0, "green": 1, "blue": 2}


def _light(field: str, *, angle: bool = False) -> tuple[Read, Write]:
    def read(scene: Scene, path: str) -> Value | None:
        light = scene.nodes[path].light
        if light is None:
            return None
        if field in _CHANNELS:
            return float(light.color[_CHANNELS[field]])
        value = float(getattr(light, field))
        return math.degrees(value) if angle else value

    def write(draft: Draft, path: str, value: Value) -> None:
        number = _number(value, path)
        if field in _CHANNELS:
            draft.light_channel(path, _CHANNELS[field], number)
        else:
            draft.light(path, **{field: math.radians(number) if angle else number})

    return read, write


def _lamps(field: str) -> tuple[Read, Write]:
    def read(scene: Scene, _: str) -> Value:
        return str(getattr(scene.environment, field))

    def write(draft: Draft, path: str, value: Value) -> None:
        if value not in POSITIONS:
            raise UnknownName("position of the switch", str(value), POSITIONS, field=path)
        draft.environment(**{field: value})

    return read, write


def _environment(field: str) -> tuple[Read, Write]:
    def read(scene: Scene, _: str) -> Value:
        return float(getattr(scene.environment, field))

    def write(draft: Draft, path: str, value: Value) -> None:
        draft.environment(**{field: _number(value, path)})

    return read, write


def _not_in_the_scene(neutral: Value) -> tuple[Read, Write]:
    """Return functions for attributes that are not part of a scene: those of the sensor, and the sun's time and place."""

    def read(_scene: Scene, _path: str) -> Value:
        return neutral

    def write(_draft: Draft, _path: str, _value: Value) -> None:
        return None

    return read, write


def _fixed(choices: tuple[str, ...], _scene: Scene, _path: str) -> tuple[str, ...]:
    return choices


def _table() -> Iterable[Attribute]:
    number, angle = ParameterType.FLOAT, ParameterType.ANGLE
    geometry, light, material = Affects.GEOMETRY, Affects.LIGHT, Affects.MATERIAL
    node, camera, sun, sky, sensor = Target
    for letter, axis in _AXES.items():
        yield Attribute(f"pos.{letter}", node, number, "m", None, None, geometry, *_position(axis))
        yield Attribute(f"pos.{letter}", camera, number, "m", None, None, geometry, *_camera_position(axis))
    for letter, axis in _AXES.items():
        yield Attribute(f"rot.{letter}", node, angle, "deg", 0, 360, geometry, *_rotation(axis))
    yield Attribute("heading", node, angle, "deg", 0, 360, geometry, *_rotation(2, heading=True))
    yield Attribute("scale", node, number, "", 1e-3, 1e3, geometry, _read_scale, _write_scale)
    yield Attribute("visible", node, ParameterType.BOOL, "", None, None, geometry, _read_visible, _write_visible)
    name = ParameterType.CATEGORICAL
    yield Attribute("character", node, name, "", None, None, geometry, *_chosen(characters))
    yield Attribute("kind", node, name, "", None, None, geometry, *_chosen(kinds))
    yield Attribute("face", node, name, "", None, None, geometry, *_chosen(faces))
    yield Attribute(
        "colour",
        node,
        name,
        "",
        None,
        None,
        material,
        _read_colour,
        _write_colour,
        lambda scene, _: tuple(scene.paints),
    )
    for field in ("pose", "carries"):
        yield Attribute(field, node, name, "", None, None, geometry, *_stance(field))
    yield Attribute("gait_phase", node, number, "", 0, 1, geometry, *_stance("gait_phase"))
    for field in ("metallic", "roughness", "specular_tint"):
        yield Attribute(f"cloth.{field}", node, number, "", 0, 1, material, *_cloth(field))
    yield Attribute("yaw", camera, angle, "deg", 0, 360, geometry, *_camera_angle("yaw"))
    yield Attribute("pitch", camera, number, "deg", -90, 90, geometry, *_camera_angle("pitch"))
    yield Attribute("roll", camera, angle, "deg", 0, 360, geometry, *_camera_angle("roll"))
    yield Attribute("focal_length_mm", camera, number, "mm", 1, 2000, geometry, _read_focal_length, _write_focal_length)
    yield Attribute("azimuth", sun, angle, "deg", 0, 360, light, *_sun("azimuth", angle=True))
    yield Attribute("elevation", sun, number, "deg", -90, 90, light, *_sun("elevation", angle=True))
    yield Attribute("irradiance", sun, number, "", 0, 100, light, *_sun("irradiance", angle=False))
    for clock in CLOCK:
        low, high = clock.minimum, clock.maximum
        yield Attribute(clock.name, sun, clock.type, clock.unit, low, high, light, *_not_in_the_scene(clock.default))
    yield Attribute("turbidity", sky, number, "", 1.7, 10, light, *_environment("turbidity"))
    yield Attribute("sky_strength", sky, number, "", 0, 100, light, *_environment("sky_strength"))
    yield Attribute("cloud_cover", sky, number, "", 0, 1, light, *_environment("cloud_cover"))
    yield Attribute("visibility", sky, number, "m", 10, CLEAR_VISIBILITY_M, light, *_environment("visibility"))
    yield Attribute("rain", sky, number, "mm/h", 0, 100, light, *_environment("rain"))
    yield Attribute("snowfall", sky, number, "mm/h", 0, 20, light, *_environment("snowfall"))
    yield Attribute("snow_depth", sky, number, "m", 0, 0.5, light, *_environment("snow_depth"))
    yield Attribute("leaf_litter", sky, number, "", 0, 1, light, *_environment("leaf_litter"))
    for field in ("street_lamps", "car_lamps"):
        yield Attribute(field, sky, name, "", None, None, light, *_lamps(field), lambda *_: POSITIONS)
    yield Attribute("light.intensity_cd", node, number, "cd", 0, 1e6, light, *_light("intensity"))
    for field in _CHANNELS:
        yield Attribute(f"light.{field}", node, number, "", 0, 1, light, *_light(field))
    yield Attribute("light.inner_deg", node, number, "deg", 0, 180, light, *_light("inner", angle=True))
    yield Attribute("light.outer_deg", node, number, "deg", 0, 180, light, *_light("outer", angle=True))
    yield Attribute("light.radius_m", node, number, "m", 0, 10, light, *_light("radius"))
    for row in SENSOR_PARAMETERS.values():
        ends = (row.minimum, row.maximum)
        read, write = _not_in_the_scene(row.neutral)
        choices = partial(_fixed, row.choices)
        yield Attribute(row.name, sensor, row.type, row.unit, *ends, row.affects, read, write, choices)


#: (kind of target, attribute name) to attribute.
ATTRIBUTES: Final = {(attribute.target, attribute.name): attribute for attribute in _table()}
