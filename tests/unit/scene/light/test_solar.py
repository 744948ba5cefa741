"""The sun by time and place against a published example, an independent library, and common knowledge."""

import datetime as dt
import math

import pytest
from astral import Observer
from astral.sun import azimuth, elevation

from valerie.errors import InvalidInput
from valerie.scene.light.solar import AZIMUTH, CLOCK_PATHS, ELEVATION, angles_of, require_one_notation, sun_angles


def between(first: float, second: float) -> float:
    """Degrees between two directions of a compass."""
    return abs((first - second + 180.0) % 360.0 - 180.0)


#: Accuracy that `valerie.scene.light.solar` states, degrees.
ACCURACY_DEG = 0.5


def test_the_published_example_of_the_solar_position_algorithm_is_met() -> None:
    # Reda and Andreas 2004 (doi:10.1016/j.solener.2003.12.003), table A5.1: Golden, Colorado, 17 October 2003,
    # 12:30:30 at UTC − 7: zenith 50.11162°, azimuth 194.34024°.
    sun = sun_angles(
        time_of_day=12 + 30.5 / 60, day_of_year=290, latitude=39.742476, longitude=-105.1786, utc_offset=-7
    )
    assert sun.elevation == pytest.approx(90 - 50.11162, abs=ACCURACY_DEG)
    assert sun.azimuth == pytest.approx(194.34024, abs=ACCURACY_DEG)


@pytest.mark.parametrize("year", [2019, 2024])
@pytest.mark.parametrize(("latitude", "longitude"), [(50.0, 10.0), (-33.9, 151.2), (1.3, 103.8), (69.6, 18.9)])
def test_an_independent_library_finds_the_sun_in_the_same_place(year: int, latitude: float, longitude: float) -> None:
    observer = Observer(latitude, longitude)
    for day in range(3, 365, 17):
        for hour in (2.0, 7.5, 12.0, 16.25, 21.0):
            moment = dt.datetime(year, 1, 1, tzinfo=dt.UTC) + dt.timedelta(days=day - 1, hours=hour)
            sun = sun_angles(time_of_day=hour, day_of_year=day, latitude=latitude, longitude=longitude, utc_offset=0.0)
            height = elevation(observer, moment, with_refraction=False)
            assert sun.elevation == pytest.approx(height, abs=ACCURACY_DEG)
            # Along the sky: near the zenith a small way is a large angle of the compass.
            assert between(sun.azimuth, azimuth(observer, moment)) * math.cos(math.radians(height)) < ACCURACY_DEG


def test_at_the_summer_solstice_the_sun_stands_overhead_at_the_tropic() -> None:
    sun = sun_angles(time_of_day=12.03, day_of_year=172, latitude=23.44, longitude=0.0, utc_offset=0.0)
    assert sun.elevation == pytest.approx(90.0, abs=ACCURACY_DEG)


def test_in_the_morning_it_stands_in_the_east_and_in_the_evening_in_the_west() -> None:
    place = {"day_of_year": 80, "latitude": 45.0, "longitude": 15.0, "utc_offset": 1.0}
    morning, evening = sun_angles(time_of_day=7.0, **place), sun_angles(time_of_day=17.0, **place)
    # At an equinox, five hours from noon. The equation of time is at most 16.5 minutes, 4.1° of the hour angle.
    hour, latitude = math.radians(75), math.radians(45)
    south = math.degrees(math.atan2(math.sin(hour), math.sin(latitude) * math.cos(hour)))
    assert morning.azimuth == pytest.approx(180 - south, abs=4.1 + ACCURACY_DEG)
    assert evening.azimuth == pytest.approx(180 + south, abs=4.1 + ACCURACY_DEG)


def test_the_clock_and_its_offset_move_together() -> None:
    place = {"day_of_year": 200, "latitude": 50.0, "longitude": 10.0}
    assert sun_angles(time_of_day=15.0, utc_offset=2.0, **place) == sun_angles(
        time_of_day=14.0, utc_offset=1.0, **place
    )


def test_missing_values_of_the_clock_take_their_defaults() -> None:
    noon = angles_of({})
    # An equinox at 50° north, 27 minutes before the sun is in the south: an hour angle of −6.75°.
    assert noon[AZIMUTH] == pytest.approx(180 - 6.75 / math.sin(math.radians(50)), abs=ACCURACY_DEG)
    assert noon[ELEVATION] == pytest.approx(40.0, abs=ACCURACY_DEG)
    assert angles_of({CLOCK_PATHS[0]: 12.0}) == noon


def test_a_sun_in_two_notations_is_refused() -> None:
    with pytest.raises(InvalidInput, match=r"given twice.*sun-1\.elevation, sun-1\.time_of_day"):
        require_one_notation({ELEVATION, CLOCK_PATHS[0], "scene.person-1.pos.x"})
    require_one_notation({ELEVATION, AZIMUTH})
    require_one_notation(set(CLOCK_PATHS))
