"""The terms in which parameters are related to an operational design domain (ODD).

They are those of ISO 34503:2023, *Road vehicles — Test scenarios for automated driving systems — Specification for operational
design domain*, clauses 9 to 11, as far as something of a scene can stand for them.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final


class OddBranch(StrEnum):
    """The top level of the taxonomy."""

    SCENERY = "scenery"
    ENVIRONMENT = "environmental conditions"
    DYNAMIC = "dynamic elements"


class OddAttribute(StrEnum):
    """An attribute of the taxonomy."""

    ZONES = "zones"
    DRIVABLE_AREA_TYPE = "drivable area type"
    DRIVABLE_AREA_GEOMETRY = "drivable area geometry"
    LANE_SPECIFICATION = "lane specification"
    DRIVABLE_AREA_SIGNS = "drivable area signs"
    DRIVABLE_AREA_EDGE = "drivable area edge"
    DRIVABLE_AREA_SURFACE = "drivable area surface"
    JUNCTIONS = "junctions"
    BASIC_STRUCTURES = "basic road structures"
    SPECIAL_STRUCTURES = "special structures"
    TEMPORARY_STRUCTURES = "temporary road structures"
    AIR_TEMPERATURE = "ambient air temperature"
    WIND = "wind"
    RAINFALL = "rainfall"
    SNOWFALL = "snowfall"
    PARTICULATES = "particulates"
    ILLUMINATION = "illumination"
    CLOUDINESS = "cloudiness"
    ARTIFICIAL_ILLUMINATION = "artificial illumination"
    CONNECTIVITY = "connectivity"
    VULNERABLE_ROAD_USERS = "vulnerable road users"
    MOTOR_VEHICLES = "motor vehicles"
    NON_MOTOR_VEHICLES = "non-motor vehicles"
    SPECIAL_VEHICLES = "special vehicles"
    ANIMALS = "animals"
    SUBJECT_VEHICLE = "subject vehicle"

    @property
    def branch(self) -> OddBranch:
        """The part of the taxonomy that the attribute belongs to."""
        if self in _ENVIRONMENT:
            return OddBranch.ENVIRONMENT
        return OddBranch.DYNAMIC if self in _DYNAMIC else OddBranch.SCENERY


_ENVIRONMENT: Final = frozenset(
    {
        OddAttribute.AIR_TEMPERATURE,
        OddAttribute.WIND,
        OddAttribute.RAINFALL,
        OddAttribute.SNOWFALL,
        OddAttribute.PARTICULATES,
        OddAttribute.ILLUMINATION,
        OddAttribute.CLOUDINESS,
        OddAttribute.ARTIFICIAL_ILLUMINATION,
        OddAttribute.CONNECTIVITY,
    }
)
_DYNAMIC: Final = frozenset(
    {
        OddAttribute.VULNERABLE_ROAD_USERS,
        OddAttribute.MOTOR_VEHICLES,
        OddAttribute.NON_MOTOR_VEHICLES,
        OddAttribute.SPECIAL_VEHICLES,
        OddAttribute.ANIMALS,
        OddAttribute.SUBJECT_VEHICLE,
    }
)
