"""Effects of rain and snow, at points from the sources."""

import math

import numpy as np
import pytest

from valerie.scene.light.weather import (
    flakes_per_m3,
    road_friction,
    snow_cover,
    snow_extinction,
    water_mm,
    wetness,
)


def test_the_road_is_dry_without_rain_and_wet_in_a_shower() -> None:
    # A share exp(−R / 0.8) is dry, above nine tenths wet from 2 mm/h on.
    assert [wetness(rain) for rain in (0.0, 0.8, 1.6)] == pytest.approx([0.0, 1 - 1 / math.e, 1 - 1 / math.e**2])
    assert wetness(2.0) > 9 / 10


def test_a_dry_road_has_the_friction_of_a_dry_road() -> None:
    assert road_friction(0.0) == 0.85


def test_a_merely_wet_road_has_that_of_two_tenths_of_a_millimetre() -> None:
    # No water stands above the texture at 5 mm/h. A share exp(−5 / 0.8) = 0.002 of the road is still dry.
    assert water_mm(5.0) == pytest.approx(0.2, abs=5e-4)
    assert road_friction(5.0) == pytest.approx(0.65, abs=5e-4)


def test_a_cloudburst_stands_above_the_texture_as_gallaway_measured() -> None:
    standing = 0.01485 * 0.5**0.11 * 3.3**0.43 * 50.0**0.59 / 0.025**0.42 - 0.5
    assert water_mm(50.0) == pytest.approx(0.2 + standing)
    # Between the handbook's 0.65 at 0.2 mm and 0.55 at 1 mm.
    assert road_friction(50.0) == pytest.approx(0.65 - 0.1 * standing / 0.8)


def test_more_rain_never_means_more_friction() -> None:
    frictions = [road_friction(rain) for rain in (0.0, 0.1, 0.5, 2.0, 10.0, 25.0, 50.0, 100.0)]
    assert frictions == sorted(frictions, reverse=True)
    # That of puddles, 2 mm deep.
    assert water_mm(100.0) < 2.0
    assert frictions[-1] > 0.5


def test_snow_covers_the_ground_as_niu_and_yang_found() -> None:
    # Fresh snow of 100 kg/m³ on bare ground with a roughness length of 1 cm.
    assert [snow_cover(depth) for depth in (0.0, 0.025, 0.05)] == pytest.approx([0.0, math.tanh(1), math.tanh(2)])
    assert snow_cover(0.2) > 0.999


@pytest.mark.parametrize(("snowfall", "decibels"), [(0.0, 0.0), (1.0, 5.526), (4.0, 37.4)])
def test_dry_snow_attenuates_as_recommended(snowfall: float, decibels: float) -> None:
    # Table 2 of ITU-R P.1817-1 at 550 nm, in dB/km.
    assert 10 * math.log10(math.exp(snow_extinction(snowfall) * 1000)) == pytest.approx(decibels, abs=0.1)


@pytest.mark.parametrize("snowfall", [0.5, 2.0, 8.0])
def test_flakes_are_those_of_gunn_and_marshalls_distribution_above_a_millimetre(snowfall: float) -> None:
    diameters = np.linspace(1.0, 30.0, 200_001)
    density = 3.8e3 * snowfall**-0.87 * np.exp(-25.5 * snowfall**-0.48 * diameters / 10)
    assert flakes_per_m3(snowfall) == pytest.approx(np.trapezoid(density, diameters), rel=1e-4)


def test_snow_on_the_road_has_the_friction_of_packed_snow() -> None:
    assert road_friction(0.0, 0.2) == pytest.approx(0.2, abs=1e-3)
    # Where a share tanh 1 is covered, the rest is dry.
    assert road_friction(0.0, 0.025) == pytest.approx(0.85 - math.tanh(1) * 0.65)
    assert road_friction(0.0, 0.0) == 0.85
    assert flakes_per_m3(0.0) == 0.0
