import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from valerie.rendering.base import View
from valerie.rendering.projection import (
    box_corners,
    clip_from_view,
    clip_hull,
    drawing_matrices,
    fit_light_view,
    light_axes,
    project,
    seen_points,
    touches_clip_volume,
    turned_to_fit,
    view_from_world,
)
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform

CAMERA = Camera("scene.camera-1", camera_transform((1.0, -3.0, 1.5), 20.0, -5.0, 3.0), focal_length_mm=50.0)
#: A few operations in double precision on numbers below 1,000.
ROUNDING = 1e-9
POINTS = np.random.default_rng(0).uniform((-5, 5, 0), (5, 40, 8), (50, 3))


def to_pixels(matrix: np.ndarray, width: int, height: int) -> np.ndarray:
    clip = np.hstack([POINTS, np.ones((len(POINTS), 1))]) @ matrix.T
    ndc = clip[:, :2] / clip[:, 3:]
    return np.stack([(ndc[:, 0] + 1) / 2 * width, (1 - ndc[:, 1]) / 2 * height], axis=1)


def test_projected_pixels_are_those_of_the_clip_matrix() -> None:
    matrix = clip_from_view(CAMERA, 960, 540) @ view_from_world(CAMERA)
    np.testing.assert_allclose(project(POINTS, CAMERA, 960, 540)[:, :2], to_pixels(matrix, 960, 540))


def test_a_padded_canvas_shifts_pixels_by_the_padding() -> None:
    plain = clip_from_view(CAMERA, 960, 540) @ view_from_world(CAMERA)
    padded = clip_from_view(CAMERA, 960, 540, 480, 270) @ view_from_world(CAMERA)
    np.testing.assert_allclose(to_pixels(padded, 1920, 1080), to_pixels(plain, 960, 540) + np.array([480, 270]))


def test_focal_length_and_sensor_set_the_scale() -> None:
    camera = Camera("scene.camera-1", camera_transform((0, 0, 0), 0, 0, 0), focal_length_mm=50.0, sensor_width_mm=36.0)
    # The camera looks along +y. A point 0.36 m to the right at 1 m is half an image width (18 mm / 50 mm) off the centre.
    (pixel,) = project(np.array([[0.36, 1.0, 0.0]]), camera, 1000, 500)
    np.testing.assert_allclose(pixel, (1000.0, 250.0, 1.0), atol=1e-9)


@given(normal=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1), offset=st.floats(-1.5, 1.5))
def test_a_clipped_hull_has_the_volume_of_the_samples_that_it_keeps(
    normal: tuple[float, float, float], offset: float
) -> None:
    cube = box_corners(np.full(3, -1.0), np.full(3, 1.0))
    plane = np.array(normal) / np.linalg.norm(normal)
    cut = clip_hull(cube, plane, offset)
    samples = np.random.default_rng(1).uniform(-1, 1, (4000, 3))
    share = (samples @ plane >= offset).mean()
    assert (cut @ plane >= offset - ROUNDING).all()
    # Five standard deviations of a share of 4,000 samples are at most 5 · 0.5 / √4000 = 0.04.
    if share > 0.02:
        assert ConvexHull(cut).volume / 8 == pytest.approx(share, abs=0.04)


def test_a_hull_on_the_other_side_vanishes() -> None:
    assert clip_hull(box_corners(np.zeros(3), np.ones(3)), np.array([1.0, 0, 0]), 2.0).shape == (0, 3)


@pytest.mark.parametrize("direction", [(0, 0, 1), (1, 0, 0.05), (0, 1, 0.3), (-0.3, -0.8, 0.5)])
def test_light_axes_are_orthonormal_right_handed_and_point_away(direction: tuple[float, float, float]) -> None:
    toward = np.array(direction, float) / np.linalg.norm(direction)
    rows = light_axes(toward)
    np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rows[2], -toward)
    assert np.linalg.det(rows) == pytest.approx(1.0)


def test_turning_finds_the_narrow_side_of_a_diagonal_street() -> None:
    along = np.array(
        [[t, t, 0.0] for t in np.linspace(0, 50, 20)] + [[t + 1, t - 1, 0.0] for t in np.linspace(0, 50, 20)]
    )
    rows = turned_to_fit(light_axes(np.array([0.0, 0, 1])), along)
    # Its sides are √2 apart, and its 45° are a multiple of the 3° that are tried.
    assert np.ptp(along @ rows[:2].T, axis=0).min() == pytest.approx(math.sqrt(2))
    np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-12)


def test_a_light_view_holds_receivers_across_and_casters_in_depth() -> None:
    toward = np.array([0.3, -0.5, 0.8])
    casters = POINTS + toward * 30
    light = fit_light_view(light_axes(toward), POINTS, casters, 1024, 0.5)
    for points, axes in ((POINTS, 3), (casters, 0)):
        clip = np.hstack([points, np.ones((len(points), 1))]) @ light.clip_from_world.T
        assert (np.abs(clip[:, :axes]) <= 1).all()
        assert (np.abs(clip[:, 2]) <= 1).all()


def test_seen_points_lie_in_the_box_and_in_the_image() -> None:
    view = View("camera-1", 640, 360)
    low, high = np.array([-8.0, 0.0, 0.0]), np.array([8.0, 60.0, 20.0])
    points = seen_points(CAMERA, view, low, high, 40.0)
    assert (points >= low - ROUNDING).all()
    assert (points <= high + ROUNDING).all()
    pixels = project(points, CAMERA, 640, 360)
    assert (pixels[:, :2] >= -ROUNDING).all()
    assert (pixels[:, :2] <= np.array([640, 360]) + ROUNDING).all()
    assert (pixels[:, 2] <= 40 + ROUNDING).all()


def test_a_box_behind_the_camera_has_no_visible_points() -> None:
    assert not len(seen_points(CAMERA, View("c", 64, 36), np.array([-1.0, -30, 0]), np.array([1.0, -20, 2]), 100.0))


def test_a_box_with_a_point_in_the_image_touches_the_clip_volume() -> None:
    random = np.random.default_rng(3)
    middles, halves = random.uniform(-60, 60, (400, 3)), random.uniform(0.01, 20, (400, 3))
    boxes = np.array([box_corners(m - h, m + h) for m, h in zip(middles, halves, strict=True)])
    touches = touches_clip_volume(boxes, drawing_matrices(CAMERA, View("c", 640, 360))["clip_from_world"])
    inside = middles[:, None] + random.uniform(-1, 1, (400, 300, 3)) * halves[:, None]
    pixels = project(inside.reshape(-1, 3), CAMERA, 640, 360).reshape(400, 300, 3)
    shown = (pixels >= (0, 0, CAMERA.near)) & (pixels <= (640, 360, CAMERA.far))
    assert touches[shown.all(axis=2).any(axis=1)].all()
    assert 0 < touches.mean() < 0.7


def test_boxes_behind_and_beside_the_camera_do_not_touch_the_clip_volume() -> None:
    away = np.array([[0.0, -20, 0], [-60, 10, 0], [60, 10, 0], [0, 10, 40], [0, 10, -40]])
    boxes = np.array([box_corners(place - 1, place + 1) for place in CAMERA.position + away])
    assert not touches_clip_volume(boxes, drawing_matrices(CAMERA, View("c", 640, 360))["clip_from_world"]).any()
