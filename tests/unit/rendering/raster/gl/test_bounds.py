import numpy as np
import pytest

from valerie.rendering.base import View
from valerie.rendering.projection import box_corners, project
from valerie.rendering.raster.gl.bounds import Reach, changed_rectangle, covered_rectangle, grown
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform

CAMERA = Camera("scene.camera-1", camera_transform((0, 0, 1), 0, 0, 0), focal_length_mm=36.0)
VIEW = View("camera-1", 200, 100)
#: Focal length 200 pixels; no filters, so that numbers are those of the pin-hole alone.
SHARP = Reach(occlusion_radius=0.0, largest_occlusion=0.0, penumbra=0.0, filters=0)
NO_SUN = np.array([0.0, 0.8, -0.6])


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    return box_corners(np.array(low), np.array(high))


def test_a_box_in_front_covers_its_projection() -> None:
    rectangle = covered_rectangle([box((-1, 10, 0.5), (1, 12, 1.5))], CAMERA, VIEW)
    # ±1 m at 10 m is ±20 pixels, ±0.5 m is ±10; one pixel more on each side.
    assert (rectangle.x, rectangle.y, rectangle.width, rectangle.height) == (79, 39, 42, 22)


def test_a_padded_canvas_shifts_it() -> None:
    rectangle = covered_rectangle([box((-1, 10, 0.5), (1, 12, 1.5))], CAMERA, VIEW, 100, 50)
    assert (rectangle.x, rectangle.y, rectangle.width, rectangle.height) == (179, 89, 42, 22)


def test_a_box_behind_or_beside_the_camera_covers_nothing() -> None:
    assert covered_rectangle([box((-1, -12, 0), (1, -10, 2))], CAMERA, VIEW).empty
    assert covered_rectangle([box((30, 10, 0), (31, 11, 2))], CAMERA, VIEW).empty
    assert covered_rectangle([], CAMERA, VIEW).empty


def test_a_box_around_the_camera_covers_the_whole_frame() -> None:
    rectangle = covered_rectangle([box((-1, -1, 0), (1, 1, 2))], CAMERA, VIEW)
    assert (rectangle.width, rectangle.height) == (200, 100)


def test_without_a_sun_only_the_body_counts() -> None:
    corners = box((-1, 10, 0.5), (1, 12, 1.5))
    changed = changed_rectangle([corners], CAMERA, VIEW, NO_SUN, 0.0, SHARP)
    # Both are a pixel wider than the body on each side.
    assert changed == covered_rectangle([corners], CAMERA, VIEW)


def test_a_shadow_to_the_left_widens_the_rectangle_to_its_tip() -> None:
    toward_sun = np.array([1.0, 0.0, 0.5]) / np.hypot(1.0, 0.5)
    rectangle = changed_rectangle([box((1, 10, 0), (1.5, 10.5, 1))], CAMERA, VIEW, toward_sun, 0.0, SHARP)
    # The top, 1 m high, falls 2 m to the left on the ground: from x = 1 to x = −1 at 10 m, pixel 80. The body ends at x = 1.5,
    # pixel 130, with one pixel more. Rounding may add a pixel to each.
    assert rectangle.x in {79, 80}
    assert rectangle.x + rectangle.width in {131, 132}


def test_a_body_out_of_view_still_has_its_shadow_in_view() -> None:
    toward_sun = np.array([1.0, 0.0, 0.2]) / np.hypot(1.0, 0.2)
    rectangle = changed_rectangle([box((6, 10, 0), (6.5, 10.5, 1.8))], CAMERA, VIEW, toward_sun, 0.0, SHARP)
    assert not rectangle.empty
    assert rectangle.x + rectangle.width == 200


def test_the_rectangle_holds_the_mirror_images_in_wet_ground_of_any_height() -> None:
    low, high, rng = np.array([1.0, 10.0, 0.2]), np.array([1.5, 10.5, 1.9]), np.random.default_rng(2)
    rectangle = changed_rectangle([box_corners(low, high)], CAMERA, VIEW, NO_SUN, -0.1, SHARP, wet=True)
    points = rng.uniform(low, high, (500, 3))
    mirrors = rng.uniform(-0.1, points[:, 2])
    images = points * (1, 1, -1) + np.outer(2 * mirrors, (0, 0, 1))
    x, y, _ = project(images, CAMERA, VIEW.width, VIEW.height).T
    assert ((rectangle.x <= x) & (x <= rectangle.x + rectangle.width)).all()
    assert ((rectangle.y <= y) & (np.minimum(y, VIEW.height) <= rectangle.y + rectangle.height)).all()
    dry = changed_rectangle([box_corners(low, high)], CAMERA, VIEW, NO_SUN, -0.1, SHARP)
    assert dry.height < rectangle.height


@pytest.mark.parametrize("depth", [0.2, 0.9, 5.0])
def test_occlusion_widens_more_the_nearer_it_is(depth: float) -> None:
    reach = Reach(occlusion_radius=0.5, largest_occlusion=48.0, penumbra=0.0, filters=0)
    expected = 49 if depth < 0.5 else min(48, int(np.ceil(0.5 * 200 / (depth - 0.5)))) + 1
    assert reach.occlusion_pixels(depth, 200.0) == expected


def test_growing_stops_at_the_border() -> None:
    rectangle = grown(covered_rectangle([box((-1, 10, 0.5), (1, 12, 1.5))], CAMERA, VIEW), 45, VIEW)
    assert (rectangle.x, rectangle.y, rectangle.width, rectangle.height) == (34, 0, 132, 100)
