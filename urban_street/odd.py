"""Attributes of an operational design domain for the parameters of generated places, and sources of their ranges."""

from __future__ import annotations

from typing import Final, NamedTuple

from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.odd import OddAttribute
from valerie.scene.graph.naming import ENVIRONMENT_PATH, ROOT, SUN_PATH


class Meaning(NamedTuple):
    """An attribute, and the source of the range."""

    odd: OddAttribute
    source: str = ""


#: By path, or by the class of the object at the path.
_MEANINGS: Final = {
    f"{SUN_PATH}.elevation": Meaning(OddAttribute.ILLUMINATION, "from night to noon in central Europe"),
    f"{ENVIRONMENT_PATH}.rain": Meaning(OddAttribute.RAINFALL, "ISO 34503: up to the end of heavy rain"),
    f"{ENVIRONMENT_PATH}.snowfall": Meaning(
        OddAttribute.SNOWFALL, "ISO 34503: up to heavy snow, visibility below 500 m"
    ),
    f"{ENVIRONMENT_PATH}.snow_depth": Meaning(OddAttribute.DRIVABLE_AREA_SURFACE, "until the depth would hide kerbs"),
    f"{ENVIRONMENT_PATH}.leaf_litter": Meaning(OddAttribute.DRIVABLE_AREA_SURFACE, "single leaves to a carpet"),
    f"{ENVIRONMENT_PATH}.visibility": Meaning(OddAttribute.PARTICULATES, "fog; the largest value is clear air"),
    f"{ENVIRONMENT_PATH}.turbidity": Meaning(OddAttribute.PARTICULATES, "clear air to haze"),
    f"{ENVIRONMENT_PATH}.cloud_cover": Meaning(OddAttribute.CLOUDINESS, "the whole possible range"),
    f"{ENVIRONMENT_PATH}.street_lamps": Meaning(OddAttribute.ARTIFICIAL_ILLUMINATION, "the whole possible range"),
    f"{ENVIRONMENT_PATH}.car_lamps": Meaning(OddAttribute.ARTIFICIAL_ILLUMINATION, "the whole possible range"),
    "sun": Meaning(OddAttribute.ILLUMINATION),
    "person": Meaning(OddAttribute.VULNERABLE_ROAD_USERS),
    "bicycle": Meaning(OddAttribute.NON_MOTOR_VEHICLES),
    **dict.fromkeys(("car", "truck", "bus", "motorcycle"), Meaning(OddAttribute.MOTOR_VEHICLES)),
    "traffic-light": Meaning(OddAttribute.DRIVABLE_AREA_SIGNS, "all phases of the program"),
    "traffic-sign": Meaning(OddAttribute.DRIVABLE_AREA_SIGNS),
    "building": Meaning(OddAttribute.BASIC_STRUCTURES),
}


def with_meaning(definition: ParameterDefinition, positions: str) -> ParameterDefinition:
    """Return a declaration with its attribute and source. Cameras and sensors are not part of a domain.

    Args:
        positions: source of the ranges of positions.
    """
    thing = definition.path.removeprefix(f"{ROOT}.").partition(".")[0].rpartition("-")[0]
    meaning = _MEANINGS.get(definition.path) or _MEANINGS.get(thing)
    if meaning is None:
        return definition
    source = meaning.source or (positions if ".pos." in definition.path else "")
    return definition.model_copy(update={"odd": meaning.odd, "source": source})
