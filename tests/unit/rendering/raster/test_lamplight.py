"""Lamplight in the raster engine against inverse squares, rays and the frame from scratch."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scene_rays import blocked, near_edges, pixel_rays, trace, triangles_of

from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.lamps import lit_lamps
from valerie.rendering.raster.lamp_reach import LampView, shadow_hull
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.sky import LUX, sky_of
from valerie.scene.model import Camera, Light, Material, Node, Scene, Sun
from valerie.scene.transforms import Pose, camera_transform
from valerie.scene.variation import apply
from valerie.testing.assets import box_mesh, simple_asset
from valerie.testing.rendering import assert_same

pytestmark = pytest.mark.gl

NIGHT = math.radians(-18.0)
STREET = Light(intensity=1500.0, inner=0.5, outer=1.25, switch="street")


def hung(path: str, light: Light, place: tuple[float, float, float], *, movable: bool = False) -> Node:
    """A lamp that looks down."""
    return Node(path, Pose(place, (270.0, 0.0, 0.0)).matrix(), light=light, movable=movable, label_id=17)


def at_night(values: dict[str, object], *lamps: Node, elevation: float = NIGHT) -> Scene:
    scene = apply(values, simple_asset())  # type: ignore[arg-type]
    nodes = dict(scene.nodes) | {lamp.path: lamp for lamp in lamps}
    return replace(scene, nodes=nodes, sun=replace(scene.sun, elevation=elevation))


LAMPS = (hung("scene.pole-1", STREET, (-3, 4, 6)), hung("scene.pole-2", STREET, (4.5, 12, 6)))


def floor_below(light: Light, height: float) -> Scene:
    """A matt grey floor with one lamp above the middle of the image, at night."""
    camera = Camera("scene.camera-1", camera_transform((0, 0, 8), 0, -90, 0), focal_length_mm=36.0)
    floor = Node("scene.road-1", np.eye(4), (box_mesh((-30, -30, -1), (30, 30, 0), "floor"),), label_id=7)
    lamp = hung("scene.pole-1", light, (0, 0, height))
    material = Material("floor", (0.5, 0.5, 0.5), roughness=1.0, specular=0.0)
    return Scene({floor.path: floor, lamp.path: lamp}, {"floor": material}, {}, {"camera-1": camera}, Sun(0.0, NIGHT))


@pytest.mark.parametrize("height", [2.0, 4.0])
def test_light_falls_with_the_square_of_the_distance_and_the_cosine(raster: RasterRenderer, height: float) -> None:
    scene = floor_below(Light(intensity=1000.0, inner=1.2, outer=1.3), height)
    view = View("camera-1", 80, 80)
    row = raster.full(scene, view).pixels[40, 40:, 1].astype(np.float64)
    x = (np.arange(40) + 0.5) / 80 * 8.0  # metres beside the lamp: 36 mm on 36 mm, from 8 m
    squared = x**2 + height**2
    expected = 0.5 * 1000.0 * LUX * (height / np.sqrt(squared)) / squared
    inside = np.arctan2(x, height) < 0.9
    np.testing.assert_allclose(row[inside], expected[inside], rtol=0.03)


def test_beyond_its_cone_a_lamp_gives_nothing(raster: RasterRenderer) -> None:
    scene, view = floor_below(Light(intensity=1000.0, inner=0.3, outer=0.5), 4.0), View("camera-1", 80, 80)
    row = raster.full(scene, view).pixels[40, 40:, 1].astype(np.float64)
    angle = np.arctan2((np.arange(40) + 0.5) / 80 * 8.0, 4.0)
    # What is left is the night sky, and what the street around gives back.
    assert row[angle > 0.55].max() < 0.02 * row[angle < 0.3].min()


def test_the_lamps_colour_is_that_of_what_it_lights(raster: RasterRenderer) -> None:
    scene = floor_below(Light(intensity=1000.0, inner=1.0, outer=1.3, color=(1.0, 0.5, 0.25)), 4.0)
    middle = raster.full(scene, View("camera-1", 32, 32)).pixels[16, 16].astype(np.float64)
    np.testing.assert_allclose(middle / middle[0], (1.0, 0.5, 0.25), rtol=0.03)


def test_lamps_throw_the_shadows_of_statics_and_movables(raster: RasterRenderer, truth_pass: TruthPass) -> None:
    wide = hung("scene.pole-1", replace(STREET, inner=1.1), (-3, 4, 6))
    scene, view = at_night({"scene.person-1.pos.y": 7.0}, wide), View("camera-1", 320, 180)
    plain = {name: replace(m, base_color_texture=None, specular=0.0) for name, m in scene.materials.items()}
    scene = replace(scene, materials=plain)
    image = raster.full(scene, view).pixels.astype(np.float64).sum(axis=2)
    triangles, camera = triangles_of(scene), scene.cameras["camera-1"]
    classes, _, depth = trace(triangles, camera, view)
    ground = (classes == 7) & (depth < 14)
    points = camera.position + pixel_rays(camera, view)[ground] * depth[ground][:, None]
    (lamp,) = lit_lamps(scene, sky_of(scene))
    way = np.array(lamp.position) - points
    distance = np.linalg.norm(way, axis=1)
    # Nothing stands behind the lamp as seen from there.
    hidden = blocked(triangles, points + np.array([0, 0, 0.01]), way / distance[:, None])
    in_cone = way[:, 2] / distance > math.cos(1.0)
    state = np.zeros(classes.shape, np.uint8)
    state[ground] = np.where(in_cone, 1 + hidden, 0)
    image[ground] /= way[:, 2] / distance**3  # what a lamp without shadows gives
    inside = ~near_edges(near_edges(state).astype(np.uint8))
    dark, lit = image[inside & (state == 2)], image[inside & (state == 1)]
    assert len(dark) > 100
    assert np.median(lit) > 5 * np.median(dark)
    threshold = 0.25 * np.median(lit)
    assert (dark > threshold).mean() < 0.03
    assert (lit < threshold).mean() < 0.03


@given(
    x=st.floats(-6, 6),
    y=st.floats(1, 30),
    heading=st.floats(0, 359),
    second=st.sampled_from(["absent", "red-coat"]),
    elevation=st.sampled_from([-18.0, -3.0, 1.5]),
    torch=st.booleans(),
)
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_layer_over_the_background_is_the_frame_bit_for_bit_under_lamps(
    raster: RasterRenderer, x: float, y: float, heading: float, second: str, elevation: float, torch: bool
) -> None:
    values = {
        "scene.person-1.pos.x": x,
        "scene.person-1.pos.y": y,
        "scene.person-1.heading": heading,
        "scene.person-2.character": second,
        "scene.sun-1.azimuth": 10.0 * heading % 360,
    }
    light = Light(intensity=400.0, inner=0.1, outer=0.6)
    carried = Node("scene.person-1.torch", Pose((0, 0.5, 1.2), (0, 0, 0)).matrix(), light=light, movable=True)
    scene = at_night(values, *LAMPS, *((carried,) if torch else ()), elevation=math.radians(elevation))
    view = View("camera-1", 168, 96)
    layer = raster.layer(scene, view)
    assert_same(layer.over(raster.background(scene, view)), raster.full(scene, view))


def test_a_layer_by_night_is_no_whole_frame_and_the_background_has_no_light_of_movables(
    raster: RasterRenderer,
) -> None:
    view = View("camera-1", 320, 180)
    light = Light(intensity=400.0, inner=0.1, outer=0.6)
    carried = Node("scene.person-1.torch", Pose((0, 0.5, 1.2), (0, 0, 0)).matrix(), light=light, movable=True)
    without, with_torch = at_night({}, *LAMPS), at_night({}, *LAMPS, carried)
    rectangle = raster.layer(without, view).rectangle
    assert 0 < rectangle.width * rectangle.height < 0.3 * 320 * 180
    assert_same(raster.background(without, view), raster.background(with_torch, view))


def test_by_day_lamps_that_wait_for_the_dark_change_no_bit(raster: RasterRenderer) -> None:
    view = View("camera-1", 96, 54)
    bare, hanging = at_night({}, elevation=0.7), at_night({}, *LAMPS, elevation=0.7)
    assert_same(raster.full(bare, view), raster.full(hanging, view))


def test_lamps_never_change_the_truth(truth_pass: TruthPass) -> None:
    view = View("camera-1", 96, 54)
    first, second = truth_pass.truth(at_night({}), view), truth_pass.truth(at_night({}, *LAMPS), view)
    for name in ("class_map", "instance_map", "depth"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_a_box_out_of_reach_throws_no_shadow_and_one_at_the_lamp_any() -> None:
    (lamp,) = lit_lamps(scene := at_night({}, LAMPS[0]), sky_of(scene))
    view = LampView.of(lamp)
    box = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.0, 1.8)])
    assert len(shadow_hull(box + np.array([0, 500, 0]), view, 0.0)) == 0
    assert shadow_hull(box + np.array([-3, 4, 5]), view, 0.0) is None
    hull = shadow_hull(box + np.array([0, 4, 0]), view, 0.0)
    # The lamp at (−3, 4, 6): from the top of the box, 1.8 m high at x = 0.3, the shadow ends at x = 0.3 + 3.3 · 1.8 / 4.2.
    assert hull[:, 0].max() > 0.3 + 3.3 * 1.8 / 4.2
    assert hull[:, 0].max() < 0.3 + 3.3 * 1.8 / 4.2 + 1.0
