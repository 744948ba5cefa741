"""The built-in asset ``urban-street``: a generated street, two pedestrians, three cameras and the sun.

The cameras (50 mm on a 36 mm wide sensor: 39.6° × 22.9° at 16:9) stand at y = −12 m, so that each of the paper's
positions (x −2…7 m, y 5…35 m; section 6.1) is at least 17 m from every optical centre and inside every image. Measured
with the truth pass at 960×540 over these positions and both characters, headings mixed (seed 0; *alone* is the share of
the image that nothing hides):

==== ============ ===================
y    distance     pixel area, alone
==== ============ ===================
5    17.1…18.4 m  0.58…0.82 %
11   23.0…24.0 m  0.32…0.45 %
17   29.0…29.8 m  0.20…0.28 %
23   35.0…35.7 m  0.14…0.19 %
29   41.0…41.6 m  0.11…0.14 %
35   47.0…47.5 m  0.07…0.11 %
==== ============ ===================

There 22…39 % of a camera's frames are occluded by 5…75 %, about half by more than 5 %, and 3…5 % of the persons are fully
hidden. The paper's 17…38.2 m are y 5…26.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from pydantic import SerializerFunctionWrapHandler, model_serializer

from valerie.errors import InvalidInput
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType
from valerie.scene.asset import GeneratorSettings
from valerie.scene.attributes import ABSENT
from valerie.scene.manifest import Footprint, GroundRegion, Manifest
from valerie.scene.model import Camera, Environment, Material, Node, Scene, Sun, Texture
from valerie.scene.naming import ENVIRONMENT_PATH, ROOT, SUN_PATH
from valerie.scene.objects import classified
from valerie.scene.procedural.street.layout import layout_street
from valerie.scene.procedural.street.plan import StreetLayout, StreetSettings
from valerie.scene.sensor_parameters import SENSOR_PARAMETERS
from valerie.scene.transforms import camera_transform, place

NAME: Final = "urban-street"
#: Raised by hand whenever the street, the characters, cameras or defaults change: part of the asset's digest.
REVISION: Final = 2

#: Compass bearing of the street (+y), south-south-west: at noon the sun stands ahead, a little to the left.
BEARING_DEG: Final = 200.0
SUN_AZIMUTH_DEG: Final = 180.0
SUN_ELEVATION_DEG: Final = 40.0
SENSOR_WIDTH_MM: Final = 36.0

#: What the persons can look like; the names are those of the characters that `human.build_character` makes.
CHARACTERS: Final = ("black-outfit", "yellow-shirt")
#: Radius in metres that a pedestrian needs to stand; arms may reach over a bonnet.
PERSON_RADIUS_M: Final = 0.3

#: How far above the ground things of a class reach, metres, where a camera may look over them.
_HEIGHTS_M: Final = {"car": 2.0, "static": 1.3, "wall": 1.1, "fence": 1.3}


class Settings(StreetSettings, GeneratorSettings):
    """What the street can be told: see `StreetSettings`."""

    @model_serializer(mode="wrap")
    def _told(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The seed and what differs from the default: a new argument leaves the digests of older assets alone."""
        fields = type(self).model_fields
        return {name: value for name, value in handler(self).items() if name == "seed" or value != fields[name].default}


@dataclass(frozen=True, slots=True)
class CameraPlace:
    """Where a camera stands: metres and degrees (`camera_transform`), focal length on a 36 mm wide sensor."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    focal_length_mm: float = 50.0


#: In the lane at a driver's height; near the left kerb, turned a little right; higher on the right, as in a van.
CAMERAS: Final = {
    "camera-1": CameraPlace((2.5, -12.0, 1.4), 0.0, 0.0),
    "camera-2": CameraPlace((0.6, -12.0, 1.3), 358.0, 0.0),
    "camera-3": CameraPlace((4.6, -12.0, 2.2), 2.5, -1.0),
}


@dataclass(frozen=True, slots=True)
class PersonPlace:
    """Where a person stands by default (metres, degrees) and as whom."""

    x: float
    y: float
    heading: float
    character: str


PERSONS: Final = {
    "person-1": PersonPlace(3.0, 20.0, 180.0, "yellow-shirt"),
    "person-2": PersonPlace(1.5, 24.0, 0.0, ABSENT),
}


def make_manifest(settings: Settings) -> Manifest:
    """What the asset declares; milliseconds, no meshes."""
    layout = layout_street(settings)
    return Manifest(
        name=NAME,
        title="Urban street",
        description=f"A generated street of {settings.length_m:.0f} m with houses, trees and parked cars, and two pedestrians.",
        bearing_deg=BEARING_DEG,
        extent=layout.extent,
        parameters=tuple(_parameters()),
        movable=tuple(f"{ROOT}.{person}" for person in PERSONS),
        obstacles=tuple(_obstacles(layout)),
        ground=tuple(GroundRegion(polygon=region.polygon, height=region.height) for region in layout.ground),
        persons=tuple(f"{ROOT}.{person}" for person in PERSONS),
        person_radius_m=PERSON_RADIUS_M,
        cameras=tuple(CAMERAS),
    )


def make_scene(settings: Settings, manifest: Manifest) -> Scene:
    """The street with both persons in it; a few CPU seconds."""
    from valerie.scene.procedural.street.build import build_street

    content = build_street(layout_street(settings))
    nodes = [Node(part.path, part.transform, part.meshes) for part in content.parts]
    persons = _Persons()
    for name, person in PERSONS.items():
        nodes += persons.nodes(name, person)
    twice = (content.materials.keys() & persons.materials.keys()) | (content.textures.keys() & persons.textures.keys())
    if twice:
        raise InvalidInput("the street and its people use the same name", field=NAME, value=min(twice))
    return Scene(
        nodes=classified(nodes, manifest.node_classes, manifest.movable),
        materials=content.materials | persons.materials,
        textures=content.textures | persons.textures,
        cameras={name: _camera(name, camera) for name, camera in CAMERAS.items()},
        sun=Sun(azimuth=math.radians(SUN_AZIMUTH_DEG), elevation=math.radians(SUN_ELEVATION_DEG)),
        environment=Environment(bearing=math.radians(BEARING_DEG)),
    )


def _obstacles(layout: StreetLayout) -> Iterator[Footprint]:
    for footprint in layout.footprints:
        name = footprint.path.rpartition(".")[2]
        object_class = name.rpartition("-")[0]
        yield Footprint(
            path=footprint.path,
            polygon=footprint.polygon,
            reason=f"inside {name}",
            height_m=footprint.height or _HEIGHTS_M.get(object_class),
        )


def _camera(name: str, camera: CameraPlace) -> Camera:
    transform = camera_transform(camera.position, camera.yaw, camera.pitch, 0.0)
    return Camera(f"{ROOT}.{name}", transform, camera.focal_length_mm, SENSOR_WIDTH_MM)


class _Persons:
    """Nodes, materials and textures of persons; each person gets materials of its own, since each varies alone."""

    def __init__(self) -> None:
        from valerie.scene.procedural.human import build_character

        self._characters = {name: build_character(name) for name in CHARACTERS}
        self.materials: dict[str, Material] = {}
        self.textures: dict[str, Texture] = {}

    def nodes(self, name: str, person: PersonPlace) -> Iterator[Node]:
        """The node of a person and one child per character, of which the chosen one is shown."""
        path = f"{ROOT}.{name}"
        shown = person.character != ABSENT
        yield Node(path, place(person.x, person.y, 0.0, person.heading), visible=shown)
        for character_name, character in self._characters.items():
            for material in character.materials.values():
                own = f"{name}/{material.name}"
                self.materials[own] = replace(material, name=own)
            self.textures.update(character.textures)
            meshes = tuple(replace(mesh, material=f"{name}/{mesh.material}") for mesh in character.meshes)
            visible = shown and character_name == person.character
            yield Node(f"{path}.{character_name}", np.eye(4), meshes, visible=visible)


def _parameters() -> Iterator[ParameterDefinition]:
    for name, person in PERSONS.items():
        path = f"{ROOT}.{name}"
        yield _number(f"{path}.pos.x", -10.0, 20.0, person.x, Affects.GEOMETRY, "m", "across the street")
        yield _number(f"{path}.pos.y", 0.0, 100.0, person.y, Affects.GEOMETRY, "m", "along the street")
        yield _angle(f"{path}.heading", person.heading, Affects.GEOMETRY, "0 faces +y, counter-clockwise from above")
        yield ParameterDefinition(
            path=f"{path}.character",
            type=ParameterType.CATEGORICAL,
            choices=(*CHARACTERS, ABSENT),
            default=person.character,
            affects=Affects.GEOMETRY,
            description="who is seen, or nobody",
        )
        for field, default in (("metallic", 0.0), ("roughness", 0.8), ("specular_tint", 0.0)):
            yield _number(f"{path}.cloth.{field}", 0.0, 1.0, default, Affects.MATERIAL, "", "of everything worn")
    yield _angle(f"{SUN_PATH}.azimuth", SUN_AZIMUTH_DEG, Affects.LIGHT, "clockwise from north")
    yield _number(f"{SUN_PATH}.elevation", 3.0, 75.0, SUN_ELEVATION_DEG, Affects.LIGHT, "deg", "above the horizon")
    yield _number(f"{SUN_PATH}.irradiance", 0.0, 3.0, 1.0, Affects.LIGHT, "", "1 is a clear noon")
    yield _number(f"{ENVIRONMENT_PATH}.turbidity", 1.7, 10.0, 3.0, Affects.LIGHT, "", "haze: 2 clear … 10 hazy")
    for name, camera in CAMERAS.items():
        yield from _camera_parameters(f"{ROOT}.{name}", camera)
    for row in SENSOR_PARAMETERS.values():
        yield row.definition()


def _camera_parameters(path: str, camera: CameraPlace) -> Iterator[ParameterDefinition]:
    x, y, z = camera.position
    yield _number(f"{path}.pos.x", -20.0, 25.0, x, Affects.GEOMETRY, "m", "of the optical centre")
    yield _number(f"{path}.pos.y", -30.0, 110.0, y, Affects.GEOMETRY, "m", "of the optical centre")
    yield _number(f"{path}.pos.z", 0.2, 60.0, z, Affects.GEOMETRY, "m", "of the optical centre")
    yield _angle(f"{path}.yaw", camera.yaw, Affects.GEOMETRY, "0 looks along +y, counter-clockwise from above")
    yield _number(f"{path}.pitch", -90.0, 90.0, camera.pitch, Affects.GEOMETRY, "deg", "upwards")
    yield _angle(f"{path}.roll", 0.0, Affects.GEOMETRY, "lowers the camera's right side")
    yield _number(
        f"{path}.focal_length_mm", 8.0, 400.0, camera.focal_length_mm, Affects.GEOMETRY, "mm", "on a 36 mm wide sensor"
    )


def _number(
    path: str, low: float, high: float, default: float, affects: Affects, unit: str, description: str
) -> ParameterDefinition:
    return ParameterDefinition(
        path=path,
        type=ParameterType.FLOAT,
        minimum=low,
        maximum=high,
        unit=unit,
        default=default,
        affects=affects,
        description=description,
    )


def _angle(path: str, default: float, affects: Affects, description: str) -> ParameterDefinition:
    return ParameterDefinition(
        path=path, type=ParameterType.ANGLE, default=default, affects=affects, description=description
    )
