"""Effects of rain on a road, at points from the sources."""

import math

import pytest

from valerie.scene.light.weather import road_friction, water_mm, wetness


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
