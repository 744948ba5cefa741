"""Quantities with units: ``50 cm``, ``1.2 rad``, ``-0.5 EV``, ``30 %``.

A number without a unit is in the declared unit of the parameter. Conversions between decimal units are decimal, so ``30 cm`` is
exactly ``0.3``.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Final, NamedTuple

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import MAX_MAGNITUDE

_NUMBER: Final = r"[+-]?(?:[0-9]{1,30}(?:\.[0-9]{0,30})?|\.[0-9]{1,30})(?:[eE][+-]?[0-9]{1,3})?"
_QUANTITY: Final = re.compile(rf"\s*({_NUMBER})\s*([A-Za-zµ°%][A-Za-z0-9/²^]{{0,15}})?\s*")

#: Unit to (dimension, size in the dimension's base unit).
UNITS: Final[dict[str, tuple[str, Decimal]]] = {
    "m": ("length", Decimal(1)),
    "cm": ("length", Decimal("0.01")),
    "mm": ("length", Decimal("0.001")),
    "km": ("length", Decimal(1000)),
    "deg": ("angle", Decimal(1)),
    "°": ("angle", Decimal(1)),
    "rad": ("angle", Decimal(repr(math.degrees(1.0)))),
    "s": ("time", Decimal(1)),
    "ms": ("time", Decimal("0.001")),
    "us": ("time", Decimal("0.000001")),
    "µs": ("time", Decimal("0.000001")),
    "min": ("time", Decimal(60)),
    "h": ("time", Decimal(3600)),
    "EV": ("exposure", Decimal(1)),
    "": ("ratio", Decimal(1)),
    "%": ("ratio", Decimal("0.01")),
}


class ConvertedNumber(NamedTuple):
    """A number in the requested unit.

    Attributes:
        number: the number.
        has_unit: True if the number was written with a unit.
    """

    number: float
    has_unit: bool


def is_quantity(text: str) -> bool:
    """Return True if ``text`` is a number, with or without a unit. The unit may be unknown."""
    return _QUANTITY.fullmatch(text) is not None


def to_unit(value: object, unit: str, *, field: str = "") -> ConvertedNumber:
    """Convert a number or a quantity to ``unit``.

    Raises:
        InvalidInput: the value is not a number, is NaN, infinite or too large, or has a unit of another dimension.
        UnknownName: there is no such unit.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InvalidInput("a number is needed here", field=field, value=value, limit=_form(unit))
    if isinstance(value, str):
        match = _QUANTITY.fullmatch(value)
        if match is None:
            raise InvalidInput("a number is needed here", field=field, value=value, limit=_form(unit))
        number, own_unit = Decimal(match[1]), match[2]
        factor = Decimal(1) if own_unit is None or own_unit == unit else _factor(own_unit, unit, value, field)
        return ConvertedNumber(_finite(number * factor, value, field), own_unit is not None)
    return ConvertedNumber(_finite(value, value, field), False)


def _factor(source: str, target: str, value: str, field: str) -> Decimal:
    target_dimension, target_size = UNITS.get(target, (target, Decimal(1)))
    if source not in UNITS:
        fitting = [unit for unit, (dimension, _) in UNITS.items() if unit and dimension == target_dimension]
        raise UnknownName("unit", source, fitting or [target], field=field)
    source_dimension, source_size = UNITS[source]
    if source_dimension != target_dimension:
        raise InvalidInput(f"the unit {source!r} does not fit", field=field, value=value, limit=_form(target))
    return source_size / target_size


def _finite(number: Decimal | float, value: object, field: str) -> float:
    # This comparison also refuses NaN, and never converts a huge integer to a float.
    if not -MAX_MAGNITUDE <= number <= MAX_MAGNITUDE:
        raise InvalidInput("not finite or too large", field=field, value=value, limit=MAX_MAGNITUDE)
    return float(number)


def _form(unit: str) -> str:
    return f"a number in {unit}" if unit else "a number without unit"
