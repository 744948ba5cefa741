"""Lamplight in the raster engine against the inverse square law, rays and frames rendered from scratch."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tests.unit.rendering.scene_rays import FOOTPRINT, Triangles, dark_and_lit, footprints, trace, triangles_of
from valerie.rendering.base import View, bounds
from valerie.rendering.beams import DIPPED
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.lamps import lit_lamps
from valerie.rendering.projection import project
from valerie.rendering.raster.gl.tiles import widened
from valerie.rendering.raster.light.lamp_reach import (
    FILTER_TEXELS,
    MOVING_TILES,
    LampView,
    moving_with_shadows,
    shadow_hull,
)
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.sky import LUX, sky_of
from valerie.scene.graph.model import Camera, Light, Material, Node, Scene, Sun
from valerie.scene.graph.transforms import Pose, camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import box_mesh, simple_asset
from valerie.testing.rendering import assert_same

pytestmark = pytest.mark.gl

NIGHT = math.radians(-18.0)
#: Largest error of the light of a lamp, a requirement of ours: a fiftieth of a stop.
ALIKE = 2.0 ** (1 / 50) - 1
STREET = Light(intensity=1500.0, inner=0.5, outer=1.25, switch="street")


def hung(path: str, light: Light, place: tuple[float, float, float], *, movable: bool = False) -> Node:
    """Return a lamp that points down."""
    return Node(path, Pose(place, (270.0, 0.0, 0.0)).matrix(), light=light, movable=movable, label_id=17)


def at_night(values: dict[str, object], *lamps: Node, elevation: float = NIGHT) -> Scene:
    scene = apply(values, simple_asset())  # type: ignore[arg-type]
    nodes = dict(scene.nodes) | {lamp.path: lamp for lamp in lamps}
    return replace(scene, nodes=nodes, sun=replace(scene.sun, elevation=elevation))


LAMPS = (hung("scene.pole-1", STREET, (-3, 4, 6)), hung("scene.pole-2", STREET, (4.5, 12, 6)))


def floor_below(light: Light, height: float) -> Scene:
    """Return a matt grey floor with one lamp above the middle of the image, at night."""
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
    np.testing.assert_allclose(row[inside], expected[inside], rtol=ALIKE)


def test_beyond_its_cone_a_lamp_gives_nothing(raster: RasterRenderer) -> None:
    scene, view = floor_below(Light(intensity=1000.0, inner=0.3, outer=0.5), 4.0), View("camera-1", 80, 80)
    row = raster.full(scene, view).pixels[40, 40:, 1].astype(np.float64)
    angle = np.arctan2((np.arange(40) + 0.5) / 80 * 8.0, 4.0)
    # The rest is 0.05 lux of the night sky, a thousandth of the 1000 / 4² · cos⁴(0.3) = 52 lux at the edge of the second part.
    assert row[angle > 0.55].max() < 0.001 * row[angle < 0.3].min()


def test_a_lamp_gives_its_colour_to_the_ground(raster: RasterRenderer) -> None:
    scene = floor_below(Light(intensity=1000.0, inner=1.0, outer=1.3, color=(1.0, 0.5, 0.25)), 4.0)
    middle = raster.full(scene, View("camera-1", 32, 32)).pixels[16, 16].astype(np.float64)
    # Half floats round by a part in 2,048, in both colours of a ratio; the night sky adds less than a thousandth.
    np.testing.assert_allclose(middle / middle[0], (1.0, 0.5, 0.25), rtol=2 / 2048 + 0.001)


def test_a_dipped_beam_has_the_light_of_its_formula_and_is_dark_above_its_cut_off(raster: RasterRenderer) -> None:
    # The lamp points down, so the space above its cut-off is in the upper half of the image, towards the world's +y.
    light = Light(intensity=8000.0, inner=1.0, outer=1.2, beam="dipped")
    image = raster.full(floor_below(light, 6.0), View("camera-1", 120, 120)).pixels[..., 1].astype(np.float64)
    steps = (np.arange(120) + 0.5) / 120 * 8.0 - 4.0  # 36 mm on 36 mm, from 8 m
    x, y = np.meshgrid(steps, -steps)
    expected = 0.5 * 8000.0 * LUX * DIPPED.share(x / 6.0, y / 6.0) * 6.0 / np.sqrt(x**2 + y**2 + 36.0) ** 3
    # Pixels at the cut-off show both sides of it; night sky and reflections add less than a thousandth everywhere.
    clear = np.abs(y - DIPPED.rise * np.maximum(x, 0.0)) > 0.15
    np.testing.assert_allclose(image[clear], expected[clear], rtol=ALIKE, atol=0.001 * expected.max())


def moving(
    name: str, place: tuple[float, float, float], light: Light, heading: float = 0.0, pitch: float = 0.0
) -> Node:
    """Return a lamp on a movable."""
    return Node(f"scene.{name}", Pose(place, (pitch, 0.0, heading)).matrix(), light=light, movable=True)


WIDE = Light(intensity=12_000.0, inner=1.1, outer=1.2)
CASTING = {
    "a post": hung("scene.pole-1", replace(STREET, inner=1.1), (-3, 4, 6)),
    "a movable on the left": moving("car-2", (-2.5, 1.0, 1.0), WIDE, 345.0, 350.0),
    "the same movable elsewhere": moving("car-2", (3.6, 3.5, 0.8), WIDE, 30.0, 350.0),
}


@pytest.mark.parametrize("hung_on", CASTING)
def test_lamps_throw_the_shadows_of_statics_and_movables(raster: RasterRenderer, hung_on: str) -> None:
    scene, view = at_night({"scene.person-1.pos.y": 7.0}, CASTING[hung_on]), View("camera-1", 320, 180)
    # All surfaces are of one matt grey, and the night has no sky.
    albedo = 0.1
    grey = {name: Material(name, (albedo,) * 3, roughness=1.0, specular=0.0) for name in scene.materials}
    scene = replace(scene, materials=grey, environment=replace(scene.environment, sky_strength=0.0))
    triangles, camera, sky = triangles_of(scene), scene.cameras["camera-1"], sky_of(scene)
    (lamp,) = lit_lamps(scene, sky)
    surfaces = footprints(triangles, camera, view)
    way = surfaces.points[0] - np.array(lamp.position)
    distance, along = np.linalg.norm(way, axis=2), way @ np.array(lamp.direction)
    cosine = -(way * surfaces.normals).sum(axis=2) / distance
    surfaces = replace(surfaces, flat=surfaces.flat & (cosine > 0.3) & (along / distance > math.cos(1.0)))
    # What the map's offset and filter reach, on a surface that is tilted from the light.
    blur = (0.01 + FILTER_TEXELS * LampView.of(lamp).texel * along) / np.maximum(cosine, 0.3)
    dark, lit = dark_and_lit(surfaces, lambda points: hidden(triangles, lamp.position, points), blur)
    passed = np.exp(-sky.extinction[1] * np.linalg.norm(surfaces.points[0] - camera.position, axis=2))
    without_shadows = albedo * lamp.strength[1] * cosine / distance**2 * passed
    share = raster.full(scene, view).pixels[..., 1] / without_shadows
    assert share[dark].max() < ALIKE
    assert share[lit].min() > 1 - ALIKE


def hidden(triangles: Triangles, place: tuple[float, float, float], points: np.ndarray) -> np.ndarray:
    """Return (N,) bool, True if an object is between a place and a surface point."""
    way = points - np.array(place)
    distance = np.linalg.norm(way, axis=1)
    starts = np.broadcast_to(np.array(place), points.shape)
    hits, rays, _ = triangles.intersector.intersects_location(starts, way / distance[:, None], multiple_hits=False)
    nearest = np.full(len(points), np.inf)
    nearest[rays] = np.linalg.norm(hits - np.array(place), axis=1)
    return nearest < distance - 0.02


def test_the_housing_around_a_lamp_blocks_none_of_its_light(raster: RasterRenderer) -> None:
    view = View("camera-1", 96, 54)
    bare = at_night({}, moving("car-2", (-1.5, 2.0, 0.8), WIDE, pitch=350.0))
    lens = Node("scene.car-3", np.eye(4), (box_mesh((-1.6, 2.1, 0.7), (-1.4, 2.12, 0.9), "paint"),), 26, movable=True)
    housed = replace(bare, nodes={**bare.nodes, lens.path: lens})
    changed = np.not_equal(*(raster.full(scene, view).pixels for scene in (bare, housed))).any(axis=2)
    plate = trace(triangles_of(housed), housed.cameras["camera-1"], view)[0] == 26
    plate &= trace(triangles_of(bare), bare.cameras["camera-1"], view)[0] != 26
    assert changed.any()
    assert not (changed & ~widened(plate, math.ceil(FOOTPRINT))).any()


def test_the_strongest_lamps_of_movables_that_reach_the_image_have_shadow_maps() -> None:
    head, tail = Light(intensity=12_000.0, outer=0.6), Light(intensity=8.0, outer=1.3)
    behind = moving(
        "car-2", (0, -6, 0.6), replace(head, intensity=50_000.0), heading=180.0
    )  # shines away from what the camera sees
    bulb = moving("car-3", (0, 5, 1.0), Light(intensity=1000.0))  # shines in all directions: no map could hold it
    heads = [moving(f"car-{4 + i}", (i - 2.0, 8.0 + 6 * i, 0.6), head, heading=180.0) for i in range(MOVING_TILES)]
    tails = [moving(f"car-{20 + i}", (i - 2.0, 6.0, 0.6), tail) for i in range(2)]
    view = View("camera-1", 160, 90)

    def picked(*lamps: Node) -> list[tuple[float, ...]]:
        scene = at_night({}, *lamps)
        views = moving_with_shadows(lit_lamps(scene, sky_of(scene)), scene.cameras["camera-1"], view)
        return [lamp_view.lamp.position for lamp_view in views]

    places = {node.path: tuple(node.transform[:3, 3]) for node in (*heads, *tails)}
    assert picked(behind, bulb, *tails, *heads[::-1]) == [places[node.path] for node in heads]
    assert picked(behind, bulb, *tails, heads[3])[0] == places[heads[3].path]
    assert set(picked(behind, bulb, *tails)) == {places[node.path] for node in tails}
    assert picked(hung("scene.pole-1", STREET, (-3, 4, 6))) == []


HEAD = Light(intensity=12_000.0, inner=0.45, outer=0.7, beam="dipped")
CARRIED = {
    "nothing": (),
    "a torch": (moving("person-1.torch", (0, 0.5, 1.2), Light(intensity=400.0, inner=0.1, outer=0.6)),),
    "head lamps": (
        moving("person-1.lamp-1", (-0.6, 0.5, 0.65), HEAD),
        moving("person-1.lamp-2", (0.6, 0.5, 0.65), HEAD),
    ),
}


@example(x=-2.0, y=4.0, heading=340.0, second="red-coat", elevation=-18.0, carried="head lamps")
@given(
    x=st.floats(-6, 6),
    y=st.floats(1, 30),
    heading=st.floats(0, 359),
    second=st.sampled_from(["absent", "red-coat"]),
    elevation=st.sampled_from([-18.0, -3.0, 1.5]),
    carried=st.sampled_from(sorted(CARRIED)),
)
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_layer_over_the_background_is_the_frame_bit_for_bit_under_lamps(
    raster: RasterRenderer, x: float, y: float, heading: float, second: str, elevation: float, carried: str
) -> None:
    values = {
        "scene.person-1.pos.x": x,
        "scene.person-1.pos.y": y,
        "scene.person-1.heading": heading,
        "scene.person-2.character": second,
        "scene.sun-1.azimuth": 10.0 * heading % 360,
    }
    scene = at_night(values, *LAMPS, *CARRIED[carried], elevation=math.radians(elevation))
    view = View("camera-1", 168, 96)
    layer = raster.layer(scene, view)
    assert_same(layer.over(raster.background(scene, view)), raster.full(scene, view))


def test_a_moving_lamp_lights_the_street_even_if_nothing_else_moves(raster: RasterRenderer) -> None:
    absent = {f"scene.person-{i}.character": "absent" for i in (1, 2)}
    scene, view = at_night(absent, *LAMPS, moving("car-2", (-1.0, 2.0, 0.65), HEAD)), View("camera-1", 96, 54)
    background, full = raster.background(scene, view), raster.full(scene, view)
    added = full.pixels.astype(np.float64).sum(axis=2) - background.pixels.astype(np.float64).sum(axis=2)
    ((column, row, _),) = project(
        np.array([[-1.0, 8.0, 0.0]]), scene.cameras["camera-1"], 96, 54
    )  # 6 m ahead of the lamp
    assert added[int(row), int(column)] > 0
    assert (added >= 0).all()
    assert_same(raster.layer(scene, view).over(background), full)


def test_a_layer_at_night_is_as_large_as_its_changes_and_the_background_has_no_light_of_movables(
    raster: RasterRenderer,
) -> None:
    view = View("camera-1", 320, 180)
    without, with_torch = at_night({}, *LAMPS), at_night({}, *LAMPS, *CARRIED["a torch"])
    changed = (raster.full(without, view).pixels != raster.background(without, view).pixels).any(axis=2)
    assert 0 < changed.mean() < 1
    assert raster.layer(without, view).rectangle == bounds(changed)
    assert_same(raster.background(without, view), raster.background(with_torch, view))


def test_by_day_lamps_with_a_switch_change_no_bit(raster: RasterRenderer) -> None:
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
    # The lamp is at (−3, 4, 6). The shadow of the box's top, 1.8 m high at x = 0.3, ends at x = 0.3 + 3.3 · 1.8 / 4.2.
    assert hull[:, 0].max() > 0.3 + 3.3 * 1.8 / 4.2
    # Every side of the box, and the ground, move by 0.1 m and by the reach of the map's filter at the end of a sphere around
    # the box.
    distance = math.hypot(3.0, 0.0, 6.0 - 0.9) + math.hypot(0.3, 0.3, 0.9)
    margin = 0.1 + FILTER_TEXELS * view.texel * distance
    assert hull[:, 0].max() == pytest.approx(-3 + (3.3 + margin) * (6 + margin) / (4.2 - margin))
