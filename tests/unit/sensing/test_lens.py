"""Vignetting, dirt, drops and chromatic aberration."""

import numpy as np
import pytest

from tests.unit.sensing.conftest import setting
from valerie.sensing.optics import vignetting
from valerie.sensing.sensor import develop
from valerie.sensing.soiling import dirty, rained_on


@pytest.mark.parametrize("strength", [0.5, 1.0, 3.0])
def test_light_falls_off_with_the_fourth_power_of_the_cosine(strength: float) -> None:
    factors = vignetting(33, 21, 25.0, strength)[..., 0]
    ray = np.array([2 + 0.5 - 16.5, 5 + 0.5 - 10.5, 25.0])
    cosine = ray[2] / np.linalg.norm(ray)
    assert factors[5, 2] == pytest.approx(cosine ** (4 * strength), rel=1e-6)
    assert factors[10, 16] == 1.0


def test_no_vignetting_is_one_everywhere() -> None:
    assert (vignetting(20, 10, 15.0, 0.0) == 1.0).all()


def test_more_vignetting_is_darker_everywhere_except_in_the_centre() -> None:
    weak, strong = vignetting(20, 10, 15.0, 1.0), vignetting(20, 10, 15.0, 2.0)
    assert (strong <= weak).all()
    assert strong[0, 0] < weak[0, 0]


def test_lateral_aberration_moves_red_outwards_and_blue_inwards_in_proportion() -> None:
    linear = np.zeros((21, 401, 3), np.float16)
    linear[:, 300] = 1.0  # 100 pixels right of the centre
    picture = develop(linear, setting(lens={"chromatic_aberration": 0.02}, curve="srgb")).astype(int)
    assert [int(picture[10, :, channel].argmax()) for channel in range(3)] == [302, 300, 298]


@pytest.mark.parametrize("soil", [dirty, rained_on])
def test_dirt_and_drops_cover_about_their_share_and_a_higher_share_keeps_the_patches(soil) -> None:  # type: ignore[no-untyped-def]
    image = np.full((180, 320, 3), 0.5, np.float32)
    image[::2] = 1.5
    touched = [(soil(image, share, 3) != image).any(axis=2) for share in (0.05, 0.15, 0.3)]
    for share, mask in zip((0.05, 0.15, 0.3), touched, strict=True):
        # The rims do not count towards the share: beyond 0.8 of its radius, a patch is less than half opaque. The last patch may
        # exceed the share by its own size: three standard deviations above the median, a speck covers 0.03 of the image.
        assert share < mask.mean() < share / 0.8**2 + 0.03
    assert (touched[0] <= touched[1]).all()
    assert (touched[1] <= touched[2]).all()


@pytest.mark.parametrize("soil", [dirty, rained_on])
def test_a_clean_glass_changes_nothing(soil) -> None:  # type: ignore[no-untyped-def]
    image = np.random.default_rng(0).random((30, 40, 3), np.float32)
    np.testing.assert_array_equal(soil(image, 0.0, 3), image)


def test_dust_darkens_bright_areas_and_veils_dark_ones() -> None:
    image = np.zeros((90, 160, 3), np.float32)
    image[:, 80:] = 1.0
    soiled = dirty(image, 0.2, 1)
    # The middle of a speck passes 0.35, and scatters 0.30 … 0.22 of the mean of 0.5 into the rest.
    assert soiled[:, :80].max() == pytest.approx(0.65 * 0.30 * 0.5, rel=1e-5)
    assert soiled[:, 80:].min() == pytest.approx(0.35 + 0.65 * 0.22 * 0.5, rel=1e-5)
    assert soiled.max() <= 1.0


def test_a_drop_shows_the_surroundings_upside_down() -> None:
    image = np.zeros((360, 640, 3), np.float32)
    image[:180] = 1.0  # bright sky over dark ground
    soiled = rained_on(image, 0.3, 1)
    # A drop transmits 0.92 of the light.
    assert soiled[200:].max() == pytest.approx(0.92, rel=1e-5)
    assert soiled[:160].min() == pytest.approx(0.0, abs=1e-5)
