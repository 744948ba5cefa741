"""What pydantic finds wrong, as errors of ours: place, value and limit in words, near matches where a value is one of a few."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from valerie.errors import InvalidInput, UnknownName

_BOUNDS: Final = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<", "max_length": "at most", "min_length": "at least"}
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
    "union_tag_not_found": "a distribution is needed here",
}
#: Problems with a value that has to be one of a few words.
_OF_A_FEW: Final = frozenset({"literal_error", "enum"})


def problem_of(detail: Mapping[str, Any], field: str) -> InvalidInput:
    """One entry of ``ValidationError.errors()``.

    Args:
        detail: the entry.
        field: where the user wrote it.
    """
    kind, given, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind in _OF_A_FEW and isinstance(given, str):
        return UnknownName("value", given, re.findall(r"'([^']*)'", str(context["expected"])), field=field)
    limit = next((f"{sign} {context[key]}" for key, sign in _BOUNDS.items() if key in context), None)
    own = detail["msg"].removeprefix("Value error, ")  # of a validator of ours: stays as it is
    message = _MESSAGES.get(kind, own if kind == "value_error" else own[:1].lower() + own[1:])
    # A mapping is too long to show; of what is missing, pydantic shows what surrounds it.
    return InvalidInput(message, field=field, value=None if isinstance(given, dict) else given, limit=limit)
