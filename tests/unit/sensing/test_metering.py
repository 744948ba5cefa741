"""Automatic exposure."""

import math

import numpy as np
import pytest

from valerie.sensing.metering import BRIGHTEST_EV, DARKEST_EV, DAYLIGHT, LONGEST_EV, metered_ev
from valerie.sensing.sensor import Shot, develop
from valerie.sensing.settings import METERING, Noise, SensorSetting

#: Results are hundredths of a stop; a float16 is within 2⁻¹¹ of its value, 0.0007 stops.
ROUNDING = 0.0057


def grey(value: float) -> np.ndarray:
    return np.full((8, 12, 3), value, np.float16)


def test_an_image_as_bright_as_a_street_by_day_needs_no_correction() -> None:
    assert metered_ev(grey(DAYLIGHT)) == pytest.approx(0.0, abs=ROUNDING)


@pytest.mark.parametrize("stops", [-3.0, -1.0, 2.0, 6.0])
def test_every_stop_less_light_is_a_stop_more_exposure(stops: float) -> None:
    assert metered_ev(grey(DAYLIGHT * 2.0**stops)) == pytest.approx(-stops, abs=ROUNDING)


def test_automatic_exposure_stays_in_its_range() -> None:
    assert metered_ev(grey(0.0)) == BRIGHTEST_EV
    assert metered_ev(grey(np.inf)) == DARKEST_EV
    assert metered_ev(grey(np.nan)) == BRIGHTEST_EV


def test_a_lamp_in_a_corner_hardly_counts() -> None:
    image = grey(0.01)
    image[0, 0] = 24.0
    # One of 96 pixels is log₂(24 / 0.01) stops brighter.
    assert metered_ev(image) == pytest.approx(metered_ev(grey(0.01)) - math.log2(2400) / 96, abs=2 * ROUNDING)


def test_a_metered_picture_is_the_one_of_that_exposure_and_a_correction_adds_to_it() -> None:
    rng = np.random.default_rng(0)
    night = (rng.random((16, 16, 3)) * 0.004).astype(np.float16)
    ev = metered_ev(night)
    for correction in (0.0, -1.5):
        metered = SensorSetting(auto_exposure=True, exposure_ev=correction)
        fixed = SensorSetting(exposure_ev=ev + correction)
        np.testing.assert_array_equal(develop(night, metered), develop(night, fixed))


def test_the_exposure_of_the_background_counts_and_what_time_cannot_give_is_gain() -> None:
    night = grey(0.0004)
    shared = Shot(metered_ev=2.0)
    np.testing.assert_array_equal(
        develop(night, SensorSetting(auto_exposure=True), shared), develop(night, SensorSetting(exposure_ev=2.0))
    )
    noise = Noise(shot=True, full_well_electrons=1000)
    dark = Shot(metered_ev=LONGEST_EV + 2.0)
    metered = develop(night, SensorSetting(auto_exposure=True, noise=noise), dark)
    gain_db = 40 * np.log10(2.0)
    amplified = develop(night, SensorSetting(exposure_ev=LONGEST_EV, gain_db=gain_db, noise=noise), dark)
    np.testing.assert_array_equal(metered, amplified)


def test_without_automatic_exposure_the_setting_decides() -> None:
    night = grey(0.0004)
    # On the linear part of sRGB, and no brighter through the default curve.
    assert develop(night, SensorSetting()).max() <= round(255 * 12.92 * 0.0004)
    metered, day = develop(night, SensorSetting(auto_exposure=True)), develop(grey(DAYLIGHT), SensorSetting())
    assert np.abs(metered.astype(int) - day).max() <= 1


@pytest.mark.parametrize(("stops", "least", "most"), [(0.0, 0.3, 1.0), (-11.0, 5.0, 40.0)])
def test_the_noise_of_the_default_camera_is_below_a_grey_level_by_day_and_grows_with_the_gain_at_night(
    stops: float, least: float, most: float
) -> None:
    # 18 % grey around a street of DAYLIGHT: at night 6 of the 11 stops are gain, so 64 times fewer electrons are counted
    # than by day, and shot noise is at least 8 times larger.
    light = np.full((64, 64, 3), 0.18 * 2.0**stops, np.float16)
    shot = Shot(metered_ev=-stops)
    clean = develop(light, METERING.model_copy(update={"noise": Noise()}), shot).astype(float)
    noise = float((develop(light, METERING, shot) - clean).std())
    assert least < noise < most
