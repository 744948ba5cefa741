"""The sun's position in the sky for a time, a day and a place on earth.

Declination and equation of time are Fourier series over the day of the year: Spencer 1971, "Fourier series representation of
the position of the sun", Search 2(5), 172. They ignore the year and refraction. Azimuth and elevation are within 0.5° of the
almanac's in any year from 1950 to 2050, unless the sun is near the zenith (tested).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from valerie.errors import InvalidInput
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType, Value
from valerie.parameters.paths import short_name
from valerie.scene.graph.naming import SUN_PATH

AZIMUTH: Final = f"{SUN_PATH}.azimuth"
ELEVATION: Final = f"{SUN_PATH}.elevation"
#: Paths of the sun's two angles.
ANGLES: Final = (AZIMUTH, ELEVATION)


class ClockParameter(NamedTuple):
    """One parameter, below the sun's path, of the notation by time and place; ``default`` applies if it is missing."""

    name: str
    type: ParameterType
    unit: str
    minimum: float
    maximum: float
    default: float
    description: str

    @property
    def path(self) -> str:
        return f"{SUN_PATH}.{self.name}"

    def definition(self) -> ParameterDefinition:
        """Return the declaration of the parameter for an asset."""
        return ParameterDefinition(
            path=self.path,
            type=self.type,
            unit=self.unit,
            minimum=self.minimum,
            maximum=self.maximum,
            default=self.default,
            affects=Affects.LIGHT,
            description=self.description,
        )


#: The defaults are an equinox in central Europe, on standard time.
CLOCK: Final = (
    ClockParameter("time_of_day", ParameterType.FLOAT, "h", 0.0, 24.0, 12.0, "clock time; replaces the angles"),
    ClockParameter("day_of_year", ParameterType.INT, "d", 1, 366, 80, "1 is the first of January"),
    ClockParameter("latitude", ParameterType.FLOAT, "deg", -90.0, 90.0, 50.0, "north of the equator"),
    ClockParameter("longitude", ParameterType.FLOAT, "deg", -180.0, 180.0, 10.0, "east of Greenwich"),
    ClockParameter("utc_offset", ParameterType.FLOAT, "h", -12.0, 14.0, 1.0, "hours that the clock is ahead of UTC"),
)  # fmt: skip
CLOCK_PATHS: Final = tuple(row.path for row in CLOCK)


class SunAngles(NamedTuple):
    """Angles in degrees: azimuth clockwise from north in [0, 360), elevation of the disc's centre above the horizon."""

    azimuth: float
    elevation: float


def sun_angles(
    *, time_of_day: float, day_of_year: float, latitude: float, longitude: float, utc_offset: float
) -> SunAngles:
    """Return the sun's position in the sky, without refraction.

    Args:
        time_of_day: clock time, hours.
        day_of_year: 1 on the first of January.
        latitude, longitude: degrees, north and east positive.
        utc_offset: hours that the clock is ahead of UTC.
    """
    universal = time_of_day - utc_offset
    # The series count days of a 365-day year from its first midnight.
    day = 2.0 * math.pi * (day_of_year - 1.0 + (universal - 12.0) / 24.0) / 365.0
    declination = (
        0.006918
        - 0.399912 * math.cos(day)
        + 0.070257 * math.sin(day)
        - 0.006758 * math.cos(2 * day)
        + 0.000907 * math.sin(2 * day)
        - 0.002697 * math.cos(3 * day)
        + 0.00148 * math.sin(3 * day)
    )
    ahead_minutes = 229.18 * (
        0.000075
        + 0.001868 * math.cos(day)
        - 0.032077 * math.sin(day)
        - 0.014615 * math.cos(2 * day)
        - 0.040849 * math.sin(2 * day)
    )
    solar_hours = universal + longitude / 15.0 + ahead_minutes / 60.0
    hour_angle = math.radians(15.0 * (solar_hours - 12.0))
    place = math.radians(latitude)
    # Towards east, north and up.
    east = -math.cos(declination) * math.sin(hour_angle)
    north = math.sin(declination) * math.cos(place) - math.cos(declination) * math.sin(place) * math.cos(hour_angle)
    up = math.sin(declination) * math.sin(place) + math.cos(declination) * math.cos(place) * math.cos(hour_angle)
    azimuth = math.degrees(math.atan2(east, north)) % 360.0
    return SunAngles(azimuth, math.degrees(math.asin(max(-1.0, min(1.0, up)))))


def angles_of(clock: Mapping[str, Value]) -> dict[str, Value]:
    """Return the sun's two angles for a time and place: path to degrees.

    They are rounded to a millionth of a degree, so that the last bits of a sine change no digest.

    Args:
        clock: path to value of the time and place; missing values take their defaults.
    """
    values = {row.name: float(clock.get(row.path, row.default)) for row in CLOCK}
    azimuth, elevation = sun_angles(**values)
    return {AZIMUTH: round(azimuth, 6) % 360.0, ELEVATION: round(elevation, 6) + 0.0}


def require_one_notation(paths: frozenset[str] | set[str]) -> None:
    """Refuse a sun that parameters with these paths give in both notations.

    Raises:
        InvalidInput: the paths contain an angle of the sun as well as a time or place.
    """
    angles, clock = sorted(paths.intersection(ANGLES)), sorted(paths.intersection(CLOCK_PATHS))
    if angles and clock:
        raise InvalidInput(
            "the sun is given twice, by its angles and by time and place",
            field=angles[0],
            value=", ".join(short_name(path) for path in (*angles, *clock)),
            limit="one of the two notations",
        )
