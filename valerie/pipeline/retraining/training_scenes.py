"""Random scenes to train on: people in random clothes, with random cameras and light.

Everything that a network could learn instead of "person" is varied: positions, headings, poses, sizes, colours of cloth and
skin, traffic, day and night, light, weather, camera and its errors. Some frames have no person. Half of the frames are
*plain*: they look like those of a run that varies only people and sun. `draw_arguments` varies the site itself. The
manifest names an asset's poses, clothes and traffic (`valerie.scene.assets.manifest.TrainingRules`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely

from valerie.errors import InvalidInput
from valerie.parameters.definitions import Value
from valerie.pipeline.retraining.crowds import recoloured, resized
from valerie.scene.assets.asset import AssetArguments, SceneAsset, load_pack
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.model import Camera, Scene
from valerie.scene.graph.naming import ENVIRONMENT_PATH
from valerie.scene.graph.transforms import camera_angles, camera_transform
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply
from valerie.sensing.settings import Noise, SensorSetting, WhiteBalance

#: Raise it whenever the same seed gives another scene.
REVISION: Final = 5

#: Probabilities that a frame shows 0 … `MOST_PERSONS` people.
_CROWD: Final = (0.12, 0.22, 0.24, 0.2, 0.13, 0.09)
#: Phases of the walk: few, so that bodies made for one frame are reused in others.
_GAIT_PHASES: Final = (0.0, 0.25, 0.5, 0.75)
#: Share of plain frames: cameras near their own positions, the asset's weather, daylight, no traffic, an ideal sensor.
_PLAIN: Final = 0.5
#: Share of the other frames whose camera stays near its own position.
_STAYS: Final = 0.4
#: Share of the other frames with each movable vehicle on the road.
_TRAFFIC: Final = 0.4
#: Likewise with clouds, with fog, with rain, and at night.
_CLOUDS: Final = 0.4
_FOG: Final = 0.1
_RAIN: Final = 0.1
_NIGHT: Final = 0.16
_CURVES: Final = {"filmic": 0.6, "aces": 0.2, "srgb": 0.2}
#: Share of garments that keep the character's own colour, in plain frames and in others.
_AS_MADE_PLAIN: Final = 0.5
AS_MADE: Final = 1 / 6
_TRIES: Final = 200


@dataclass(frozen=True, slots=True, eq=False)
class TrainingScene:
    """One drawn scene.

    Attributes:
        scene: scene with the drawn people, light and cameras.
        camera: name of the camera to use.
        sensor: the camera's response and errors.
    """

    scene: Scene
    camera: str
    sensor: SensorSetting


def draw_arguments(asset: str, seed: int) -> AssetArguments:
    """Draw an asset pack's arguments besides its seed; they follow from the seed.

    Args:
        asset: name of the pack.
        seed: seed of the site.

    Raises:
        UnknownName, InvalidInput, MissingDependency: as for `valerie.scene.assets.asset.load_pack`.
    """
    return load_pack(asset).draw_arguments(np.random.default_rng([REVISION, seed]))


def draw_scene(
    asset: SceneAsset,
    rng: np.random.Generator,
    *,
    setting: np.random.Generator | None = None,
    as_made: float = AS_MADE,
    people_only: bool = False,
) -> TrainingScene:
    """Draw one frame's scene from an asset that `crowd_asset` made.

    Args:
        asset: the site with its crowd.
        rng: generator of all choices but those of ``setting``.
        setting: generator of camera, light and weather; None: ``rng``. Scenes with equal settings differ only in what moves, so
            an engine that caches backgrounds renders theirs once.
        as_made: smallest share of garments that keep the character's own colour; larger in plain frames.
        people_only: nothing else moves, and the weather is the asset's.

    Raises:
        InvalidInput: no free place for a camera was found.
    """
    manifest = asset.manifest
    setting = rng if setting is None else setting
    plain = setting.random() < _PLAIN
    camera = _draw_camera(asset, setting, stays=plain or setting.random() < _STAYS)
    eventful = not (people_only or plain)
    outdoors: dict[str, Value] = {}
    if eventful:
        _draw_weather(outdoors, manifest, setting)
    night = eventful and setting.random() < _NIGHT
    for name, low, high in (
        ("azimuth", 0.0, 359.9),
        ("elevation", *((-18.0, -1.0) if night else (8.0, 72.0))),
        ("irradiance", 0.6, 1.3),
    ):
        _assign(outdoors, manifest, f"scene.sun-1.{name}", setting.uniform(low, high))
    turbidity = float(setting.uniform(2.0, 6.0))

    assignment: dict[str, Value] = {f"{person}.character": ABSENT for person in manifest.persons}
    count = min(int(rng.choice(len(_CROWD), p=_CROWD)), len(manifest.persons))
    for person in rng.permutation(manifest.persons)[:count]:
        _draw_person(str(person), camera, assignment, manifest, rng, far=plain)
    if eventful:
        draw_traffic(camera, assignment, manifest, rng)
    scene = apply(assignment | outdoors, asset)
    scene = replace(
        scene,
        nodes=resized(scene, manifest, rng),
        materials=recoloured(scene, manifest, rng, max(as_made, _AS_MADE_PLAIN) if plain else as_made),
        cameras={**scene.cameras, camera.name: camera},
        environment=replace(scene.environment, turbidity=turbidity),
    )
    sensor = SensorSetting() if plain else _draw_sensor(rng, night=night)
    return TrainingScene(scene, camera.name, sensor)


def _draw_sensor(rng: np.random.Generator, *, night: bool) -> SensorSetting:
    """Draw a sensor: always an exposure and a curve; noise, a colour cast and JPEG each in about every third frame."""
    setting = SensorSetting(
        name="training",
        auto_exposure=night,
        exposure_ev=round(float(rng.uniform(-0.6, 1.2)), 3),
        curve=_pick(rng, _CURVES),
        gamma=round(float(rng.uniform(0.9, 1.6)), 3),
    )
    noise, cast, jpeg = rng.random(3) < 0.35
    if noise:
        well = math.exp(rng.uniform(math.log(1500.0), math.log(20_000.0)))
        electrons = Noise(shot=True, full_well_electrons=round(well), read_electrons=3.0)
        setting = setting.model_copy(update={"noise": electrons})
    if cast:
        white = WhiteBalance(temperature_k=round(float(rng.uniform(4800.0, 8500.0))))
        setting = setting.model_copy(update={"white_balance": white})
    if jpeg:
        setting = setting.model_copy(update={"jpeg_quality": int(rng.integers(40, 96))})
    return setting


def _draw_camera(asset: SceneAsset, rng: np.random.Generator, *, stays: bool) -> Camera:
    """Draw one of the asset's cameras: near its own position, or moved along y and turned."""
    manifest = asset.manifest
    x0, y0, x1, y1 = manifest.extent
    for _ in range(_TRIES):
        camera = asset.base.cameras[str(rng.choice(manifest.cameras))]
        x, y, z = (float(value) for value in camera.position)
        yaw, pitch, _roll = camera_angles(camera.transform)
        focal_length = camera.focal_length_mm
        if stays:
            x, y, yaw = x + rng.uniform(-0.7, 0.7), y + rng.uniform(-2.0, 2.0), yaw + rng.uniform(-3.0, 3.0)
        else:
            x, y = x + rng.uniform(-2.5, 2.5), rng.uniform(min(y, y0), y0 + 0.7 * (y1 - y0))
            yaw += rng.normal(0.0, 12.0)
            if rng.random() < 0.25:
                yaw += 180.0
            focal_length *= rng.uniform(0.6, 1.2)
        z = max(0.8, z + rng.uniform(-0.4, 0.8))
        pitch += rng.normal(0.0, 2.0)
        if x0 <= x <= x1 and y0 <= y <= y1 and _free(manifest, (x, y, z), yaw):
            transform = camera_transform((x, y, z), yaw, pitch, rng.normal(0.0, 1.0))
            return replace(camera, transform=transform, focal_length_mm=float(focal_length))
    raise InvalidInput("no free place for a camera", field="asset", value=asset.name)


def _draw_person(
    person: str,
    camera: Camera,
    assignment: dict[str, Value],
    manifest: Manifest,
    rng: np.random.Generator,
    *,
    far: bool,
) -> None:
    """Put a person at a legal position; it stays absent if none was found.

    Four times in five the position is in the camera's view: mostly near, or with ``far`` at a uniform distance.
    """
    characters = [c for c in manifest.definition(f"{person}.character").choices if c != ABSENT]
    x0, y0, x1, y1 = manifest.extent
    half_view = math.atan(0.5 * camera.sensor_width_mm / camera.focal_length_mm)
    forward = math.atan2(-camera.transform[0, 2], -camera.transform[1, 2])  # from +y towards +x
    for _ in range(_TRIES):
        if rng.random() < 0.8:
            distance = rng.uniform(6.0, 52.0) if far else math.exp(rng.uniform(math.log(5.0), math.log(60.0)))
            bearing = forward + rng.uniform(-0.95, 0.95) * half_view
            x = float(camera.position[0]) + distance * math.sin(bearing)
            y = float(camera.position[1]) + distance * math.cos(bearing)
        else:
            x, y = float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1))
        values: dict[str, Value] = {
            **assignment,
            f"{person}.pos.x": x,
            f"{person}.pos.y": y,
            f"{person}.heading": float(rng.uniform(0.0, 359.9)),
            f"{person}.character": str(rng.choice(characters)),
        }
        within = all(_allows(manifest, f"{person}.pos.{axis}", at) for axis, at in (("x", x), ("y", y)))
        if within and rejection_reason(values, manifest) is None:
            for name, low, high in (("metallic", 0.0, 0.3), ("roughness", 0.35, 1.0), ("specular_tint", 0.0, 1.0)):
                _assign(values, manifest, f"{person}.cloth.{name}", rng.uniform(low, high))
            if f"{person}.pose" in manifest.by_path:
                values[f"{person}.pose"] = _pick(rng, _pose_shares(manifest, person))
                values[f"{person}.gait_phase"] = float(rng.choice(_GAIT_PHASES))
                values[f"{person}.carries"] = str(rng.choice(manifest.definition(f"{person}.carries").choices))
            assignment.update(values)
            return


def draw_traffic(camera: Camera, assignment: dict[str, Value], manifest: Manifest, rng: np.random.Generator) -> None:
    """Put each movable vehicle on the road in front of the camera, in some of the frames."""
    for path in (path for path in manifest.movable if path not in (*manifest.persons, *manifest.training.left_out)):
        wanted, colour, back = rng.random() < _TRAFFIC, rng.random(), rng.random() < 0.5
        kinds, seen = manifest.by_path.get(f"{path}.kind"), manifest.by_path.get(f"{path}.visible")
        if not wanted or (kinds is None and seen is None):
            continue
        values: dict[str, Value] = {}
        if kinds is not None:
            values[f"{path}.kind"] = str(rng.choice([kind for kind in kinds.choices if kind != ABSENT]))
        if seen is not None:
            values[f"{path}.visible"] = True
        paints = manifest.by_path.get(f"{path}.colour")
        if paints is not None:
            values[f"{path}.colour"] = paints.choices[int(colour * len(paints.choices))]
        side = math.copysign(1.0, -camera.transform[1, 2])
        for _ in range(_TRIES):
            x = float(camera.position[0]) + float(rng.uniform(-1.3, 1.3))
            y = float(camera.position[1]) + side * float(rng.uniform(8.0, 45.0))
            proposal: dict[str, Value] = {
                **assignment,
                **values,
                f"{path}.pos.x": x,
                f"{path}.pos.y": y,
                f"{path}.heading": (180.0 * back + float(rng.normal(0.0, 4.0))) % 360.0,
            }
            within = all(_allows(manifest, f"{path}.pos.{axis}", at) for axis, at in (("x", x), ("y", y)))
            if within and rejection_reason(proposal, manifest) is None:
                assignment.update(proposal)
                break


def _draw_weather(assignment: dict[str, Value], manifest: Manifest, rng: np.random.Generator) -> None:
    """Draw weather that is mostly fine; parameters that the asset does not declare are not set."""
    clouds, fog, rain = rng.random(3) < (_CLOUDS, _FOG, _RAIN)
    cover, thickness, rate = rng.random(3)
    for wanted, name, value in (
        (clouds, "cloud_cover", cover),
        (fog, "visibility", math.exp(math.log(60.0) + thickness * math.log(2000.0 / 60.0))),
        (rain, "rain", 20.0 * rate),
    ):
        if wanted:
            _assign(assignment, manifest, f"{ENVIRONMENT_PATH}.{name}", value)


def _pick(rng: np.random.Generator, shares: Mapping[str, float]) -> str:
    return str(rng.choice(list(shares), p=list(shares.values())))


def _assign(assignment: dict[str, Value], manifest: Manifest, path: str, value: float) -> None:
    """Set a value within the declared range; nothing if the asset does not declare the path."""
    definition = manifest.by_path.get(path)
    if definition is not None:
        lowest, highest = definition.bounds
        assignment[path] = min(max(float(value), lowest), highest)


def _allows(manifest: Manifest, path: str, value: float) -> bool:
    lowest, highest = manifest.definition(path).bounds
    return lowest <= value <= highest


def _free(manifest: Manifest, place: tuple[float, float, float], yaw: float) -> bool:
    """Return True if nothing is within 1 m of the camera's first 3 m, and no large obstacle within 12 m ahead."""
    x, y, height = place
    ahead = (-math.sin(math.radians(yaw)), math.cos(math.radians(yaw)))
    room, view = (shapely.LineString([(x, y), (x + ahead[0] * far, y + ahead[1] * far)]) for far in (3.0, 12.0))
    for obstacle in manifest.obstacles:
        if any(obstacle.path == path or obstacle.path.startswith(f"{path}.") for path in manifest.training.left_out):
            continue  # never shown
        polygon = shapely.Polygon(obstacle.polygon)
        reaches_up = obstacle.height_m is None or obstacle.height_m > height - 0.3
        if reaches_up and shapely.dwithin(polygon, room, 1.0):
            return False
        if polygon.area > 20.0 and reaches_up and shapely.intersects(polygon, view):
            return False
    return True


def _pose_shares(manifest: Manifest, person: str) -> Mapping[str, float]:
    """Return pose to its share; the shares add up to 1."""
    poses = manifest.definition(f"{person}.pose").choices
    weights = manifest.training.poses or dict.fromkeys(poses, 1.0)
    whole = sum(weights.values())
    return {pose: weight / whole for pose, weight in weights.items()}
