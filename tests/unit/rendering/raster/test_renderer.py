"""The raster engine's images against geometry and light with a known answer."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.sampling import enough_to_show
from tests.unit.rendering.one_mesh import SQUARE, one_mesh
from tests.unit.rendering.scene_rays import (
    blocked,
    dark_and_lit,
    footprints,
    near_edges,
    pixel_rays,
    trace,
    triangles_of,
)
from valerie.rendering.base import View, bounds
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.light.shadows import STATIC_MAP, even_directions
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.raster.upload.context import process_context
from valerie.rendering.sky import Sky, sky_of
from valerie.scene.graph.model import Camera, Environment, Material, Mesh, Node, Scene, Sun, Texture
from valerie.scene.graph.transforms import Pose, camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import box_mesh, simple_asset
from valerie.testing.rendering import assert_same

pytestmark = pytest.mark.gl


@example(-3.4161, 28.4147, 345.26, "blue-coat", 11.1507, 255.38, 22.342, "camera-2")
@example(0.9110, 23.0605, 102.92, "absent", 23.0507, 130.44, 22.889, "camera-1")  # a shadow's edge between two tiles
@given(
    x=st.floats(-8, 8),
    y=st.floats(0, 30),
    heading=st.floats(0, 359),
    second=st.sampled_from(["absent", "red-coat", "blue-coat"]),
    second_y=st.floats(0, 40),
    azimuth=st.floats(0, 359),
    elevation=st.floats(5, 85),
    camera=st.sampled_from(["camera-1", "camera-2"]),
)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_layer_over_the_background_is_the_frame_bit_for_bit_for_any_pose_and_sun(
    raster: RasterRenderer, x: float, y: float, heading: float, second: str, second_y: float, azimuth: float,
    elevation: float, camera: str,
) -> None:  # fmt: skip
    values = {
        "scene.person-1.pos.x": x,
        "scene.person-1.pos.y": y,
        "scene.person-1.heading": heading,
        "scene.person-2.character": second,
        "scene.person-2.pos.y": second_y,
        "scene.sun-1.azimuth": azimuth,
        "scene.sun-1.elevation": elevation,
    }
    scene, view = apply(values, simple_asset()), View(camera, 201, 117)
    layer = raster.layer(scene, view)
    assert_same(layer.over(raster.background(scene, view)), raster.full(scene, view))


@given(
    places=st.lists(st.tuples(st.floats(-5, 5), st.floats(0, 40), st.floats(0, 359)), min_size=4, max_size=4),
    azimuth=st.floats(0, 359),
    elevation=st.floats(5, 85),
)
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_frames_in_a_row_with_persons_and_cars_under_one_light_are_those_from_scratch(
    raster: RasterRenderer, places: list[tuple[float, float, float]], azimuth: float, elevation: float
) -> None:
    # The targets keep the statics' values from frame to frame, so every frame must be right after any other.
    asset = simple_asset()
    light = {"scene.sun-1.azimuth": azimuth, "scene.sun-1.elevation": elevation}
    view, frames = View("camera-1", 150, 86), []
    for i, (x, y, heading) in enumerate(places):
        second = {"scene.person-2.character": "blue-coat", "scene.person-2.pos.x": -x, "scene.person-2.pos.y": y / 2}
        pose = {"scene.person-1.pos.x": x, "scene.person-1.pos.y": y, "scene.person-1.heading": heading}
        scene = apply(light | pose | (second if i % 2 else {}), asset)
        car = scene.nodes["scene.car-1"]
        pose_of_car = np.array(car.transform)
        pose_of_car[:2, 3] += (x / 4, i - y / 10)
        moving = {"scene.car-1": replace(car, transform=pose_of_car, movable=True)}
        frames.append(replace(scene, nodes=dict(scene.nodes) | moving))
    background = raster.background(frames[0], view)
    images = [raster.layer(scene, view).over(background) for scene in frames]
    for scene, image in zip(frames, images, strict=True):
        assert_same(image, raster.full(scene, view))


@pytest.mark.parametrize(
    ("low", "high"), [((-0.9, -2.1, 0.2), (0.9, 2.1, 1.4)), ((-0.15, -0.15, 0.0), (0.15, 0.15, 1.75))]
)
def test_movables_hide_the_sky_from_the_ground_beside_and_below_them(
    raster: RasterRenderer, low: tuple[float, float, float], high: tuple[float, float, float]
) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, -6, 0.15), 0, -1, 0), focal_length_mm=60.0)
    floor = box_mesh((-30, -30, -1), (30, 30, 0), "floor")
    scene = one_mesh(floor, Material("floor", (0.04,) * 3, roughness=1.0, specular=0.0), camera)
    body = Node("scene.car-1", np.eye(4), (box_mesh(low, high, "black"),), movable=True, label_id=26)
    black = Material("black", (0.0,) * 3, roughness=1.0, specular=0.0)
    scene = replace(
        scene,
        nodes={**scene.nodes, body.path: body},
        materials={**scene.materials, "black": black},
        environment=Environment(cloud_cover=1.0),
    )
    view, alone = View("camera-1", 320, 120), triangles_of(replace(scene, nodes={body.path: body}))
    rays = pixel_rays(camera, view).reshape(-1, 3)
    ground = rays[:, 2] < 0
    places = camera.position + rays * (-camera.position[2] / np.where(ground, rays[:, 2], -1.0))[:, None]
    out = np.linalg.norm(np.maximum(np.abs(places[:, :2]) - high[:2], 0), axis=1)
    # Pixels beside the body's own are partly covered by it.
    own = alone.intersector.intersects_any(np.broadcast_to(camera.position, rays.shape), rays).reshape(120, 320)
    seen = ground & (out < 1.5) & ~cv2.dilate(own.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool).ravel()
    directions = even_directions(256)
    weights = directions[:, 2] * (1 + 2 * directions[:, 2])  # the overcast sky of the CIE, on level ground
    open_to = [~blocked(alone, places[seen] + [0, 0, 1e-4], direction) for direction in directions]
    expected = weights @ np.array(open_to) / weights.sum()
    with_body, without = (
        image.pixels[..., 1].astype(np.float64) for image in (raster.full(scene, view), raster.background(scene, view))
    )
    measured = (with_body / without).ravel()[seen]
    # A requirement of ours: a sixth of the sky's light, and a quarter below the body, where little is left.
    assert np.abs(measured - expected)[out[seen] > 0].max() < 1 / 6
    assert np.abs(measured - expected).max() < 1 / 4
    assert measured.min() < 0.7


@pytest.mark.parametrize("heading", [0.0, 30.0])
def test_a_canopy_hides_the_sky_from_who_stands_below_it(raster: RasterRenderer, heading: float) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, -8, 1.2), 0, 0, 0), focal_length_mm=90.0)
    black = Material("black", (0.0,) * 3, roughness=1.0, specular=0.0)
    turned = trimesh.transformations.rotation_matrix(math.radians(heading), (0, 0, 1))
    body, canopy = (
        Node(f"scene.{name}", turned, (box_mesh(low, high, material),), movable=True)
        for name, low, high, material in (
            ("person-1", (-0.25, -0.15, 0.0), (0.25, 0.15, 1.75), "matt"),
            ("umbrella-1", (-0.5, -0.5, 2.0), (0.5, 0.5, 2.03), "black"),
        )
    )
    scene = one_mesh(box_mesh((-30, -30, -1), (30, 30, 0), "black"), black, camera)
    scene = replace(
        scene,
        nodes={**scene.nodes, body.path: body},
        materials={"black": black, "matt": Material("matt", (0.5,) * 3, roughness=1.0, specular=0.0)},
        environment=Environment(cloud_cover=1.0),
    )
    covered = replace(scene, nodes={**scene.nodes, canopy.path: canopy})
    view, alone = View("camera-1", 320, 180), triangles_of(replace(scene, nodes={canopy.path: canopy}))
    prints = footprints(triangles_of(replace(scene, nodes={body.path: body})), camera, view)
    inside = prints.flat
    points, normals = prints.points[0][inside], prints.normals[inside]
    directions = even_directions(256)
    weights = np.maximum(normals @ directions.T, 0) * (1 + 2 * directions[:, 2])  # the overcast sky of the CIE
    open_to = np.stack([~blocked(alone, points + 1e-4 * normals, direction) for direction in directions], axis=1)
    expected = (weights * open_to).sum(axis=1) / weights.sum(axis=1)
    with_canopy, without = (raster.full(s, view).pixels[..., 1].astype(np.float64)[inside] for s in (covered, scene))
    # A requirement of ours: a sixth of the sky's light.
    np.testing.assert_allclose(with_canopy / without, expected, atol=1 / 6)
    assert expected.min() < 0.65
    assert (with_canopy / without).min() < 0.7


def test_the_layer_is_no_larger_than_the_changes_by_the_person(raster: RasterRenderer) -> None:
    scene = apply({"scene.person-1.pos.y": 30.0}, simple_asset())
    view = View("camera-1", 960, 540)
    changed = (raster.full(scene, view).pixels != raster.background(scene, view).pixels).any(axis=2)
    assert changed.any()
    assert raster.layer(scene, view).rectangle == bounds(changed)


def test_a_matt_floor_under_a_high_sun_has_the_radiance_of_its_albedo(raster: RasterRenderer) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, -10, 3), 0, -15, 0), focal_length_mm=50.0)
    floor = box_mesh((-30, -30, -1), (30, 30, 0), "floor")
    scene = one_mesh(floor, Material("floor", (0.4, 0.2, 0.1), roughness=1.0, specular=0.0), camera)
    pixels = raster.full(scene, View("camera-1", 64, 36)).pixels[20:30, 20:44].astype(np.float64)
    sky = sky_of(scene)
    directions = even_directions(32)  # those in which the engine samples the sky
    of_sky = (sky.radiance(directions) * 2 * directions[:, 2:]).mean(axis=0)
    of_sun = sky.sun * math.sin(math.radians(89))
    # Harmonics up to the second order: 1/4 + z/2 + (5/32)(3z² − 1) is at most 1/16 from the cosine z, straight above.
    np.testing.assert_array_less(
        np.abs(pixels.mean(axis=(0, 1)) / np.array([0.4, 0.2, 0.1]) - of_sun - of_sky), of_sky / 16
    )


@pytest.mark.parametrize("irradiance", [0.2, 1.0])
def test_the_disc_of_the_sun_sends_the_light_of_the_sun_as_far_as_float16_holds_it(
    raster: RasterRenderer, irradiance: float
) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, 0, 2), 0, 40, 0), focal_length_mm=400.0)
    floor = box_mesh((-3, -3, -1), (3, 3, 0), "floor")
    scene = one_mesh(floor, Material("floor", (0.4, 0.2, 0.1)), camera)
    bearing = math.degrees(math.atan2(*scene.sun_direction()[:2])) - math.degrees(scene.sun.azimuth)
    sun = Sun(math.radians(-bearing), math.radians(40), irradiance)
    scene = replace(scene, sun=sun, environment=replace(scene.environment, sky_strength=0.0))
    pixels = raster.full(scene, View("camera-1", 256, 144)).pixels.astype(np.float64)
    pixel = 36 / 256 / 400  # radians
    light = (pixels - pixels[:4].mean(axis=(0, 1))).sum(axis=(0, 1)) * pixel**2 / math.pi
    sunlight = sky_of(scene).sun
    stored = min(1.0, np.finfo(np.float16).max * (sun.angular_diameter / 2) ** 2 / sunlight.max())
    # The disc's rim is soft within 5 % of its radius. Cutting the middle, but not the rim, gains at most that share.
    np.testing.assert_allclose(light, sunlight * stored, rtol=0.01 if stored == 1.0 else 0.05)


@pytest.mark.parametrize("across", [20.0, 150.0, 600.0])
@pytest.mark.parametrize("tilt", [0.0, 30.0])
def test_open_ground_receives_the_whole_sky_however_far_it_reaches(
    raster: RasterRenderer, across: float, tilt: float
) -> None:
    # The ground is dark, so it could not make up by reflection for sky that it hid from itself.
    floor = box_mesh((-across / 2, -across / 2, -1), (across / 2, across / 2, 0), "floor")
    camera = Camera("scene.camera-1", camera_transform((0, 0, 6), 0, -90, 0), focal_length_mm=24.0)
    scene = one_mesh(floor, Material("floor", (0.04,) * 3, roughness=1.0, specular=0.0), camera)
    pose = Pose((0, 0, 0), (tilt, 0, 30)).matrix()
    turned = {path: replace(node, transform=pose) for path, node in scene.nodes.items()}
    scene = replace(scene, nodes=turned, environment=Environment(cloud_cover=1.0))
    pixels, sky = raster.full(scene, View("camera-1", 64, 36)).pixels.astype(np.float64), sky_of(scene)
    # Light of the overcast sky (Moon and Spencer 1942) on a tilted plane.
    up = math.cos(math.radians(tilt))
    share = (3 / 7) * (0.5 + 0.5 * up) + (4 / 7) * _moon_spencer(up)
    # The 32 directions give the light of the open sky within 0.4 % at this tilt. A cell of the map of the sky's visibility
    # whose centre lies below the tilted ground costs one direction: 3 % of the light at most, and 1.6 % between two places.
    assert pixels.mean() == pytest.approx(0.04 * share * sky.sky_irradiance.mean(), rel=0.034)
    assert pixels.std() < 0.016 * pixels.mean()


def _moon_spencer(up: float) -> float:
    """Return the light of a sky of radiance sin(elevation) on a face tilted by arccos(up), relative to a level one."""
    z, azimuth = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400 * 2 * np.pi)
    flat, lean = np.sqrt(1 - z * z), math.sqrt(1 - up * up)
    cosine = np.maximum(up * z + lean * flat * np.cos(azimuth), 0)
    return float((z * cosine).mean() / (z * z).mean())


@pytest.mark.parametrize("roughness", [0.1, 0.4, 0.9])
def test_specularly_reflected_light_is_missing_from_diffuse_reflection(
    raster: RasterRenderer, roughness: float
) -> None:
    # Along white ground under clouds, which are dimmer at the horizon, where the reflection comes from, than overhead.
    camera = Camera("scene.camera-1", camera_transform((0, -10, 1), 0, -4, 0), focal_length_mm=200.0)
    floor = box_mesh((-200, -200, -1), (200, 200, 0), "floor")
    white = {
        specular: one_mesh(floor, Material("floor", (1.0,) * 3, roughness=roughness, specular=specular), camera)
        for specular in (0.0, 1.0)
    }
    matt, glossy = (
        raster.full(replace(scene, environment=Environment(cloud_cover=1.0)), View("camera-1", 32, 18)).pixels
        for scene in white.values()
    )
    # Half floats round by a part in 2,048.
    assert glossy.astype(np.float64).mean() <= (1 + 2 / 2048) * matt.astype(np.float64).mean()


def ggx_radiance(sky: Sky, roughness: float, facing: float) -> NDArray[np.float64]:
    """Return the radiance, (3,), of level dielectric microfacets (GGX, Smith, Schlick) under a sky, by a sum over directions."""
    z, azimuth = np.meshgrid((np.arange(300) + 0.5) / 300, (np.arange(600) + 0.5) / 600 * 2 * np.pi)
    flat, alpha = np.sqrt(1 - z * z), roughness**2
    light = np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), z], axis=-1).reshape(-1, 3)
    view = np.array([0.0, -math.sqrt(1 - facing**2), facing])
    half = (light + view) / np.linalg.norm(light + view, axis=1, keepdims=True)
    distribution = alpha**2 / np.pi / (half[:, 2] ** 2 * (alpha**2 - 1) + 1) ** 2

    def shadow(cosine: NDArray[np.float64] | float) -> NDArray[np.float64]:
        return np.asarray(np.sqrt(1 + alpha**2 * (1 / np.square(cosine) - 1)) - 1) / 2

    fresnel = 0.04 + 0.96 * (1 - half @ view) ** 5
    share = distribution * fresnel / (1 + shadow(facing) + shadow(light[:, 2])) / (4 * facing)
    radiance: NDArray[np.float64] = 2 * np.pi * (share[:, None] * sky.radiance(light)).mean(axis=0)
    return radiance


@pytest.mark.parametrize("roughness", [0.6, 0.8, 0.9])
def test_a_rough_floor_mirrors_the_sky_at_grazing_angles_as_microfacets_do(
    raster: RasterRenderer, roughness: float
) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, -6, 1), 0, -10, 0), focal_length_mm=200.0)
    floor = box_mesh((-200, -200, -1), (200, 200, 0), "floor")
    scene = one_mesh(floor, Material("floor", (0.0,) * 3, roughness=roughness), camera)
    scene = replace(scene, environment=Environment(cloud_cover=1.0))
    expected = ggx_radiance(sky_of(scene), roughness, math.sin(math.radians(10)))
    mirrored = raster.full(scene, View("camera-1", 32, 18)).pixels.astype(np.float64).mean(axis=(0, 1))
    # A quarter, a requirement of ours: the engine splits the sum.
    assert mirrored == pytest.approx(expected, rel=0.25)


MIRROR = Material("mirror", (1.0, 1.0, 1.0), roughness=0.04, metallic=1.0)
CHALK = Material("chalk", (0.5, 0.4, 0.3), roughness=1.0, specular=0.0)


def looking_into_a_mirror(
    raster: RasterRenderer, pitch: float, *, wall: bool
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Return, under clouds, the mean colour of a mirror, that of the chalky ground, and the extremes of all that is behind.

    In the mirror the camera sees ``pitch`` degrees above the horizon.
    """
    turned = Pose((0, 2, 3), (-pitch / 2, 0, 0)).matrix()
    nodes = [
        Node("scene.road-1", np.eye(4), (box_mesh((-40, -40, -1), (40, 40, 0), "chalk"),), label_id=7),
        Node("scene.wall-1", turned, (box_mesh((-0.5, 0, -0.5), (0.5, 0.01, 0.5), "mirror"),), label_id=12),
    ]
    if wall:
        nodes.append(Node("scene.wall-2", np.eye(4), (box_mesh((-30, -9, 0), (30, -8, 25), "chalk"),), label_id=12))
    cameras = {
        "mirror": Camera("scene.mirror", camera_transform((0, 0, 3), 0, 0, 0), focal_length_mm=120.0),
        "ground": Camera("scene.ground", camera_transform((0, 0, 3), 180, -60, 0), focal_length_mm=120.0),
        "behind": Camera("scene.behind", camera_transform((0, 0, 3), 180, 0, 0), focal_length_mm=18.0),
    }
    scene = Scene(
        {node.path: node for node in nodes}, {"mirror": MIRROR, "chalk": CHALK}, {}, cameras, Sun(0.0, math.radians(50)),
        environment=Environment(cloud_cover=1.0),
    )  # fmt: skip
    mirror, ground, behind = (
        raster.full(scene, View(name, 32, 18)).pixels.astype(np.float64).reshape(-1, 3) for name in cameras
    )
    return mirror.mean(axis=0), ground.mean(axis=0), (behind.min(axis=0), behind.max(axis=0))


def test_a_mirror_shows_the_sky_or_the_surfaces_that_hide_it_or_the_ground(raster: RasterRenderer) -> None:
    sky = sky_of(replace(simple_asset().base, environment=Environment(cloud_cover=1.0), sun=Sun(0.0, math.radians(50))))
    up = np.array([[0.0, -math.cos(math.radians(30)), math.sin(math.radians(30))]])
    mirrored, *_ = looking_into_a_mirror(raster, 30.0, wall=False)
    # A smooth white mirror reflects all light. The sky of the table's nearest entry, 2.7° high, and the panorama's nearest texel,
    # 1.1° wide, differ from its mean by cos(30°) / (1 + sin(30°) + 1/2) of the 1.35° and of the 0.55° between.
    entry = math.radians(1.35 + 0.55) * 0.87
    assert mirrored == pytest.approx(sky.radiance(up)[0], rel=entry)
    mirrored, _, (darkest, brightest) = looking_into_a_mirror(raster, 30.0, wall=True)
    # The mirror shows the wall, whose colour lies between the extremes of all that is behind: to a ninth of a stop, a
    # requirement of ours.
    ninth = 2.0 ** (1 / 9)
    assert (mirrored > darkest / ninth).all()
    assert (mirrored < brightest * ninth).all()
    mirrored, ground, _ = looking_into_a_mirror(raster, -40.0, wall=False)
    assert mirrored == pytest.approx(ground, rel=0.01)


@pytest.mark.parametrize("movable", [False, True])
def test_a_mirror_away_from_the_camera_shows_things_where_reflected_rays_meet_them(
    raster: RasterRenderer, movable: bool
) -> None:
    # The mirror stands 6 m ahead, the wall with two colours 4 m behind; seen from the camera, its edge is elsewhere.
    corner, edge, wall = np.array([0.0, 6.0, 3.0]), 1.0, -4.0
    turned = Pose(tuple(corner), (0, 0, 12)).matrix()
    nodes = [
        Node("scene.car-1", turned, (box_mesh((-2, 0, -1), (2, 0.01, 1), "mirror"),), label_id=26, movable=movable),
        Node("scene.wall-1", np.eye(4), (box_mesh((-60, wall - 1, 0), (edge, wall, 40), "left"),), label_id=12),
        Node("scene.wall-2", np.eye(4), (box_mesh((edge, wall - 1, 0), (60, wall, 40), "right"),), label_id=12),
    ]
    colours = {"left": (0.6, 0.02, 0.02), "right": (0.02, 0.02, 0.6)}
    materials = {name: Material(name, colour, roughness=1.0, specular=0.0) for name, colour in colours.items()}
    camera = Camera("scene.camera-1", camera_transform((0.2, 0.1, 3.3), 0, 0, 0), focal_length_mm=60.0)
    scene = Scene(
        {node.path: node for node in nodes}, {"mirror": MIRROR, **materials}, {}, {"camera-1": camera},
        Sun(0.0, math.radians(50)), environment=Environment(cloud_cover=1.0),
    )  # fmt: skip
    view = View("camera-1", 96, 54)
    pixels = raster.full(scene, view).pixels.astype(np.float64)
    rays, across = pixel_rays(camera, view), turned[:3, 1]
    met = camera.position + rays * ((corner - camera.position) @ across / (rays @ across))[..., None]
    reflected = rays - 2 * (rays @ across)[..., None] * across
    x = met[..., 0] + reflected[..., 0] * (wall - met[..., 1]) / reflected[..., 1]
    within = (np.abs((met - corner) @ turned[:3, :3])[..., [0, 2]] < (1.9, 0.9)).all(axis=2)
    # Seen from the camera's metre, a texel of 1.6° covers 0.15 m of the wall. Distances interpolated over it add as much.
    sure = within & (np.abs(x - edge) > 0.3)
    assert min((sure & (x < edge)).sum(), (sure & (x > edge)).sum()) >= 300
    assert ((pixels[..., 0] > pixels[..., 2]) == (x < edge))[sure].all()


# A movable mirrors the panorama, a large pane of the statics a picture of its own.
@pytest.mark.parametrize("movable", [True, False])
@pytest.mark.parametrize(
    ("azimuth", "low", "high"),
    [
        # A tower aside, which stands elsewhere for the camera, and a wall farther away than all else.
        (-53.13, (-54, -14, 0), (-26, 14, 60)),
        (10.0, (-80, -131, 0), (80, -130, 100)),
    ],
)
def test_a_mirror_shows_what_hides_the_sky_from_it_and_not_from_the_camera(
    raster: RasterRenderer, *, azimuth: float, low: tuple[float, ...], high: tuple[float, ...], movable: bool
) -> None:
    # The mirror stands 30 m ahead. It shows the direction ``azimuth`` from straight behind the camera, 15° high.
    place, elevation, turn = np.array([0.0, 30.0, 3.0]), math.radians(15), math.radians(azimuth)
    shown = np.array([math.cos(elevation) * math.sin(turn), -math.cos(elevation) * math.cos(turn), math.sin(elevation)])
    into = np.array([0.0, 1.0, 0.0]) - shown
    right = np.cross(into, (0, 0, 1))
    into, right = into / np.linalg.norm(into), right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, into, np.cross(right, into), place], axis=1)
    first, last = np.sort((np.array([low, high]) - place) / shown, axis=0)
    assert 0 < first.max() < last.min()
    camera = Camera("scene.camera-1", camera_transform((0, 0, 3), 0, 0, 0), focal_length_mm=1200.0)
    nodes = [
        Node("scene.road-1", np.eye(4), (box_mesh((-90, -140, -1), (90, 60, 0), "chalk"),), label_id=7),
        Node(
            "scene.car-1", pose, (box_mesh((-0.5, 0, -0.5), (0.5, 0.01, 0.5), "mirror"),), label_id=26, movable=movable
        ),
        Node("scene.wall-1", np.eye(4), (box_mesh(low, high, "tower"),), label_id=12),
    ]
    black = Material("tower", (0.0,) * 3, roughness=1.0, specular=0.0)
    scene = Scene(
        {node.path: node for node in nodes}, {"mirror": MIRROR, "chalk": CHALK, "tower": black}, {}, {"camera-1": camera},
        Sun(0.0, math.radians(50)), environment=Environment(cloud_cover=1.0),
    )  # fmt: skip
    mirrored = raster.full(scene, View("camera-1", 32, 18)).pixels.astype(np.float64).mean(axis=(0, 1))
    assert (mirrored < 0.25 * sky_of(scene).radiance(shown[None])[0]).all()


@pytest.mark.parametrize("movable", [False, True])
@pytest.mark.parametrize("double_sided", [False, True])
def test_no_sunlight_passes_through_a_head(raster: RasterRenderer, movable: bool, double_sided: bool) -> None:
    # The head is round and no wider than the blocker search. A double-sided one transmits light: it faces away from the sun.
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    mesh = Mesh(
        ball.vertices.astype(np.float32), ball.vertex_normals.astype(np.float32),
        np.zeros((len(ball.vertices), 2), np.float32), ball.faces.astype(np.uint32), "skin",
    )  # fmt: skip
    head = Node("scene.person-1", Pose((0, 4, 1.6), (0, 0, 0)).matrix(), (mesh,), label_id=24, movable=movable)
    ground = Node("scene.road-1", np.eye(4), (box_mesh((-30, -30, -1), (30, 90, 0), "tar"),), label_id=7)
    skin = Material("skin", (0.6, 0.5, 0.4), roughness=1.0, specular=0.0, double_sided=double_sided)
    tar = Material("tar", (0.0, 0.0, 0.0), roughness=1.0, specular=0.0)
    camera = Camera("scene.camera-1", camera_transform((0, 0, 1.6), 0, 0, 0), focal_length_mm=400.0)
    # The sun stands behind the head, 40° high. There is no sky, and no light from below.
    scene = Scene(
        {head.path: head, ground.path: ground}, {"skin": skin, "tar": tar}, {}, {"camera-1": camera}, Sun(0.0, math.radians(40)),
        environment=Environment(sky_strength=0.0),
    )  # fmt: skip
    assert scene.sun_direction()[1] == pytest.approx(math.cos(math.radians(40)))
    view = View("camera-1", 160, 120)
    pixels = raster.full(scene, view).pixels.astype(np.float64).sum(axis=2)
    rays, origin = pixel_rays(camera, view), camera.position - np.array([0, 4, 1.6])
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    along = -(rays @ origin)
    inside = 0.1**2 - (origin @ origin - along**2)
    # Away from the outline, where pixels also show the background.
    hit = inside > 0.001
    normals = (origin + rays * (along - np.sqrt(np.where(hit, inside, 0)))[..., None]) / 0.1
    facing = np.where(hit, normals @ scene.sun_direction(), 0)
    assert (facing < -0.15).sum() >= enough_to_show(0.001)
    # The sunlight on a place is its albedo times the cosine, of which the air before it leaves the rest out.
    lit = np.array(skin.base_color) @ (sky_of(scene).sun * np.exp(-4 * sky_of(scene).extinction))
    assert np.median(pixels[facing > 0.15]) > 0.15 * lit
    # Statics are part of the surroundings of a place, so it receives some of its own light: at most a twentieth of the brightest
    # place's, a requirement of ours.
    assert pixels[facing < -0.15].max() <= (0.0 if movable else 0.05 * pixels.max())


@pytest.mark.parametrize("away", [40.0, 90.0, 120.0])
def test_a_sunlit_wall_does_not_shadow_itself_however_far_it_is(raster: RasterRenderer, away: float) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, 0, 5), 0, 0, 0), focal_length_mm=200.0, near=0.1, far=600.0)
    wall = box_mesh((-20, away, -5), (20, away + 8, 15), "wall")
    scene = one_mesh(wall, Material("wall", (0.5, 0.5, 0.5), roughness=1.0, specular=0.0), camera, elevation=35.0)
    for azimuth in (140.0, 180.0, 230.0):
        shining = replace(scene, sun=replace(scene.sun, azimuth=math.radians(azimuth)))
        pixels = raster.full(shining, View("camera-1", 160, 90)).pixels[20:70, 20:140, 1].astype(np.float64)
        np.testing.assert_allclose(pixels, np.median(pixels), rtol=0.02)


@pytest.mark.parametrize("movable", [False, True])
def test_shadows_fall_where_rays_to_the_sun_are_blocked(raster: RasterRenderer, movable: bool) -> None:
    scene, view = apply({"scene.sun-1.azimuth": 250.0}, simple_asset()), View("camera-1", 320, 180)
    # All surfaces are of one matt grey, and there is no sky: an image value is the sun's share times what follows.
    albedo = 0.1
    grey = {name: Material(name, (albedo,) * 3, roughness=1.0, specular=0.0) for name in scene.materials}
    nodes = {path: replace(node, movable=node.movable and movable) for path, node in scene.nodes.items()}
    scene = replace(scene, nodes=nodes, materials=grey, environment=replace(scene.environment, sky_strength=0.0))
    camera, triangles = scene.cameras["camera-1"], triangles_of(scene)
    toward_sun, sky = scene.sun_direction(), sky_of(scene)
    surfaces = footprints(triangles, camera, view)
    cosine = np.maximum(surfaces.normals @ toward_sun, 0.3)
    surfaces = replace(surfaces, flat=surfaces.flat & (surfaces.normals @ toward_sun > 0.3))
    # An edge is blurred by half the sun's disc seen from the highest caster, the roof at 8 m; by the smallest kernel, three
    # quarters of a texel; and by half a texel's diagonal, up to which the map is off. The map's box reaches two metres beyond
    # the ground and one beyond that, so that its texels are at most the box's diagonal by their number wide.
    texel = math.hypot(40 + 6, 60 + 6) / STATIC_MAP
    blur = 8.0 / toward_sun[2] * math.tan(scene.sun.angular_diameter / 2) + (0.75 + math.sqrt(0.5)) * texel
    dark, lit = dark_and_lit(
        surfaces, lambda points: blocked(triangles, points + 0.012 * toward_sun, toward_sun), blur / cosine, error=0.006
    )
    passed = np.exp(-sky.extinction[1] * np.linalg.norm(surfaces.points[0] - camera.position, axis=2))
    share = raster.full(scene, view).pixels[..., 1] / (albedo * sky.sun[1] * cosine * passed)
    # Light reflected any number of times by surfaces in the full sun.
    reflected = albedo / (1 - albedo) / cosine
    assert (share[dark] <= reflected[dark]).all()
    assert (share[lit] >= 1).all()
    assert (share[lit] <= 1 + reflected[lit]).all()


@pytest.mark.parametrize("movable", [False, True])
@pytest.mark.parametrize("angle", [0.01, 0.03])
def test_a_shadow_is_as_soft_as_the_suns_disc_makes_it(raster: RasterRenderer, angle: float, movable: bool) -> None:
    # A roof ends at x = 0, 12 m above the ground. The sun stands almost at the zenith, and there is no sky.
    roof = Node("scene.wall-1", np.eye(4), (box_mesh((-3, -3, 12), (0, 3, 12.1), "m"),), label_id=12, movable=movable)
    ground = Node("scene.road-1", np.eye(4), (box_mesh((-3, -3, -1), (3, 3, 0), "m"),), label_id=7)
    camera = Camera("scene.camera-1", camera_transform((0.0, 0.0, 10.0), 0, -90, 0), focal_length_mm=300.0)
    scene = Scene(
        {roof.path: roof, ground.path: ground}, {"m": Material("m", (0.02,) * 3, roughness=1.0, specular=0.0)}, {},
        {"camera-1": camera}, Sun(0.0, math.radians(89.99), angular_diameter=angle), Environment(sky_strength=0.0),
    )  # fmt: skip
    columns = raster.full(scene, View("camera-1", 96, 54)).pixels[..., 1].astype(np.float64).mean(axis=0)
    x, half = (np.arange(96) + 0.5 - 48) / 96 * 36 / 300 * 10, 12 * math.tan(angle / 2)
    # The engine looks at ten places of the disc: half a tap.
    np.testing.assert_allclose(columns / columns.max(), lit_by_a_disc(x / half), atol=0.05)


def lit_by_a_disc(places: np.ndarray) -> np.ndarray:
    """Return the visible share of a uniform disc behind a straight edge, ``places`` radii from the edge's own shadow."""
    u = np.clip(places, -1.0, 1.0)
    return 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi


def test_the_first_row_of_a_texture_is_at_v_zero(raster: RasterRenderer) -> None:
    image = np.zeros((64, 64, 3), np.uint8)
    image[:32], image[32:] = (255, 0, 0), (0, 0, 255)
    camera = Camera("scene.camera-1", camera_transform((0, 0, 1), 0, 0, 0), focal_length_mm=50.0)
    scene = one_mesh(SQUARE, Material("m", (1, 1, 1), base_color_texture="image", specular=0.0), camera, image=image)
    pixels = raster.full(scene, View("camera-1", 64, 64)).pixels
    top, bottom = pixels[20, 32], pixels[44, 32]
    # Red and blue reflect none of each other's light. The haze of 5.1 m of air, the way to these pixels, adds some to both.
    sky = sky_of(scene)
    haze = sky.haze * (1 - np.exp(-5.1 * sky.extinction))
    assert top[2] <= haze[2] < top[0]
    assert bottom[0] <= haze[0] < bottom[2]


@pytest.mark.parametrize("double_sided", [False, True])
def test_back_faces_show_only_if_the_material_is_double_sided(
    raster: RasterRenderer, truth_pass: TruthPass, double_sided: bool
) -> None:
    quad = Mesh(
        positions=np.float32([[-1, 5, 0], [-1, 5, 2], [1, 5, 2], [1, 5, 0]]),
        normals=np.float32([[0, 1, 0]] * 4),
        uvs=np.zeros((4, 2), np.float32),
        faces=np.uint32([[0, 1, 2], [0, 2, 3]]),
        material="m",
    )
    camera = Camera("scene.camera-1", camera_transform((0, 0, 1), 0, 0, 0), focal_length_mm=50.0)
    scene = one_mesh(quad, Material("m", double_sided=double_sided), camera)
    truth = truth_pass.truth(scene, View("camera-1", 32, 32))
    assert (truth.class_map == 12).any() == double_sided


@pytest.mark.parametrize(("translucency", "t"), [(None, 0.18), (0.0, 0.0), (0.45, 0.45)])
def test_a_sheet_shows_the_stated_share_of_the_light_behind_it(
    raster: RasterRenderer, translucency: float | None, t: float
) -> None:
    positions = np.float32([[-0.3, 5, -0.3], [0.3, 5, -0.3], [0.3, 5, 0.3], [-0.3, 5, 0.3]])
    normals, uvs = np.float32([[0, -1, 0]] * 4), np.zeros((4, 2), np.float32)
    quad = Mesh(positions, normals, uvs, np.uint32([[0, 1, 2], [0, 2, 3]]), "m")
    sheet = Material("m", roughness=1.0, specular=0.0, double_sided=True, translucency=translucency)
    camera = Camera("scene.camera-1", camera_transform((0, 0, 0), 0, 0, 0), focal_length_mm=200.0)
    wall = Node("scene.wall-1", np.eye(4), (quad,), label_id=12, movable=True)
    ground = Node("scene.road-1", np.eye(4), (box_mesh((-30, -30, -11), (30, 90, -10), "tar"),), label_id=7)
    tar = Material("tar", (0.0, 0.0, 0.0), roughness=1.0, specular=0.0)
    # There is no sky, and no light from below.
    scene = Scene(
        {wall.path: wall, ground.path: ground}, {"m": sheet, "tar": tar}, {}, {"camera-1": camera}, Sun(0.0, math.radians(30.0)),
        environment=Environment(sky_strength=0.0),
    )  # fmt: skip

    def brightness(azimuth: float) -> float:
        lit = replace(scene, sun=replace(scene.sun, azimuth=math.radians(azimuth)))
        return float(raster.full(lit, View("camera-1", 64, 36)).pixels[12:24, 24:40].mean(dtype=np.float64))

    # The sun behind the sheet, then before it: t against 1 − t, in half precision.
    assert brightness(0.0) / brightness(180.0) == pytest.approx(t / (1.0 - t), abs=0.003)


def test_cut_out_texels_show_and_label_the_background(raster: RasterRenderer, truth_pass: TruthPass) -> None:
    image = np.full((64, 64, 4), 255, np.uint8)
    image[:, 32:, 3] = 0
    camera = Camera("scene.camera-1", camera_transform((0, 0, 1), 0, 0, 0), focal_length_mm=50.0)
    scene = one_mesh(SQUARE, Material("m", base_color_texture="image", alpha_cutoff=0.5), camera, image=image)
    view = View("camera-1", 64, 64)
    labels = truth_pass.truth(scene, view).class_map
    assert (labels[32, 22:31] == 12).all()
    assert (labels[32, 33:42] == 23).all()
    pixels = raster.full(scene, view).pixels
    nothing = raster.full(replace(scene, nodes={}), view).pixels
    np.testing.assert_array_equal(pixels[28, 34:42], nothing[28, 34:42])
    assert (pixels[28, 22:30] != nothing[28, 22:30]).any(axis=1).all()


def test_labels_are_aligned_with_the_image(raster: RasterRenderer, truth_pass: TruthPass) -> None:
    # Edges at pixels 58.9 and 134.1, away from the centre of a pixel, where they would cover half of its samples.
    camera = Camera("scene.camera-1", camera_transform((0, 0, 1), 0, 0, 0), focal_length_mm=50.0)
    block = box_mesh((-0.7398, 5, -2), (0.6138, 6, 1.4), "m")
    scene = one_mesh(block, Material("m", (0, 0, 0), specular=0.0), camera, elevation=60.0)
    view = View("camera-1", 200, 100)
    row = raster.full(scene, view).pixels[60].astype(np.float64).sum(axis=1)
    label = truth_pass.truth(scene, view).class_map[60] == 12
    dark = row < (row.min() + row[[0, -1]].mean()) / 2
    np.testing.assert_array_equal(np.flatnonzero(np.diff(dark)), np.flatnonzero(np.diff(label)))


def test_a_mirrored_node_faces_outwards(truth_pass: TruthPass) -> None:
    asset = simple_asset()
    node = asset.base.nodes["scene.car-1"]
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    nodes = dict(asset.base.nodes) | {"scene.car-1": replace(node, transform=node.transform @ mirror)}
    scene, view = replace(asset.base, nodes=nodes), View("camera-1", 160, 90)
    classes, _, depth = trace(triangles_of(scene), scene.cameras["camera-1"], view)
    truth = truth_pass.truth(scene, view)
    car = (classes == 26) & ~near_edges(classes)
    assert (truth.class_map[car] == 26).all()
    # A body turned inside out would show its far side, metres behind.
    np.testing.assert_allclose(truth.depth[car], depth[car], rtol=1e-3)


def test_specular_tint_colours_the_highlight(raster: RasterRenderer) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, -4, 2), 0, -30, 0), focal_length_mm=50.0)
    floor = box_mesh((-30, -30, -1), (30, 30, 0), "m")

    def highlight(tint: float) -> np.ndarray:
        material = Material("m", (0.02, 0.002, 0.002), roughness=0.4, specular=2.0, specular_tint=tint)
        # The sun stands ahead, so that the floor mirrors it into the camera.
        scene = one_mesh(floor, material, camera, elevation=35.0)
        return raster.full(scene, View("camera-1", 64, 64)).pixels.astype(np.float64).reshape(-1, 3).max(axis=0)

    white, tinted = highlight(0.0), highlight(1.0)
    assert tinted[0] / tinted[2] > 2 * white[0] / white[2]


def test_a_metal_has_no_diffuse_light(raster: RasterRenderer) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, -4, 6), 0, -60, 0), focal_length_mm=50.0)
    floor = box_mesh((-30, -30, -1), (30, 30, 0), "m")
    scene = one_mesh(floor, Material("m", (0.8, 0.8, 0.8), metallic=1.0, roughness=0.1), camera, 20.0)
    metal = raster.full(scene, View("camera-1", 32, 32)).pixels.astype(np.float64).mean(axis=(0, 1))
    # It mirrors its share of the sky, to a ninth of a stop, a requirement of ours. Light of the sun would double that.
    rays = pixel_rays(camera, View("camera-1", 32, 32)).reshape(-1, 3) * [1, 1, -1]
    sky = sky_of(scene).radiance(rays / np.linalg.norm(rays, axis=1, keepdims=True)).mean(axis=0)
    assert metal == pytest.approx(0.8 * sky, rel=2.0 ** (1 / 9) - 1)


@pytest.mark.parametrize("movable", [False, True])
def test_a_roughness_map_changes_the_highlight_where_it_is_smooth(raster: RasterRenderer, movable: bool) -> None:
    camera = Camera("scene.camera-1", camera_transform((0, -4, 2), 0, -30, 0), focal_length_mm=50.0)
    floor = box_mesh((-8, -8, -1), (8, 8, 0), "m")
    # u grows with x on the floor. The map smooths the left half and leaves the right half to the material.
    image = np.full((64, 64, 3), 255, np.uint8)
    image[:, :32, 1] = 102

    def image_of(material: Material) -> np.ndarray:
        scene = one_mesh(floor, material, camera, elevation=35.0, image=image)
        nodes = {path: replace(node, movable=movable) for path, node in scene.nodes.items()}
        return raster.full(replace(scene, nodes=nodes), View("camera-1", 64, 64)).pixels.astype(np.float64)

    smooth, rough = (image_of(Material("m", (0.05, 0.05, 0.05), roughness=r)) for r in (0.4, 1.0))
    mapped = image_of(Material("m", (0.05, 0.05, 0.05), roughness=1.0, roughness_texture="image"))
    # Away from the edge between them, which coarser mip levels blur.
    left, right = np.s_[24:, :24], np.s_[24:, 40:]
    # Two steps of float16, 2⁻¹⁰ each: the map's 102 / 255 and the material's 0.4 are the same roughness.
    rounding = 2e-3
    assert smooth[left].max() > (1 + 100 * rounding) * rough[left].max()
    np.testing.assert_allclose(mapped[left], smooth[left], rtol=rounding)
    np.testing.assert_array_equal(mapped[right], rough[right])


def test_the_cache_of_statics_notices_a_changed_roughness_map(raster: RasterRenderer) -> None:
    scene, view = simple_asset().base, View("camera-1", 64, 36)
    textures = scene.textures | {n: Texture(n, np.full((8, 8, 3), v, np.uint8)) for n, v in (("a", 40), ("b", 250))}
    pictures = []
    for name in "ab":
        paving = replace(scene.materials["paving"], roughness_texture=name)
        mapped = replace(scene, textures=textures, materials=scene.materials | {"paving": paving})
        pictures.append(raster.background(mapped, view).pixels)
    assert (pictures[0] != pictures[1]).any()


def test_the_cache_of_statics_notices_a_changed_static_material(raster: RasterRenderer) -> None:
    scene, view = simple_asset().base, View("camera-1", 64, 36)
    before = raster.background(scene, view)
    red = dict(scene.materials) | {"plaster": replace(scene.materials["plaster"], base_color=(0.9, 0.0, 0.0))}
    shiny = dict(scene.materials) | {"paint": replace(scene.materials["paint"], roughness=0.05, metallic=1.0)}
    for changed in (red, shiny):
        other = replace(scene, materials=changed)
        assert_same(raster.background(other, view), raster.full(apply_absent(other), view))
        assert (raster.background(other, view).pixels != before.pixels).any()
    assert_same(raster.background(scene, view), before)


def apply_absent(scene: Scene) -> Scene:
    """Return the scene with every movable hidden."""
    return replace(scene, nodes={p: replace(n, visible=n.visible and not n.movable) for p, n in scene.nodes.items()})


def test_repainted_statics_hide_the_same_part_of_the_sky() -> None:
    scene = simple_asset().base
    red = dict(scene.materials) | {"plaster": replace(scene.materials["plaster"], base_color=(0.9, 0.0, 0.0))}
    context = process_context()
    with context.current():
        before = context.scenes.prepare(scene).statics
        after = context.scenes.prepare(replace(scene, materials=red)).statics
    assert before.key != after.key
    assert before.shape_key == after.shape_key


def test_the_cache_of_statics_notices_a_moved_static(raster: RasterRenderer) -> None:
    scene, view = simple_asset().base, View("camera-1", 64, 36)
    before = raster.background(scene, view)
    car = scene.nodes["scene.car-1"]
    moved = np.array(car.transform)
    moved[0, 3] -= 1.0
    other = replace(scene, nodes=dict(scene.nodes) | {"scene.car-1": replace(car, transform=moved)})
    assert_same(raster.background(other, view), raster.full(apply_absent(other), view))
    assert_same(raster.background(scene, view), before)


def pane_scene(transmission: float | None) -> Scene:
    """Return a bright wall behind a dark pane that covers the whole image; without a pane for None."""
    camera = Camera("scene.camera-1", camera_transform((0.0, -4.0, 1.0), 0.0, 0.0, 0.0), 60.0)
    wall = box_mesh((-9.0, 2.0, -9.0), (9.0, 2.1, 9.0), "wall")
    pane = box_mesh((-3.0, 0.0, -3.0), (3.0, 0.02, 3.0), "pane")
    nodes = {"scene.wall-1": Node("scene.wall-1", np.eye(4), (wall,), label_id=12)}
    if transmission is not None:
        nodes["scene.car-1"] = Node("scene.car-1", np.eye(4), (pane,), label_id=26, instance_id=26001)
    materials = {
        "wall": Material("wall", (0.0, 0.0, 0.0), specular=0.0, emissive=(0.8, 0.4, 0.2)),
        "pane": Material("pane", (0.0, 0.0, 0.0), specular=0.0, transmission=transmission or 0.0),
    }
    return Scene(nodes, materials, {}, {"camera-1": camera}, Sun(0.0, math.radians(60.0)))


# One or three of four samples are the pane's. The resolve filter weighs them within 7 % of their share.
@pytest.mark.parametrize(("transmission", "tolerance"), [(0.25, 0.07), (0.5, 0.005), (0.75, 0.07), (1.0, 0.005)])
def test_a_pane_lets_its_share_of_light_through_in_every_pixel(
    raster: RasterRenderer, transmission: float, tolerance: float
) -> None:
    view = View("camera-1", 48, 32)
    free, opaque, pane = (
        raster.full(pane_scene(share), view).pixels[4:-4, 4:-4].astype(np.float64)
        for share in (None, 0.0, transmission)
    )
    expected = transmission * free + (1.0 - transmission) * opaque
    assert (np.abs(pane - expected) <= tolerance * np.abs(free - opaque) + 1e-3).all()
    np.testing.assert_allclose(pane.mean(), expected.mean(), atol=1e-3)


def test_labels_and_depth_of_a_pane_are_its_own(truth_pass: TruthPass) -> None:
    truth = truth_pass.truth(pane_scene(0.5), View("camera-1", 48, 32))
    assert (truth.class_map == 26).all()
    assert (truth.instance_map == 26001).all()
    # The wall stands metres behind. Depths agree to 10⁻⁵.
    np.testing.assert_allclose(truth.depth, 4.0, rtol=1e-5)


def test_a_pane_casts_no_shadow(raster: RasterRenderer) -> None:
    camera = Camera("scene.camera-1", camera_transform((0.0, -6.0, 3.0), 0.0, -25.0, 0.0), 50.0)
    ground = box_mesh((-9.0, -9.0, -0.1), (9.0, 9.0, 0.0), "ground")
    pane = box_mesh((-1.0, -1.0, 2.9), (1.0, 1.0, 2.92), "pane")

    def ground_under_a_pane(share: float) -> np.ndarray:
        nodes = {
            "scene.road-1": Node("scene.road-1", np.eye(4), (ground,), label_id=7),
            "scene.car-1": Node("scene.car-1", np.eye(4), (pane,), label_id=26, instance_id=26001),
        }
        materials = {"ground": Material("ground", (0.5, 0.5, 0.5)), "pane": Material("pane", transmission=share)}
        scene = Scene(nodes, materials, {}, {"camera-1": camera}, Sun(0.0, math.radians(89.0)))
        return raster.full(scene, View("camera-1", 96, 64)).pixels[..., 1].astype(np.float64)

    # An opaque pane leaves the light of the sky at most.
    sky = sky_of(one_mesh(ground, Material("ground"), camera, 89.0))
    share = sky.sky_irradiance[1] / (sky.sky_irradiance[1] + sky.sun[1] * math.sin(math.radians(89.0)))
    assert ground_under_a_pane(0.0)[32:].min() < share * ground_under_a_pane(0.5)[32:].min()


@pytest.mark.parametrize("y", [-3.0, 2.0])
def test_the_layer_over_the_background_is_the_frame_before_and_behind_panes(raster: RasterRenderer, y: float) -> None:
    """A movable with a pane of its own stands in front of a static pane or behind it."""
    camera = Camera("scene.camera-1", camera_transform((0.0, -7.0, 1.2), 0.0, 0.0, 0.0), 40.0)
    meshes = {
        "scene.road-1": box_mesh((-9.0, -9.0, -0.1), (9.0, 9.0, 0.0), "ground"),
        "scene.wall-1": box_mesh((-9.0, 5.0, 0.0), (9.0, 5.2, 4.0), "ground"),
        "scene.building-1": box_mesh((-2.0, 0.0, 0.0), (2.0, 0.02, 2.0), "pane"),
        "scene.car-1": box_mesh((-0.6, -0.3, 0.0), (0.0, 0.3, 1.5), "ground"),
        "scene.car-2": box_mesh((0.1, -0.3, 0.0), (0.9, -0.28, 1.5), "pane"),
    }
    move = np.eye(4)
    move[1, 3] = y
    nodes = {
        path: Node(path, move if "car" in path else np.eye(4), (mesh,), label_id=26, movable="car" in path)
        for path, mesh in meshes.items()
    }
    materials = {
        "ground": Material("ground", (0.5, 0.45, 0.4)),
        "pane": Material("pane", (0.02, 0.02, 0.02), roughness=0.1, transmission=0.5),
    }
    scene = Scene(nodes, materials, {}, {"camera-1": camera}, Sun(0.6, math.radians(50.0)))
    view = View("camera-1", 160, 96)
    layer = raster.layer(scene, view)
    assert not layer.rectangle.empty
    assert_same(layer.over(raster.background(scene, view)), raster.full(scene, view))
