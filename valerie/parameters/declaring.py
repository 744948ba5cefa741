"""Shorthands for declaring the parameters of an asset in code."""

from __future__ import annotations

from valerie.parameters.definitions import TURN, Affects, ParameterDefinition, ParameterType


def number(
    path: str, low: float, high: float, default: float, affects: Affects, unit: str = "", description: str = ""
) -> ParameterDefinition:
    """Declare a FLOAT in [low, high], in ``unit``."""
    return ParameterDefinition(
        path=path,
        type=ParameterType.FLOAT,
        minimum=low,
        maximum=high,
        unit=unit,
        default=default,
        affects=affects,
        description=description,
    )


def angle(
    path: str, default: float, affects: Affects, description: str = "", *, low: float = 0.0, high: float = TURN
) -> ParameterDefinition:
    """Declare an ANGLE in [low, high], in degrees; by default a whole turn."""
    return ParameterDefinition(
        path=path,
        type=ParameterType.ANGLE,
        minimum=low,
        maximum=high,
        default=default,
        affects=affects,
        description=description,
    )


def choice(
    path: str, choices: tuple[str, ...], default: str, affects: Affects, description: str = ""
) -> ParameterDefinition:
    """Declare a CATEGORICAL with its choices in order."""
    return ParameterDefinition(
        path=path,
        type=ParameterType.CATEGORICAL,
        choices=choices,
        default=default,
        affects=affects,
        description=description,
    )


def switch(path: str, default: bool, affects: Affects, description: str = "") -> ParameterDefinition:
    """Declare a BOOL."""
    return ParameterDefinition(
        path=path, type=ParameterType.BOOL, default=default, affects=affects, description=description
    )
