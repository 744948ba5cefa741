"""Convert pydantic's errors to VALERIE's, with field, value and limit, and similar names for unknown words."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from pydantic_core import ErrorDetails

from valerie.errors import InvalidInput, InvalidInputs, UnknownName

if TYPE_CHECKING:
    from pydantic import ValidationError

_BOUNDS: Final = {
    "pattern": "",
    "ge": ">=",
    "gt": ">",
    "le": "<=",
    "lt": "<",
    "max_length": "at most",
    "min_length": "at least",
}
_MESSAGES: Final = {
    **dict.fromkeys(
        (
            "greater_than",
            "greater_than_equal",
            "less_than",
            "less_than_equal",
            "too_long",
            "too_short",
            "string_too_long",
            "string_too_short",
        ),
        "out of bounds",
    ),
    "missing": "this field is missing",
    "int_type": "a whole number is needed here",
    "int_from_float": "a whole number is needed here",
    "int_parsing": "a whole number is needed here",
    "float_type": "a number is needed here",
    "float_parsing": "a number is needed here",
    "string_type": "text is needed here",
    "bool_type": "true or false is needed here",
    "bool_parsing": "true or false is needed here",
    "tuple_type": "a list is needed here",
    "dict_type": "a mapping is needed here",
    "model_type": "a mapping is needed here",
    "union_tag_not_found": "a distribution is needed here",
    "extra_forbidden": "this field is unknown",
    "string_pattern_mismatch": "not of the required form",
    **dict.fromkeys(
        ("datetime_type", "datetime_parsing", "datetime_from_date_parsing", "datetime_object_invalid"),
        "a moment is needed here",
    ),
}
#: The sign in 960x540.
_BETWEEN_NUMBERS: Final = re.compile(r"(?<=[0-9])\s*[x×]\s*(?=[0-9])")
#: Errors for a value that must be one of a few words.
_OF_A_FEW: Final = frozenset({"literal_error", "enum"})


def problems_of(error: ValidationError, document: str = "") -> InvalidInputs:
    """Convert all of pydantic's errors, each with its dotted field below the name of the document."""
    first = (document,) if document else ()
    details = error.errors(include_url=False)
    return InvalidInputs([problem_of(detail, ".".join((*first, *map(str, detail["loc"])))) for detail in details])


def problem_of(detail: ErrorDetails, field: str) -> InvalidInput:
    """Convert an entry of ``ValidationError.errors()``.

    Args:
        field: the field of the user's input.
    """
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind in _OF_A_FEW and isinstance(value, str):
        return UnknownName("value", value, re.findall(r"'([^']*)'", str(context["expected"])), field=field)
    if kind in _OF_A_FEW:
        return InvalidInput("not an accepted value", field=field, value=_shown(value), limit=context["expected"])
    text = detail["msg"].removeprefix("Value error, ")
    # The messages of VALERIE's own validators (value_error) stay unchanged.
    message = _MESSAGES.get(kind, text if kind == "value_error" else text[:1].lower() + text[1:])
    return InvalidInput(message, field=field, value=_shown(value), limit=_right(kind, value, context))


def _right(kind: str, value: object, context: Mapping[str, object]) -> str | None:
    """Return the text of accepted values; None if they are unknown."""
    if kind == "tuple_type":
        return _listed(value)
    if kind.startswith("datetime"):
        return "as 2027-01-31T18:00"
    if kind == "string_type" and isinstance(value, bool | int | float):
        return f"{json.dumps(value)!r} in quotes"
    if "pattern" in context:
        return str(context["pattern"])
    bounds = (f"{sign} {context[key]}{_counted(kind, context[key])}" for key, sign in _BOUNDS.items() if key in context)
    return next(bounds, None)


def _shown(value: object) -> object:
    """Return None for a mapping, which is too long to show; for a missing field, pydantic's input is the one around it."""
    return None if isinstance(value, dict) else value


def _counted(kind: str, number: object) -> str:
    """Return the noun that a bound counts; empty if it is not of a length."""
    if not kind.endswith(("too_short", "too_long")):
        return ""
    nouns = ("character", "characters") if kind.startswith("string") else ("entry", "entries")
    return f" {nouns[number != 1]}"


def _listed(value: object) -> str | None:
    """Return a value as a list of one; None for no value."""
    if isinstance(value, dict):
        return f"[{{{next(iter(value))}: …}}]" if value else None
    return None if value is None else f"[{_BETWEEN_NUMBERS.sub(', ', str(value))}]"
