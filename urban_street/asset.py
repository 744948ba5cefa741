"""The asset pack ``urban-street``: a generated street with houses, trees, traffic, pedestrians, three cameras and the sun.

Vehicles in traffic are hidden by default and then cost nothing. Parked ones belong to the background, so each value of a varied
colour or door needs its own background. All vehicles have nodes for body, doors and wheels.

The cameras (50 mm on a 36 mm wide sensor: 39.6° × 22.9° at 16:9) stand at y = −12 m, so that each of the paper's
positions (x −2…7 m, y 5…35 m; section 6.1) is at least 17 m from every optical centre and inside every image. The truth pass
measured the following at 960×540 over these positions and both characters, with mixed headings (seed 0; *alone* is the share of
the image without occlusion):

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

In 22…39 % of a camera's frames the person is occluded by 5…75 %, and in about half by more than 5 %; 3…5 % of the persons are
fully hidden. The paper's 17…38.2 m correspond to y 5…26.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pydantic import Field

from urban_street.human.stances import GAITS
from urban_street.odd import with_meaning
from urban_street.pedestrians import PERSON_RADIUS_M, PLACES, Crowd, person_parameters, persons
from urban_street.street.layout import layout_street
from urban_street.street.plan import Placement, StreetLayout, StreetSettings
from urban_street.traffic_places import (
    TRAINED_ON,
    WAITING,
    TrafficPlace,
    place_parameters,
    traffic,
    traffic_obstacles,
    traffic_parameters,
)
from urban_street.varied_houses import house_parameters, varied_houses, ways
from urban_street.vehicles.build import picked_paint, vehicle_seed
from urban_street.vehicles.paints import PAINTS
from valerie.errors import InvalidInput
from valerie.parameters.declaring import angle, choice, number
from valerie.parameters.definitions import Affects, ParameterDefinition
from valerie.scene.assets.asset import AssetArguments, PackSettings
from valerie.scene.assets.manifest import Footprint, GroundRegion, Manifest, TrainingRules
from valerie.scene.assets.objects import classified
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS
from valerie.scene.graph.model import CLEAR_VISIBILITY_M, POSITIONS, Camera, Environment, Material, Node, Scene, Sun
from valerie.scene.graph.naming import ENVIRONMENT_PATH, ROOT, SUN_PATH
from valerie.scene.graph.paints import is_paint
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.light.solar import CLOCK

NAME: Final = "urban-street"
#: Part of the asset's digest. Raise it whenever the street, the characters, cameras or defaults change.
REVISION: Final = 5

#: Compass bearing of the street (+y), degrees: south-south-west, so that the noon sun is ahead, a little to the left.
BEARING_DEG: Final = 200.0
SUN_AZIMUTH_DEG: Final = 180.0
SUN_ELEVATION_DEG: Final = 40.0
SENSOR_WIDTH_MM: Final = 36.0

#: Heights, metres, of classes that a camera may look over.
_HEIGHTS_M: Final = {"car": 2.0, "static": 1.3, "wall": 1.1, "fence": 1.3}


class Settings(StreetSettings, PackSettings):
    """The arguments of the street: those of `StreetSettings`, and the number of persons."""

    persons: int = Field(default=2, ge=1, le=len(PLACES))


@dataclass(frozen=True, slots=True)
class CameraPlace:
    """The place of a camera: metres and degrees (`camera_transform`), focal length for a 36 mm wide sensor."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    focal_length_mm: float = 50.0


#: In the lane at a driver's height; near the left kerb, turned slightly right; higher on the right, as in a van.
CAMERAS: Final = {
    "camera-1": CameraPlace((2.5, -12.0, 1.4), 0.0, 0.0),
    "camera-2": CameraPlace((0.6, -12.0, 1.3), 358.0, 0.0),
    "camera-3": CameraPlace((4.6, -12.0, 2.2), 2.5, -1.0),
}


#: Number of parked cars with parameters: those nearest to the places of people.
PARKED_COUNT: Final = 3
_PEOPLE_Y: Final = 18.0


def make_manifest(settings: Settings) -> Manifest:
    """Return the declarations of the street in milliseconds, without meshes."""
    layout = layout_street(settings)
    places = traffic(layout)
    paths = tuple(f"{ROOT}.{name}" for name in persons(settings.persons))
    vehicles = tuple(f"{ROOT}.{name}" for name in places)
    return Manifest(
        name=NAME,
        title="Urban street",
        description=f"A generated street of {settings.length_m:.0f} m with houses, trees, vehicles and pedestrians.",
        bearing_deg=BEARING_DEG,
        extent=layout.extent,
        parameters=tuple(map(with_meaning, _parameters(settings, layout, places))),
        movable=(*paths, *vehicles),
        obstacles=(*_obstacles(layout), *traffic_obstacles(places)),
        ways=tuple(ways(layout)),
        ground=tuple(GroundRegion(polygon=region.polygon, height=region.height) for region in layout.ground),
        persons=paths,
        person_radius_m=PERSON_RADIUS_M,
        cameras=tuple(CAMERAS),
        node_classes=dict.fromkeys(_rider_paths(places), "rider"),
        gaits=GAITS,
        paints=PAINTS,
        training=TrainingRules(
            # A second outfit of one body would show that body twice as often.
            left_out=(
                *(path for path in vehicles if path not in TRAINED_ON),
                *(f"{path}.yellow-outfit" for path in paths),
            ),
            poses={"walking": 0.6, "standing": 0.2, "phone": 0.12, "waving": 0.08},
            worn=("shoe-",),
            skin=("skin-head", "skin-limbs"),
        ),
    )


def make_scene(settings: Settings, manifest: Manifest) -> Scene:
    """Build the street with its people in a few CPU seconds. The shapes of people are built on first use."""
    from urban_street.street.build import build_street
    from urban_street.traffic import Traffic

    layout = layout_street(settings)
    content = build_street(layout)
    nodes = [Node(part.path, part.transform, part.meshes, light=part.light) for part in content.parts]
    materials = dict(content.materials)
    nodes = _with_own_paint(nodes, materials, [car.path for car in parked_cars(layout)])
    crowd = Crowd()
    for name, person in persons(settings.persons).items():
        nodes += crowd.nodes(name, person)
    vehicles = Traffic()
    for name, at in traffic(layout).items():
        nodes += vehicles.nodes(name, at)
    nodes += vehicles.nodes(*WAITING, shown=True)
    shared = (content.materials.keys() & crowd.materials.keys()) | (content.textures.keys() & crowd.textures.keys())
    if shared:
        raise InvalidInput(
            "the street and its people use the same name for a material or texture", field=NAME, value=min(shared)
        )
    return Scene(
        nodes=classified(nodes, manifest.node_classes, manifest.movable),
        materials=materials | crowd.materials | vehicles.materials,
        textures=content.textures | crowd.textures | vehicles.textures,
        cameras={name: _camera(name, camera) for name, camera in CAMERAS.items()},
        sun=Sun(azimuth=math.radians(SUN_AZIMUTH_DEG), elevation=math.radians(SUN_ELEVATION_DEG)),
        environment=Environment(bearing=math.radians(BEARING_DEG)),
    )


def draw_arguments(rng: np.random.Generator) -> AssetArguments:
    """Draw the arguments of a training street, except its seed, with ``rng``."""

    def pick(shares: Mapping[str, float]) -> str:
        return str(rng.choice(list(shares), p=list(shares.values())))

    return {
        "season": pick({"summer": 0.4, "spring": 0.2, "autumn": 0.25, "winter": 0.15}),
        "surface": pick({"asphalt": 0.85, "paving": 0.15}),
        "side_street": pick({"right": 0.4, "left": 0.25, "both": 0.15, "none": 0.2}),
        "lanes": int(rng.choice([1, 2, 3], p=[0.65, 0.25, 0.1])),
        "pavement_width_m": round(float(rng.uniform(2.2, 4.5)), 2),
        "setback_m": float(rng.choice([0.0, 0.0, 0.0, 2.5])),
    }


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


def parked_cars(layout: StreetLayout) -> list[Placement]:
    """Return the parked cars that have parameters, nearest to the people first."""
    cars = [placement for placement in layout.placements if placement.object_class == "car"]
    return sorted(cars, key=lambda car: (abs(car.y - _PEOPLE_Y), car.path))[:PARKED_COUNT]


def _with_own_paint(nodes: list[Node], materials: dict[str, Material], paths: list[str]) -> list[Node]:
    """Return the nodes. Those below ``paths`` get separate paints, which are added to ``materials``, so that each can vary."""

    def own(node: Node) -> Node:
        owner = next((path for path in paths if node.path.startswith(f"{path}.")), None)
        if owner is None:
            return node
        meshes = []
        for mesh in node.meshes:
            name = f"{owner.removeprefix(f'{ROOT}.')}/{mesh.material}"
            if is_paint(mesh.material):
                materials[name] = replace(materials[mesh.material], name=name)
                meshes.append(replace(mesh, material=name))
            else:
                meshes.append(mesh)
        return replace(node, meshes=tuple(meshes))

    return [own(node) for node in nodes]


def _rider_paths(places: Mapping[str, TrafficPlace]) -> Iterator[str]:
    for name, at in (*places.items(), WAITING):
        if at.rider:
            yield f"{ROOT}.{name}.{at.rider}"


def _camera(name: str, camera: CameraPlace) -> Camera:
    transform = camera_transform(camera.position, camera.yaw, camera.pitch, 0.0)
    return Camera(f"{ROOT}.{name}", transform, camera.focal_length_mm, SENSOR_WIDTH_MM)


def _parameters(
    settings: Settings, layout: StreetLayout, places: Mapping[str, TrafficPlace]
) -> Iterator[ParameterDefinition]:
    for name, person in persons(settings.persons).items():
        yield from person_parameters(name, person)
    yield from traffic_parameters(places)
    for car in parked_cars(layout):
        yield from _parked_parameters(car, layout.settings.seed)
    for house in varied_houses(layout):
        yield from house_parameters(house)
    yield from _other_parameters()


def _parked_parameters(car: Placement, seed: int) -> Iterator[ParameterDefinition]:
    yield from place_parameters(car.path, car.x, car.y, round(math.degrees(car.heading), 3))
    coat = picked_paint(car.kind, vehicle_seed(seed, car.variant))
    yield choice(f"{car.path}.colour", tuple(PAINTS), coat, Affects.MATERIAL, "colour of the paint")
    door = "opening of the right front door"
    yield angle(f"{car.path}.door-2.rot.z", 0.0, Affects.GEOMETRY, door, high=70.0)


def _other_parameters() -> Iterator[ParameterDefinition]:
    yield angle(f"{SUN_PATH}.azimuth", SUN_AZIMUTH_DEG, Affects.LIGHT, "clockwise from north")
    yield number(f"{SUN_PATH}.elevation", -20.0, 75.0, SUN_ELEVATION_DEG, Affects.LIGHT, "deg", "above the horizon")
    yield number(f"{SUN_PATH}.irradiance", 0.0, 3.0, 1.0, Affects.LIGHT, "", "1 is a clear noon")
    for clock in CLOCK:
        yield clock.definition()
    yield number(f"{ENVIRONMENT_PATH}.turbidity", 1.7, 10.0, 3.0, Affects.LIGHT, "", "haze: 2 clear … 10 hazy")
    yield number(
        f"{ENVIRONMENT_PATH}.cloud_cover", 0.0, 1.0, 0.0, Affects.LIGHT, "", "0 clear … 1 overcast, no shadows"
    )
    yield number(
        f"{ENVIRONMENT_PATH}.visibility", 20.0, CLEAR_VISIBILITY_M, CLEAR_VISIBILITY_M, Affects.LIGHT, "m",
        "visibility in fog (Koschmieder, 2 %); the largest value is no fog",
    )  # fmt: skip
    yield number(
        f"{ENVIRONMENT_PATH}.rain",
        0.0,
        50.0,
        0.0,
        Affects.LIGHT,
        "mm/h",
        "wets the road, adds drops, reduces visibility",
    )
    for lamps, whose in (("street_lamps", "lamp posts"), ("car_lamps", "vehicles in traffic")):
        yield choice(
            f"{ENVIRONMENT_PATH}.{lamps}", POSITIONS, "auto", Affects.LIGHT, f"of {whose}; auto: when it is dark"
        )
    for name, camera in CAMERAS.items():
        yield from _camera_parameters(f"{ROOT}.{name}", camera)
    for row in SENSOR_PARAMETERS.values():
        yield row.definition()


def _camera_parameters(path: str, camera: CameraPlace) -> Iterator[ParameterDefinition]:
    x, y, z = camera.position
    yield number(f"{path}.pos.x", -20.0, 25.0, x, Affects.GEOMETRY, "m", "x of the optical centre")
    yield number(f"{path}.pos.y", -30.0, 110.0, y, Affects.GEOMETRY, "m", "y of the optical centre")
    yield number(f"{path}.pos.z", 0.2, 60.0, z, Affects.GEOMETRY, "m", "z of the optical centre")
    yield angle(f"{path}.yaw", camera.yaw, Affects.GEOMETRY, "0 looks along +y, counter-clockwise from above")
    yield number(f"{path}.pitch", -90.0, 90.0, camera.pitch, Affects.GEOMETRY, "deg", "upwards")
    yield angle(f"{path}.roll", 0.0, Affects.GEOMETRY, "lowers the camera's right side")
    yield number(
        f"{path}.focal_length_mm", 8.0, 400.0, camera.focal_length_mm, Affects.GEOMETRY, "mm", "for a 36 mm wide sensor"
    )
