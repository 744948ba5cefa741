"""What an asset declares as variable: the paper's ``parameter_name, scene_graph_ref, type, minimum, maximum``.

(Section 4.) Angles are degrees here and everywhere at the user's edge: specs, assignments, database. Radians exist only
inside scenes.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any, Final, Self

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, model_validator

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.paths import parse_path, short_name

#: One value of one parameter; ANGLE values are degrees.
Value = float | int | bool | str

#: Largest magnitude of any number that is accepted.
MAX_MAGNITUDE: Final = 1e12
#: A full turn, degrees.
TURN: Final = 360.0


class ParameterType(StrEnum):
    """What kind of value a parameter takes."""

    FLOAT = "FLOAT"
    INT = "INT"
    BOOL = "BOOL"
    CATEGORICAL = "CATEGORICAL"
    #: Periodic, in degrees: 360 is 0.
    ANGLE = "ANGLE"


class Affects(StrEnum):
    """Which stage a parameter is an input of."""

    GEOMETRY = "geometry"
    LIGHT = "light"
    MATERIAL = "material"
    SENSOR_GEOMETRY = "sensor-geometry"
    SENSOR_RADIOMETRY = "sensor-radiometry"


class ParameterDefinition(BaseModel):
    """One variable parameter of an asset.

    Attributes:
        name: how specs call it; the path without ``scene.`` unless declared otherwise.
        path: where it acts, e.g. ``scene.person-1.pos.x`` (the paper's ``scene_graph_ref``).
        minimum, maximum: declared range in ``unit`` (both ends belong to it); None: unbounded. An ANGLE is periodic
            and its range spans at most 360 degrees. None for BOOL and CATEGORICAL.
        choices: the values of a CATEGORICAL parameter, in order.
        unit: e.g. ``m``, ``deg``, ``EV``; empty for pure numbers.
        default: taken where an assignment does not mention the parameter.
        affects: the stage that it is an input of.

    Raises:
        InvalidInput: the declaration contradicts itself.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    name: str = ""
    path: str = Field(validation_alias=AliasChoices("path", "scene_graph_ref"))
    type: ParameterType
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    default: Value
    affects: Affects
    description: str = ""

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, given: Any) -> Any:
        """The name follows from the path, and an ANGLE's unit and range from its type, where they are not given."""
        if not isinstance(given, dict):
            return given
        filled = dict(given)
        path = filled.get("path", filled.get("scene_graph_ref"))
        if not filled.get("name") and isinstance(path, str):
            filled["name"] = short_name(path)
        if filled.get("type") == ParameterType.ANGLE:
            filled.setdefault("unit", "deg")
            if filled.get("minimum") is None and filled.get("maximum") is None:
                filled.update(minimum=0.0, maximum=TURN)
        return filled

    @model_validator(mode="after")
    def _check(self) -> Self:
        parse_path(self.path, field="path")
        self._check_range()
        self.check(self.default, field=f"{self.name}.default")
        return self

    def _check_range(self) -> None:
        low, high = self.minimum, self.maximum
        for end, bound in (("minimum", low), ("maximum", high)):
            if bound is None:
                continue
            if self.type in (ParameterType.BOOL, ParameterType.CATEGORICAL):
                raise InvalidInput(f"a {self.type} parameter has no range", field=f"{self.name}.{end}", value=bound)
            if not math.isfinite(bound) or abs(bound) > MAX_MAGNITUDE:
                raise InvalidInput("not a usable bound", field=f"{self.name}.{end}", value=bound, limit=MAX_MAGNITUDE)
        if low is not None and high is not None and low > high:
            raise InvalidInput("the minimum is above the maximum", field=f"{self.name}.minimum", value=low, limit=high)
        if self.type is ParameterType.ANGLE and (low is None or high is None or high - low > TURN):
            raise InvalidInput(
                "an ANGLE declares a minimum and a maximum at most a turn apart",
                field=f"{self.name}.maximum",
                value=high,
                limit="minimum + 360 deg",
            )
        if self.type is ParameterType.CATEGORICAL:
            if not self.choices or len(set(self.choices)) != len(self.choices):
                raise InvalidInput(
                    "a CATEGORICAL parameter lists its different choices",
                    field=f"{self.name}.choices",
                    value=self.choices,
                )
        elif self.choices:
            raise InvalidInput(
                "only a CATEGORICAL parameter has choices", field=f"{self.name}.choices", value=self.choices
            )

    @property
    def is_number(self) -> bool:
        """FLOAT, INT or ANGLE."""
        return self.type in (ParameterType.FLOAT, ParameterType.INT, ParameterType.ANGLE)

    def check(self, value: object, *, field: str = "") -> Value:
        """The value in its one form: FLOAT and ANGLE as float (an ANGLE within [minimum, minimum + 360)), INT as int.

        Raises:
            InvalidInput: wrong type, not finite, or outside the declared range.
            UnknownName: no such choice.
        """
        field = field or self.name
        if self.type is ParameterType.BOOL:
            if not isinstance(value, bool | np.bool_):
                raise InvalidInput("a BOOL is true or false", field=field, value=value)
            return bool(value)
        if self.type is ParameterType.CATEGORICAL:
            if not isinstance(value, str):
                raise InvalidInput("not one of the choices", field=field, value=value, limit=", ".join(self.choices))
            if value not in self.choices:
                raise UnknownName(f"choice of {self.name}", value, self.choices, field=field)
            return str(value)
        return self._check_number(value, field)

    def _check_number(self, value: object, field: str) -> float | int:
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
            raise InvalidInput(f"a {self.type} takes a number", field=field, value=value)
        # Compared before the conversion, since an int may be too large for a float.
        number = float(value) if -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE else math.inf
        if not math.isfinite(number):
            raise InvalidInput("not a finite number of usable size", field=field, value=value, limit=MAX_MAGNITUDE)
        if self.type is ParameterType.ANGLE:
            return self._check_angle(number, field)
        if (self.minimum is not None and number < self.minimum) or (self.maximum is not None and number > self.maximum):
            raise InvalidInput("outside the declared range", field=field, value=value, limit=self.range_text)
        if self.type is ParameterType.INT:
            if not number.is_integer():
                raise InvalidInput("an INT takes whole numbers", field=field, value=value)
            return int(number)
        return number + 0.0  # −0.0 becomes 0.0

    def _check_angle(self, number: float, field: str) -> float:
        assert self.minimum is not None, "an ANGLE has both bounds"
        assert self.maximum is not None, "an ANGLE has both bounds"
        turned = wrap(number, self.minimum)
        if turned > self.maximum:
            raise InvalidInput(
                "outside the declared range (modulo 360)", field=field, value=number, limit=self.range_text
            )
        return turned

    @property
    def range_text(self) -> str:
        """The declared range for people, e.g. ``-10…20 m``; the choices where there is no range."""
        if self.type is ParameterType.CATEGORICAL:
            return ", ".join(self.choices)
        if self.type is ParameterType.BOOL:
            return "true, false"
        low = "−∞" if self.minimum is None else f"{self.minimum:g}"
        high = "∞" if self.maximum is None else f"{self.maximum:g}"
        return f"{low}…{high} {self.unit}".rstrip()


def wrap(degrees: float, start: float = 0.0) -> float:
    """The same angle within [start, start + 360), degrees; an angle that is there already is returned unchanged."""
    if start <= degrees < start + TURN:
        return degrees + 0.0
    turned = start + math.fmod(degrees - start, TURN)
    if turned < start:
        turned += TURN
    # A tiny negative difference rounds up to the whole turn: that is the start.
    return (start if turned >= start + TURN else turned) + 0.0
