"""Shadow maps: their views, and the depth ranges and sky visibility derived from them."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import blocked, triangles_of
from valerie.rendering.base import View
from valerie.rendering.projection import LightView
from valerie.rendering.raster.light.shadows import (
    LARGEST_PENUMBRA,
    ShadowMap,
    Shadows,
    even_directions,
    nearest_directions,
    static_view,
)
from valerie.rendering.raster.upload.context import process_context
from valerie.rendering.raster.upload.drawing import table_texture
from valerie.rendering.raster.upload.static_geometry import StaticGeometry
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform
from valerie.testing.assets import simple_asset

SUN = np.array([0.3, 0.5, 0.8]) / math.sqrt(0.98)


def street(length: float) -> StaticGeometry:
    low, high = np.array([-10.0, 0.0, 0.0]), np.array([10.0, length, 12.0])
    return cast("StaticGeometry", SimpleNamespace(low=low, high=high, core_low=low, core_high=high))


def along_the_street(x: float, focal: float) -> Camera:
    return Camera("scene.camera", camera_transform((x, 1.0, 5.0), 0, 0, 0), focal_length_mm=focal)


def test_cameras_that_see_all_of_a_street_share_its_shadow_map() -> None:
    views = [
        static_view(street(100.0), along_the_street(x, 24.0), View("camera", 1920, 1080), SUN) for x in (-4.0, 0.0, 5.0)
    ]
    assert len({view.key for view in views}) == 1


def test_a_camera_that_sees_a_small_part_has_a_finer_map_of_its_own() -> None:
    geometry, view = street(1000.0), View("camera", 1920, 1080)
    near = static_view(geometry, along_the_street(0.0, 24.0), view, SUN)
    shared = static_view(geometry, away(), view, SUN)
    # A ratio below this would not be worth a map, see `static_view`.
    assert near.extent[:2].max() < shared.extent[:2].max() / 1.5


def away() -> Camera:
    """Return a camera that sees nothing of the street."""
    return Camera("scene.camera", camera_transform((0.0, -50.0, 5.0), 180, 0, 0), focal_length_mm=24.0)


@pytest.mark.gl
def test_the_sky_is_open_to_the_places_of_a_street_from_which_rays_reach_it() -> None:
    scene, context = simple_asset().base, process_context()
    scene = replace(scene, nodes={path: node for path, node in scene.nodes.items() if not node.movable})
    with context.current() as gl:
        prepared = context.scenes.prepare(scene)
        table, statics = table_texture(gl, prepared.table()), prepared.statics
        shadows = Shadows(context)
        maps = shadows.sky(statics, table)
        shadows.release()
        maps.release()
        table.release()
    sample = statics.geometry.sample
    triangles, places = triangles_of(scene), sample.points + 0.12 * sample.normals
    # Texels are at most 15 cm wide, so the map is off by 11 cm across the light: more along a surface that is tilted from it.
    # Places around which rays see the same are not at the edge of a shadow.
    cosine = np.abs(sample.normals @ maps.directions.T)
    across = np.cross(sample.normals, np.where(np.abs(sample.normals[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    along = np.cross(sample.normals, across)
    around = [0 * along, *(math.cos(turn) * across + math.sin(turn) * along for turn in np.arange(8) * math.pi / 4)]
    # Things that are thinner than a texel, such as the car's door, may stand between the centres of two.
    thick = triangles_of(replace(scene, nodes={path: node for path, node in scene.nodes.items() if "door" not in path}))
    expected = np.array(
        [
            [
                ~blocked(shapes, places + step * 0.11 / np.maximum(cosine[:, k : k + 1], 1 / 30), direction)
                for k, direction in enumerate(maps.directions)
            ]
            for shapes in (triangles, thick)
            for step in around
        ]
    ).transpose(0, 2, 1)
    # Slopes above 30 are clamped: such directions graze the surface. No place lies inside the ground.
    sure = (expected == expected[0]).all(axis=0) & (cosine > 1 / 30) & (places[:, 2] > 0)[:, None]
    assert min(expected[0][sure].sum(), (~expected[0][sure]).sum()) >= enough_to_show(0.001)
    # The edges may leave out a fifth of all directions, a requirement of ours.
    assert sure[places[:, 2] > 0].mean() > 0.8
    np.testing.assert_array_equal(maps.openness[sure], expected[0][sure])


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.01, 1))
def test_a_direction_is_shared_by_those_around_it(x: float, y: float, z: float) -> None:
    ray = np.array([x, y, z]) / math.sqrt(x * x + y * y + z * z)
    nearest, shares = nearest_directions(32)
    p = ray[:2] / np.abs(ray).sum()
    side = nearest.shape[0]
    column, row = (min(int((0.5 + 0.5 * at) * side), side - 1) for at in (p[0] + p[1], p[0] - p[1]))
    which, share = nearest[row, column], shares[row, column] / 255.0
    # Four shares of 8 bits, each rounded by half a step.
    assert share.sum() == pytest.approx(1.0, abs=2 / 255)
    # A texel's corner is at most √2/128 · √3 = 0.019 rad from its centre, in which the nearest direction is exact. A cosine
    # changes by that times the sine of its angle, which is at most 30°.
    cosines = even_directions(32) @ ray
    assert cosines.max() > math.cos(math.radians(30))
    assert cosines[which[0]] > cosines.max() - 2 * math.sqrt(6) / 128 * math.sin(math.radians(30))
    assert (np.diff(share) <= 0).all()
    # Eight of 32 directions fill a cap of 41°, of which a ray on the horizon has half. The nearest is up to 30° away.
    assert (cosines[which] > math.cos(math.radians(41 + 30))).all()


@pytest.mark.gl
def test_the_survey_of_a_map_bounds_all_depths_within_a_penumbra_of_each_texel() -> None:
    # Texels of 3 and of 10 cm.
    side, extent = 128, np.array([3.84, 12.8, 50.0])
    depths = np.ones((side, side), np.float32)
    context = process_context()
    with context.current() as gl:
        shadow = ShadowMap(gl, LightView(np.eye(3), np.zeros(3), extent), side)
        shadow.target.use()
        shadow.target.clear()
        for x, y, width, height, depth in ((10, 20, 5, 3, 0.25), (50, 60, 60, 60, 0.5), (127, 0, 1, 128, 0.75)):
            shadow.target.use((x, y, width, height))
            shadow.target.clear(depth)
            depths[y : y + height, x : x + width] = depth
        shadow.survey()
        assert shadow.casters is not None
        ranges = np.frombuffer(shadow.casters.read(), np.float32).reshape(*shadow.casters.size[::-1], 2)
        shadow.release()
    across, up = np.ceil(LARGEST_PENUMBRA / extent[:2] * side).astype(int)
    around, farther = (np.ones((2 * (up + more) + 1, 2 * (across + more) + 1), np.uint8) for more in (0, 16))
    per_texel = np.kron(ranges.transpose(2, 0, 1), np.ones((1, 8, 8), np.float32))
    assert (per_texel[0] <= cv2.erode(depths, around) + 1e-6).all()
    assert (per_texel[1] >= cv2.dilate(depths, around) - 1e-6).all()
    # The bounds are those of blocks of 8 texels, and of blocks around them.
    assert (per_texel[0] >= cv2.erode(depths, farther) - 1e-6).all()
    assert (per_texel[1] <= cv2.dilate(depths, farther) + 1e-6).all()
