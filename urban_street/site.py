"""A site: one generated place from one seed, before any mesh; and the asset that it becomes.

A kind of place is a function from settings to a `Site`, and nothing else: its ground and objects (a layout), who and what can
move there, and where the cameras stand. Manifest, scene and declarations follow in the same way for all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from pydantic import Field

from urban_street.human.aids import REACHES
from urban_street.human.stances import GAITS
from urban_street.human.townspeople import TOWNSPEOPLE
from urban_street.odd import with_meaning
from urban_street.pedestrians import PEOPLE_REACH, PERSON_RADIUS_M, Crowd, PersonPlace, aid_classes, person_parameters
from urban_street.street.plan import Placement, Season, StreetLayout, nearest
from urban_street.street.shapes import DEFAULT_PHASE, PHASES, Signals
from urban_street.traffic_places import (
    VEHICLE_REACH,
    TrafficPlace,
    place_parameters,
    traffic_obstacles,
    traffic_parameters,
)
from urban_street.varied_houses import house_parameters
from urban_street.varied_signs import sign_parameters, varied_signs, with_faces
from urban_street.vehicles.build import picked_paint, vehicle_seed
from urban_street.vehicles.paints import ALL_PAINTS, PAINTS
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

SENSOR_WIDTH_MM: Final = 36.0
#: Heights, metres, of classes that a camera may look over.
_HEIGHTS_M: Final = {"car": 2.0, "static": 1.3, "wall": 1.1, "fence": 1.3, "guard-rail": 0.8}
#: x0, y0, x1, y1, metres.
Box = tuple[float, float, float, float]


class PlaceSettings(PackSettings):
    """The arguments that all places have but the street, which has more."""

    seed: int = Field(default=0, ge=0, lt=2**63)
    season: Season = "summer"


@dataclass(frozen=True, slots=True)
class CameraPlace:
    """The place of a camera: metres and degrees (`camera_transform`), focal length for a 36 mm wide sensor."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    focal_length_mm: float = 50.0


@dataclass(frozen=True, slots=True)
class Sky:
    """The compass bearing of +y, and the sun's default angles, degrees."""

    bearing: float
    azimuth: float
    elevation: float


#: +y looks south-south-west, so that the noon sun is ahead, a little to the left.
NOON: Final = Sky(200.0, 180.0, 40.0)


@dataclass(frozen=True, slots=True)
class Reach:
    """The ranges of positions that parameters may set."""

    people: Box = PEOPLE_REACH
    vehicles: Box = VEHICLE_REACH
    cameras: Box = (-20.0, -30.0, 25.0, 110.0)


@dataclass(frozen=True, slots=True)
class Site:
    """One place, planned.

    Attributes:
        name, title, description: of its asset.
        layout: everything that stands still.
        cameras, people: by name.
        vehicles: vehicles that move, by name.
        waiting: vehicles with riders that belong to the background, by name.
        parked: vehicles of the layout with a place, a colour and a door that opens.
        houses: houses of the layout that can move.
        ways: ground that houses must leave free.
        untrained: names of the vehicles that training scenes never show.
        reach, positions: the ranges of positions, and their source.
    """

    name: str
    title: str
    description: str
    layout: StreetLayout
    cameras: Mapping[str, CameraPlace]
    people: Mapping[str, PersonPlace]
    vehicles: Mapping[str, TrafficPlace]
    waiting: Mapping[str, TrafficPlace] = field(default_factory=dict)
    parked: tuple[Placement, ...] = ()
    houses: tuple[Placement, ...] = ()
    ways: tuple[Footprint, ...] = ()
    untrained: tuple[str, ...] = ()
    reach: Reach = Reach()
    positions: str = "the generated place"
    sky: Sky = NOON


@dataclass(frozen=True, slots=True)
class Pack:
    """An asset pack (`valerie.scene.assets.asset.AssetPack`) of one kind of place.

    Attributes:
        site: plans the place in milliseconds.
        draw_arguments: draws the arguments of a training scene, except its seed.
    """

    REVISION: int
    Settings: type[PackSettings]
    site: Callable[[Any], Site]
    draw_arguments: Callable[[np.random.Generator], AssetArguments]

    def make_manifest(self, settings: PackSettings) -> Manifest:
        """Return the declarations of the place in milliseconds, without meshes."""
        return _manifest(self.site(settings))

    def make_scene(self, settings: PackSettings, manifest: Manifest) -> Scene:
        """Build the place with its people in a few CPU seconds. The shapes of people are built on first use."""
        return _scene(self.site(settings), manifest)


def draw_season(rng: np.random.Generator) -> AssetArguments:
    """Draw the season of a training scene."""
    return {"season": picked(rng, {"summer": 0.4, "spring": 0.2, "autumn": 0.25, "winter": 0.15})}


def picked(rng: np.random.Generator, shares: Mapping[str, float]) -> str:
    """Return a key of ``shares`` with the probability that it has there."""
    return str(rng.choice(list(shares), p=list(shares.values())))


def numbered(people: tuple[PersonPlace, ...]) -> dict[str, PersonPlace]:
    """Return persons by name, from ``person-1`` on."""
    return {f"person-{number}": spot for number, spot in enumerate(people, start=1)}


def nearest_cars(layout: StreetLayout, count: int, y: float) -> tuple[Placement, ...]:
    """Return the ``count`` parked cars that are nearest to a place along the street, nearest first."""
    return tuple(nearest((item for item in layout.placements if item.object_class == "car"), count, y))


def _manifest(site: Site) -> Manifest:
    paths = tuple(f"{ROOT}.{name}" for name in site.people)
    vehicles = tuple(f"{ROOT}.{name}" for name in site.vehicles)
    return Manifest(
        name=site.name,
        title=site.title,
        description=site.description,
        bearing_deg=site.sky.bearing,
        extent=site.layout.extent,
        parameters=tuple(with_meaning(definition, site.positions) for definition in _parameters(site)),
        movable=(*paths, *vehicles),
        obstacles=(*_obstacles(site.layout), *traffic_obstacles({**site.vehicles, **site.waiting})),
        ways=site.ways,
        ground=tuple(GroundRegion(polygon=region.polygon, height=region.height) for region in site.layout.ground),
        persons=paths,
        person_radius_m=PERSON_RADIUS_M,
        cameras=tuple(site.cameras),
        node_classes={**dict.fromkeys(_rider_paths(site), "rider"), **aid_classes(site.people)},
        gaits=GAITS,
        reaches=dict(REACHES),
        paints=ALL_PAINTS,
        training=TrainingRules(
            # The shipped networks' scenes follow from the draws of each seed: later characters join when they are trained anew.
            # A second outfit of one body would show that body twice as often.
            left_out=(
                *(f"{ROOT}.{name}" for name in site.untrained),
                *(f"{path}.{name}" for path in paths for name in ("yellow-outfit", *TOWNSPEOPLE)),
            ),
            poses={"walking": 0.6, "standing": 0.2, "phone": 0.12, "waving": 0.08},
            worn=("shoe-",),
            skin=("skin-head", "skin-limbs"),
        ),
    )


def _scene(site: Site, manifest: Manifest) -> Scene:
    from urban_street.street.build import build_street
    from urban_street.traffic import Traffic

    content = build_street(site.layout)
    nodes = [
        Node(part.path, part.transform, part.meshes, visible=part.shown, light=part.light) for part in content.parts
    ]
    materials = dict(content.materials)
    nodes = _with_own_paint(nodes, materials, [car.path for car in site.parked])
    nodes, face_materials, face_textures = with_faces(nodes, varied_signs(site.layout))
    crowd = Crowd()
    for name, person in site.people.items():
        nodes += crowd.nodes(name, person)
    vehicles = Traffic()
    for name, at in (*site.vehicles.items(), *site.waiting.items()):
        nodes += vehicles.nodes(name, at)
    shared = (content.materials.keys() & crowd.materials.keys()) | (content.textures.keys() & crowd.textures.keys())
    if shared:
        raise InvalidInput(
            "the street and its people use the same name for a material or texture", field=site.name, value=min(shared)
        )
    return Scene(
        nodes=classified(nodes, manifest.node_classes, manifest.movable),
        materials=materials | face_materials | crowd.materials | vehicles.materials,
        textures=content.textures | face_textures | crowd.textures | vehicles.textures,
        cameras={name: _camera(name, camera) for name, camera in site.cameras.items()},
        sun=Sun(azimuth=math.radians(site.sky.azimuth), elevation=math.radians(site.sky.elevation)),
        environment=Environment(bearing=math.radians(site.sky.bearing)),
    )


def _obstacles(layout: StreetLayout) -> Iterator[Footprint]:
    for footprint in layout.footprints:
        name = footprint.path.rpartition(".")[2]
        object_class = name.rpartition("-")[0]
        yield Footprint(
            path=footprint.path,
            polygon=footprint.polygon,
            reason=footprint.reason or f"inside {name}",
            height_m=footprint.height or _HEIGHTS_M.get(object_class),
        )


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


def _rider_paths(site: Site) -> Iterator[str]:
    for name, at in (*site.vehicles.items(), *site.waiting.items()):
        if at.rider:
            yield f"{ROOT}.{name}.{at.rider}"


def _camera(name: str, camera: CameraPlace) -> Camera:
    transform = camera_transform(camera.position, camera.yaw, camera.pitch, 0.0)
    return Camera(f"{ROOT}.{name}", transform, camera.focal_length_mm, SENSOR_WIDTH_MM)


def _parameters(site: Site) -> Iterator[ParameterDefinition]:
    for name, person in site.people.items():
        yield from person_parameters(name, person, site.reach.people)
    yield from traffic_parameters(site.vehicles, site.reach.vehicles)
    for car in site.parked:
        yield from _parked_parameters(car, site.layout.settings.seed, site.reach.vehicles)
    for house in site.houses:
        yield from house_parameters(house)
    for sign in varied_signs(site.layout):
        yield from sign_parameters(sign)
    for placement in site.layout.placements:
        if isinstance(placement.shape, Signals):
            yield choice(
                f"{placement.path}.kind", tuple(PHASES), DEFAULT_PHASE, Affects.GEOMETRY, "phase of all signals"
            )
    yield from _other_parameters(site)
    yield from _season_parameters(site.layout.settings.season)


def _parked_parameters(car: Placement, seed: int, reach: Box) -> Iterator[ParameterDefinition]:
    yield from place_parameters(car.path, car.x, car.y, round(math.degrees(car.heading), 3), reach)
    coat = picked_paint(car.kind, vehicle_seed(seed, car.variant))
    yield choice(f"{car.path}.colour", tuple(PAINTS), coat, Affects.MATERIAL, "colour of the paint")
    door = "opening of the right front door"
    yield angle(f"{car.path}.door-2.rot.z", 0.0, Affects.GEOMETRY, door, high=70.0)


def _other_parameters(site: Site) -> Iterator[ParameterDefinition]:
    yield angle(f"{SUN_PATH}.azimuth", site.sky.azimuth, Affects.LIGHT, "clockwise from north")
    yield number(f"{SUN_PATH}.elevation", -20.0, 75.0, site.sky.elevation, Affects.LIGHT, "deg", "above the horizon")
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
    for name, camera in site.cameras.items():
        yield from _camera_parameters(f"{ROOT}.{name}", camera, site.reach.cameras)
    for row in SENSOR_PARAMETERS.values():
        yield row.definition()


def _season_parameters(season: Season) -> Iterator[ParameterDefinition]:
    """Declare snow outside summer, and fallen leaves where trees lose theirs."""
    if season != "summer":
        yield number(
            f"{ENVIRONMENT_PATH}.snowfall",
            0.0,
            8.0,
            0.0,
            Affects.LIGHT,
            "mm/h",
            "of water; adds flakes, reduces visibility",
        )
        yield number(
            f"{ENVIRONMENT_PATH}.snow_depth",
            0.0,
            0.2,
            0.0,
            Affects.LIGHT,
            "m",
            "of lying snow; labels stay the surface's",
        )
    if season in ("autumn", "winter"):
        yield number(
            f"{ENVIRONMENT_PATH}.leaf_litter",
            0.0,
            0.8,
            0.0,
            Affects.LIGHT,
            "",
            "share of level surfaces under fallen leaves",
        )


def _camera_parameters(path: str, camera: CameraPlace, reach: Box) -> Iterator[ParameterDefinition]:
    x, y, z = camera.position
    yield number(f"{path}.pos.x", reach[0], reach[2], x, Affects.GEOMETRY, "m", "x of the optical centre")
    yield number(f"{path}.pos.y", reach[1], reach[3], y, Affects.GEOMETRY, "m", "y of the optical centre")
    yield number(f"{path}.pos.z", 0.2, 60.0, z, Affects.GEOMETRY, "m", "z of the optical centre")
    yield angle(f"{path}.yaw", camera.yaw, Affects.GEOMETRY, "0 looks along +y, counter-clockwise from above")
    yield number(f"{path}.pitch", -90.0, 90.0, camera.pitch, Affects.GEOMETRY, "deg", "upwards")
    yield angle(f"{path}.roll", 0.0, Affects.GEOMETRY, "lowers the camera's right side")
    yield number(
        f"{path}.focal_length_mm", 8.0, 400.0, camera.focal_length_mm, Affects.GEOMETRY, "mm", "for a 36 mm wide sensor"
    )
