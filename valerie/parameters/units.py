"""Quantities with units, as people write them: ``50 cm``, ``1.2 rad``, ``-0.5 EV``, ``30 %``.

A number without a unit takes the unit of the parameter's declaration. Conversions are decimal where the units are, so
that ``30 cm`` is exactly ``0.3``.
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


class Quantity(NamedTuple):
    """A number in the unit that was asked for, and whether its own unit was written with it."""

    number: float
    unit_given: bool


def is_quantity(text: str) -> bool:
    """Whether ``text`` reads as a number with or without a unit (the unit may be unknown)."""
    return _QUANTITY.fullmatch(text) is not None


def to_unit(value: object, unit: str, *, field: str = "") -> Quantity:
    """A number or a quantity as it was written, in ``unit``.

    Raises:
        InvalidInput: no number, NaN, infinite or huge, or a unit of another dimension.
        UnknownName: no such unit.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InvalidInput("a number is needed here", field=field, value=value, limit=_form(unit))
    if isinstance(value, str):
        match = _QUANTITY.fullmatch(value)
        if match is None:
            raise InvalidInput("a number is needed here", field=field, value=value, limit=_form(unit))
        number, given = Decimal(match[1]), match[2]
        factor = Decimal(1) if given is None or given == unit else _factor(given, unit, value, field)
        return Quantity(_finite(number * factor, value, field), given is not None)
    return Quantity(_finite(value, value, field), False)


def _factor(given: str, unit: str, value: str, field: str) -> Decimal:
    if given not in UNITS:
        raise UnknownName("unit", given, (*filter(None, UNITS), *filter(None, (unit,))), field=field)
    dimension, size = UNITS[given]
    wanted, wanted_size = UNITS.get(unit, (unit, Decimal(1)))
    if dimension != wanted:
        raise InvalidInput(f"the unit {given!r} does not fit", field=field, value=value, limit=_form(unit))
    return size / wanted_size


def _finite(number: Decimal | float, value: object, field: str) -> float:
    # The comparison also refuses NaN, and never converts a huge integer to a float.
    if not -MAX_MAGNITUDE <= number <= MAX_MAGNITUDE:
        raise InvalidInput("not a finite number of usable size", field=field, value=value, limit=MAX_MAGNITUDE)
    return float(number)


def _form(unit: str) -> str:
    return f"a number in {unit}" if unit else "a number without unit"
