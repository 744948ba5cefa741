import cv2
import numpy as np
import pytest

from valerie.sensing.defocus import circle_of_confusion, convolve, defocus, disc_kernel


def radius_at(depth: float, f_number: float = 2.0, focus: float = 10.0, focal: float = 50.0) -> float:
    radius = circle_of_confusion(
        np.array([depth], np.float32),
        focal_length_mm=focal, focal_px=focal / 36.0 * 960, f_number=f_number, focus_distance_m=focus,
    )  # fmt: skip
    return float(radius[0])


def traced(depth: float, f_number: float, focus: float, focal: float) -> float:
    """Return the radius in pixels by two thin lens equations, 1/f = 1/d + 1/v, and similar triangles."""
    image = 1.0 / (1.0 / focal - 1.0 / (1000.0 * depth))
    plane = 1.0 / (1.0 / focal - 1.0 / (1000.0 * focus))
    return 0.5 * focal / f_number * (plane - image) / image * (960 / 36.0)


@pytest.mark.parametrize("depth", [2.0, 5.0, 9.0, 20.0, 500.0])
@pytest.mark.parametrize(("f_number", "focus", "focal"), [(1.4, 10.0, 50.0), (4.0, 3.0, 85.0)])
def test_the_disc_is_that_of_two_thin_lens_equations(depth: float, f_number: float, focus: float, focal: float) -> None:
    assert radius_at(depth, f_number, focus, focal) == pytest.approx(traced(depth, f_number, focus, focal), rel=1e-5)


def test_the_focal_plane_is_sharp_and_the_sky_has_a_finite_disc() -> None:
    assert radius_at(10.0) == 0.0
    # The radius approaches that of the sky like focus over depth.
    assert radius_at(np.inf) == pytest.approx(radius_at(1e7), rel=2e-6)


def test_discs_grow_away_from_the_focal_plane_and_with_the_aperture() -> None:
    behind, before = [radius_at(d) for d in (10, 15, 30, 90)], [-radius_at(d) for d in (10, 8, 5, 2)]
    assert behind == sorted(behind)
    assert before == sorted(before)
    assert radius_at(30.0, f_number=1.4) == pytest.approx(2 * radius_at(30.0, f_number=2.8), rel=1e-5)


def test_a_sharp_image_does_not_change() -> None:
    image = np.random.default_rng(0).random((20, 30, 3), np.float32)
    assert defocus(image, np.full((20, 30), 0.49, np.float32)) is image


def test_a_blurred_wall_is_its_convolution_with_a_disc() -> None:
    image = np.random.default_rng(0).random((60, 80, 3), np.float32)
    blurred = defocus(image, np.full((60, 80), 2.3, np.float32))
    expected = cv2.filter2D(image, -1, disc_kernel(2.3), borderType=cv2.BORDER_CONSTANT)
    cover = cv2.filter2D(np.ones((60, 80), np.float32), -1, disc_kernel(2.3), borderType=cv2.BORDER_CONSTANT)
    np.testing.assert_allclose(blurred, expected / cover[..., None], atol=1e-4)


def test_blur_preserves_energy() -> None:
    image = np.zeros((61, 61, 3), np.float32)
    image[30, 30] = 100.0
    blurred = convolve(image, disc_kernel(6.7))
    np.testing.assert_allclose(blurred.sum(axis=(0, 1)), 100.0, rtol=1e-5)
    assert blurred.min() >= 0.0
    even = np.full((40, 50, 3), 0.7, np.float32)
    depth_steps = np.repeat(np.linspace(-8.0, 8.0, 40, dtype=np.float32)[:, None], 50, axis=1)
    np.testing.assert_allclose(defocus(even, depth_steps), 0.7, rtol=1e-5)


def test_a_blurred_background_does_not_bleed_over_a_sharp_foreground() -> None:
    image = np.zeros((40, 60, 3), np.float32)
    image[:, 30:] = 1.0  # bright and far
    radius = np.zeros((40, 60), np.float32)
    radius[:, 30:] = 1.5
    blurred = defocus(image, radius)
    np.testing.assert_allclose(blurred[:, :30], 0.0, atol=1e-5)


def test_a_blurred_foreground_bleeds_over_a_sharp_background() -> None:
    image = np.zeros((40, 60, 3), np.float32)
    image[:, 30:] = 1.0
    radius = np.zeros((40, 60), np.float32)
    radius[:, 30:] = -1.5
    kernel = disc_kernel(1.5)
    share = kernel[:, kernel.shape[1] // 2 + 1 :].sum()  # of the disc around a pixel, beyond its right edge
    assert defocus(image, radius)[20, 29, 0] == pytest.approx(share, abs=1e-5)
