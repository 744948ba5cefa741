import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.sampling import enough_to_show
from valerie.sensing.distortion import distort, fold_radius, pixel_map, shown_within, undistort
from valerie.sensing.settings import Distortion

WIDTH, HEIGHT, FOCAL = 160, 90, 222.0
CASES = [
    Distortion(k1=-0.3, k2=0.1, p1=0.01, p2=-0.005, k3=0.02),
    Distortion(k1=0.4),
    Distortion(k1=-0.9),
    Distortion(p1=0.03, p2=0.02),
    Distortion(k2=-0.5, k3=0.3),
]
coefficients = st.builds(
    Distortion,
    k1=st.floats(-1, 1), k2=st.floats(-1, 1), k3=st.floats(-1, 1), p1=st.floats(-0.02, 0.02), p2=st.floats(-0.02, 0.02),
)  # fmt: skip


def opencv(d: Distortion) -> np.ndarray:
    return np.array([d.k1, d.k2, d.p1, d.p2, d.k3])


def camera(focal: float) -> np.ndarray:
    return np.array([[focal, 0, (WIDTH - 1) / 2], [0, focal, (HEIGHT - 1) / 2], [0, 0, 1]])


@pytest.mark.parametrize("d", CASES)
def test_the_map_is_that_of_opencv(d: Distortion) -> None:
    source = pixel_map(d, WIDTH, HEIGHT, FOCAL)
    places = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).reshape(-1, 1, 2).astype(np.float64)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-10)
    expected = cv2.undistortPoints(
        places, camera(FOCAL * source.zoom), opencv(d), R=None, P=camera(FOCAL), criteria=criteria
    ).reshape(HEIGHT, WIDTH, 2)
    np.testing.assert_allclose(source.x, expected[..., 0], atol=1e-3)
    np.testing.assert_allclose(source.y, expected[..., 1], atol=1e-3)


@pytest.mark.parametrize("d", CASES)
def test_opencv_undistorts_the_distorted_image_back_to_the_pinhole_image(d: Distortion) -> None:
    source = pixel_map(d, WIDTH, HEIGHT, FOCAL)
    back_x, back_y = cv2.initUndistortRectifyMap(
        camera(FOCAL * source.zoom), opencv(d), None, camera(FOCAL), (WIDTH, HEIGHT), cv2.CV_32FC1
    )
    # The source of a distorted pixel, read at the place to which OpenCV maps a pinhole pixel.
    again_x = cv2.remap(source.x.astype(np.float32), back_x, back_y, cv2.INTER_LINEAR, borderValue=np.nan)
    again_y = cv2.remap(source.y.astype(np.float32), back_x, back_y, cv2.INTER_LINEAR, borderValue=np.nan)
    inside = (back_x > 1) & (back_x < WIDTH - 2) & (back_y > 1) & (back_y < HEIGHT - 2)
    assert inside.sum() >= enough_to_show(0.001)
    rows, columns = np.nonzero(inside)
    # Between samples of a smooth map, linear interpolation is off by up to an eighth of the second difference along each axis.
    bend = max(float(np.abs(np.diff(at, 2, axis)).max()) for at in (source.x, source.y) for axis in (0, 1))
    np.testing.assert_allclose(again_x[inside], columns, atol=bend / 4 + 1e-3)
    np.testing.assert_allclose(again_y[inside], rows, atol=bend / 4 + 1e-3)


# The radial part of this lens nearly folds, and the rest folds it.
@example(Distortion(k1=-0.8125, p2=0.015625, k3=0.3125), 40.0)
@given(coefficients, st.floats(40.0, 2000.0))
def test_every_pixel_of_the_distorted_image_was_rendered(d: Distortion, focal: float) -> None:
    source = pixel_map(d, WIDTH, HEIGHT, focal)
    assert source.zoom >= 1.0
    # Between two samples of the border a corner may be pulled beyond the outermost pixels' centres, but not beyond their edges.
    assert source.x.min() > -0.5
    assert source.x.max() < WIDTH - 0.5
    assert source.y.min() > -0.5
    assert source.y.max() < HEIGHT - 0.5


@given(coefficients, st.integers(0, 2**32 - 1))
def test_no_two_rays_within_the_fold_radius_meet(d: Distortion, seed: int) -> None:
    rng = np.random.default_rng(seed)
    radii = 0.999 * min(fold_radius(d), 5.0) * np.sqrt(rng.uniform(size=(2, 256)))
    angles = rng.uniform(0, 2 * np.pi, (2, 256))
    (u, w), (v, z) = radii * np.cos(angles), radii * np.sin(angles)
    (lens_u, lens_w), (lens_v, lens_z) = distort(d, np.array([u, w]), np.array([v, z]))
    # The gradient of a strictly convex function is monotone.
    assert np.all((lens_u - lens_w) * (u - w) + (lens_v - lens_z) * (v - z) > 0)


@given(coefficients)
def test_undistorting_is_the_inverse_of_distorting(d: Distortion) -> None:
    reach = min(0.8 * fold_radius(d), 0.5)
    angles, radii = np.linspace(0.0, 6.0, 24), np.linspace(0.0, reach, 16)[:, None]
    x, y = radii * np.cos(angles), radii * np.sin(angles)
    again_x, again_y = undistort(d, *distort(d, x, y))
    np.testing.assert_allclose(again_x, x, atol=1e-9)
    np.testing.assert_allclose(again_y, y, atol=1e-9)


def test_without_coefficients_every_pixel_stays() -> None:
    source = pixel_map(Distortion(), WIDTH, HEIGHT, FOCAL)
    assert source.zoom == 1.0
    np.testing.assert_array_equal(source.nearest(), np.arange(WIDTH * HEIGHT).reshape(HEIGHT, WIDTH))


def test_barrel_distortion_moves_pixels_inwards_and_pincushion_outwards() -> None:
    barrel, pincushion = (
        pixel_map(Distortion(k1=-0.3), WIDTH, HEIGHT, FOCAL),
        pixel_map(Distortion(k1=0.3), WIDTH, HEIGHT, FOCAL),
    )
    assert barrel.zoom > 1.0
    assert pincushion.zoom == 1.0
    # Near the centre, a barrel only has the enlargement; farther out, it shrinks.
    middle, edge = np.diff(barrel.x[HEIGHT // 2])[[WIDTH // 2, 0]]
    assert middle < edge
    middle, edge = np.diff(pincushion.x[HEIGHT // 2])[[WIDTH // 2, 0]]
    assert middle > edge


@pytest.mark.parametrize("d", CASES)
def test_shown_pixels_are_those_that_the_map_reads(d: Distortion) -> None:
    source = pixel_map(d, WIDTH, HEIGHT, FOCAL)
    within = shown_within(d, WIDTH, HEIGHT, FOCAL, source.zoom)
    read = np.zeros(WIDTH * HEIGHT, np.bool_)
    read[source.nearest().ravel()] = True
    read = read.reshape(HEIGHT, WIDTH)

    def grown(mask: np.ndarray) -> np.ndarray:
        return cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0

    # At the border, a place may read a pixel half a pixel away. Where the image shrinks, pixels may be skipped.
    assert not (read & ~grown(within)).any()
    assert not (within & ~grown(read)).any()


def test_a_lens_folds_where_the_distorted_radius_begins_to_decrease() -> None:
    assert fold_radius(Distortion(k1=-0.3)) == pytest.approx(np.sqrt(1 / 0.9))
    assert fold_radius(Distortion(k1=0.3)) == np.inf
