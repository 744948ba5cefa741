"""Light and weather of a variant as numbers for tables, without meshes and pictures."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Final, NamedTuple

from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.naming import ENVIRONMENT_PATH
from valerie.scene.light.solar import ANGLES, AZIMUTH, CLOCK_PATHS, ELEVATION, SunAngles
from valerie.scene.light.weather import road_friction
from valerie.scene.variation.variant import complete

_RAIN: Final = f"{ENVIRONMENT_PATH}.rain"
_SNOW_DEPTH: Final = f"{ENVIRONMENT_PATH}.snow_depth"
_DECIDING: Final = (*ANGLES, *CLOCK_PATHS, _RAIN, _SNOW_DEPTH)


class Conditions(NamedTuple):
    """Metadata of a variant; None if the asset does not declare the parameters that determine it.

    Attributes:
        sun_azimuth_deg: azimuth clockwise from north, also for a sun by time and place.
        sun_elevation_deg: elevation above the horizon.
        road_friction: peak friction of new tyres on the road at 50 km/h (`valerie.scene.light.weather.road_friction`).
    """

    sun_azimuth_deg: float | None
    sun_elevation_deg: float | None
    road_friction: float | None


def conditions(assignment: Mapping[str, Value], manifest: Manifest) -> Conditions:
    """Return the conditions of a variant.

    Args:
        assignment: path to value; missing values take their defaults.

    Raises:
        UnknownName, InvalidInput: as `valerie.scene.variation.variant.complete`.
    """
    return _conditions(tuple((path, assignment[path]) for path in _DECIDING if path in assignment), manifest)


def varied_conditions(varied: Collection[str]) -> tuple[str, ...]:
    """Return the names of the `Conditions` that vary with the parameters at these paths."""
    by_time = any(path in varied for path in CLOCK_PATHS)
    differs = {
        "sun_azimuth_deg": by_time or AZIMUTH in varied,
        "sun_elevation_deg": by_time or ELEVATION in varied,
        "road_friction": _RAIN in varied or _SNOW_DEPTH in varied,
    }
    return tuple(name for name in Conditions._fields if differs[name])


@lru_cache(maxsize=1024)
def _conditions(deciding: tuple[tuple[str, Value], ...], manifest: Manifest) -> Conditions:
    values = complete(dict(deciding), manifest)
    rain = _number(values, _RAIN)
    friction = None if rain is None else road_friction(rain, _number(values, _SNOW_DEPTH) or 0.0)
    return Conditions(_number(values, AZIMUTH), _number(values, ELEVATION), friction)


def with_sun_angles(assignment: Mapping[str, Value], manifest: Manifest) -> dict[str, Value]:
    """Return the assignment, with the two angles added if it gives the sun by time and place."""
    angles = sun_by_time(assignment, manifest)
    return {**assignment, **dict(zip(ANGLES, angles or (), strict=False))}


def sun_by_time(assignment: Mapping[str, Value], manifest: Manifest) -> SunAngles | None:
    """Return the angles of a sun by time and place; None if the assignment gives angles or no sun."""
    if not any(path in assignment for path in CLOCK_PATHS):
        return None
    values = complete({path: assignment[path] for path in _DECIDING if path in assignment}, manifest)
    return SunAngles(*(float(values[path]) for path in ANGLES))


def _number(values: Mapping[str, Value], path: str) -> float | None:
    return float(values[path]) if path in values else None
