"""The variable parameters of an asset: the paper's ``parameter_name, scene_graph_ref, type, minimum, maximum``.

See section 4 of the paper. Angles are in degrees here and in specs, assignments and the database. Only scenes use radians.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any, Final, Self

import numpy as np
from pydantic import AliasChoices, ConfigDict, Field, model_validator

from valerie.document import Document
from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.odd import OddAttribute
from valerie.parameters.paths import parse_path, short_name

#: One value of one parameter; ANGLE values are degrees.
Value = float | int | bool | str

#: Largest accepted magnitude of a number.
MAX_MAGNITUDE: Final = 1e12
#: A full turn, degrees.
TURN: Final = 360.0


class ParameterType(StrEnum):
    """The kind of value that a parameter takes."""

    FLOAT = "FLOAT"
    INT = "INT"
    BOOL = "BOOL"
    CATEGORICAL = "CATEGORICAL"
    #: Periodic, in degrees: 360 equals 0.
    ANGLE = "ANGLE"


class Affects(StrEnum):
    """The stage whose input a parameter is."""

    GEOMETRY = "geometry"
    LIGHT = "light"
    MATERIAL = "material"
    SENSOR_GEOMETRY = "sensor-geometry"
    SENSOR_RADIOMETRY = "sensor-radiometry"


class ParameterDefinition(Document):
    """One variable parameter of an asset.

    Attributes:
        name: its name in specs, by default the path without ``scene.``.
        path: the value that it sets, e.g. ``scene.person-1.pos.x`` (the paper's ``scene_graph_ref``).
        minimum, maximum: declared range in ``unit``, both ends included; None for no bound. An ANGLE is periodic,
            and its range spans at most 360 degrees. None for BOOL and CATEGORICAL.
        choices: the values of a CATEGORICAL parameter, in order.
        unit: its unit, e.g. ``m``, ``deg``, ``EV``; empty for pure numbers.
        default: its value if an assignment does not set it.
        affects: the stage whose input it is.
        description: text for users.
        odd: attribute of an operational design domain that it stands for, if any.
        source: source of its range: a standard, a measurement, a paper.

    Raises:
        InvalidInput: the declaration contradicts itself.
    """

    # The validator below refuses infinite numbers in the same words as all others.
    model_config = ConfigDict(populate_by_name=True, allow_inf_nan=True)

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
    odd: OddAttribute | None = None
    source: str = Field(default="", max_length=1000)

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, declaration: Any) -> Any:
        """Derive a missing name from the path, and an ANGLE's missing unit and range from its type."""
        if not isinstance(declaration, dict):
            return declaration
        complete = dict(declaration)
        path = complete.get("path", complete.get("scene_graph_ref"))
        if not complete.get("name") and isinstance(path, str):
            complete["name"] = short_name(path)
        if complete.get("type") == ParameterType.ANGLE:
            complete.setdefault("unit", "deg")
            if complete.get("minimum") is None and complete.get("maximum") is None:
                complete.update(minimum=0.0, maximum=TURN)
        return complete

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
                raise InvalidInput("not a valid bound", field=f"{self.name}.{end}", value=bound, limit=MAX_MAGNITUDE)
        if low is not None and high is not None and low > high:
            raise InvalidInput("the minimum is above the maximum", field=f"{self.name}.minimum", value=low, limit=high)
        if self.type is ParameterType.ANGLE and (low is None or high is None or high - low > TURN):
            raise InvalidInput(
                "an ANGLE needs a minimum and a maximum, at most one turn apart",
                field=f"{self.name}.maximum",
                value=high,
                limit="minimum + 360 deg",
            )
        if self.type is ParameterType.CATEGORICAL:
            if not self.choices or len(set(self.choices)) != len(self.choices):
                raise InvalidInput(
                    "a CATEGORICAL parameter needs choices, each listed once",
                    field=f"{self.name}.choices",
                    value=self.choices,
                )
        elif self.choices:
            raise InvalidInput(
                "only a CATEGORICAL parameter has choices", field=f"{self.name}.choices", value=self.choices
            )

    @property
    def share(self) -> bool:
        """False: parameters have ranges and units of their own (`valerie.parameters.constraints.Operand`)."""
        return False

    @property
    def is_number(self) -> bool:
        """True for FLOAT, INT and ANGLE."""
        return self.type in (ParameterType.FLOAT, ParameterType.INT, ParameterType.ANGLE)

    def check(self, value: object, *, field: str = "") -> Value:
        """Return a value in its canonical form.

        FLOAT and ANGLE are returned as float (an ANGLE within [minimum, minimum + 360)), INT as int.

        Raises:
            InvalidInput: the value has the wrong type, is not finite, or is outside the declared range.
            UnknownName: there is no such choice.
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
        # The comparison comes before the conversion, since an int may be too large for a float.
        number = float(value) if -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE else math.inf
        if not math.isfinite(number):
            raise InvalidInput("not finite or too large", field=field, value=value, limit=MAX_MAGNITUDE)
        if self.type is ParameterType.ANGLE:
            return self._check_angle(number, field)
        if (self.minimum is not None and number < self.minimum) or (self.maximum is not None and number > self.maximum):
            raise InvalidInput("outside the declared range", field=field, value=value, limit=self.range_text)
        if self.type is ParameterType.INT:
            if not number.is_integer():
                raise InvalidInput("an INT takes a whole number", field=field, value=value)
            return int(number)
        return number + 0.0  # −0.0 becomes 0.0

    def _check_angle(self, number: float, field: str) -> float:
        assert self.minimum is not None, "an ANGLE has both bounds"
        assert self.maximum is not None, "an ANGLE has both bounds"
        wrapped = wrap(number, self.minimum)
        if wrapped > self.maximum:
            raise InvalidInput(
                "outside the declared range (modulo 360)", field=field, value=number, limit=self.range_text
            )
        return wrapped

    def text(self, value: Value, digits: int = 6) -> str:
        """Return a value in words: a choice, ``true`` or ``false``, or a number with the unit, rounded to ``digits``."""
        if isinstance(value, str):
            return value
        if isinstance(value, bool):
            return "true" if value else "false"
        number = str(value) if isinstance(value, int) else f"{value:.{digits}g}"
        return f"{number} {self.unit}".rstrip()

    @property
    def bounds(self) -> tuple[float, float]:
        """The declared range; infinite where it has no end."""
        return -math.inf if self.minimum is None else self.minimum, math.inf if self.maximum is None else self.maximum

    @property
    def unit_sign(self) -> str:
        """The unit as it stands beside a number: ``°`` for degrees."""
        return "°" if self.unit == "deg" else self.unit

    @property
    def range_text(self) -> str:
        """The declared range as text, e.g. ``-10…20 m``; the choices of a parameter without a range."""
        if self.type is ParameterType.CATEGORICAL:
            return ", ".join(self.choices)
        if self.type is ParameterType.BOOL:
            return "true, false"
        low = "−∞" if self.minimum is None else f"{self.minimum:g}"
        high = "∞" if self.maximum is None else f"{self.maximum:g}"
        return f"{low}…{high} {self.unit}".rstrip()


def wrap(degrees: float, start: float = 0.0) -> float:
    """Return the same angle within [start, start + 360), in degrees; an angle in this range is returned unchanged."""
    if start <= degrees < start + TURN:
        return degrees + 0.0
    wrapped = start + math.fmod(degrees - start, TURN)
    if wrapped < start:
        wrapped += TURN
    # A tiny negative difference rounds up to the whole turn, which equals the start.
    return (start if wrapped >= start + TURN else wrapped) + 0.0
