"""Effects of rain on a road, at points from the sources."""

import pytest

from valerie.scene.light.weather import road_friction, water_mm, wetness


def test_the_road_is_dry_without_rain_and_wet_in_a_shower() -> None:
    assert wetness(0.0) == 0
    assert wetness(0.2) < 0.5
    assert wetness(5.0) > 0.95


def test_a_dry_road_has_the_friction_of_a_dry_road() -> None:
    assert road_friction(0.0) == 0.85


def test_a_merely_wet_road_has_that_of_two_tenths_of_a_millimetre() -> None:
    # 5 mm/h wets all of it, and none stands above the texture.
    assert water_mm(5.0) == pytest.approx(0.2, abs=0.001)
    assert road_friction(5.0) == pytest.approx(0.65, abs=0.005)


def test_a_cloudburst_stands_above_the_texture_as_gallaway_measured() -> None:
    standing = 0.01485 * 0.5**0.11 * 3.3**0.43 * 50.0**0.59 / 0.025**0.42 - 0.5
    assert water_mm(50.0) == pytest.approx(0.2 + standing)
    assert 0.55 < road_friction(50.0) < 0.62


def test_more_rain_never_means_more_friction() -> None:
    frictions = [road_friction(rain) for rain in (0.0, 0.1, 0.5, 2.0, 10.0, 25.0, 50.0, 100.0)]
    assert frictions == sorted(frictions, reverse=True)
    assert frictions[-1] > 0.5
