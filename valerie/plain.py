"""Plain data: the types of JSON values and of JSON Schema, and the conversion of results to plain data and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias, TypedDict, TypeVar

from typing_extensions import TypeAliasType

T = TypeVar("T")

#: A value of a JSON document. Sequences are lists once read, mappings dictionaries.
Json = TypeAliasType("Json", "str | int | float | bool | Sequence[Json] | Mapping[str, Json] | None")
#: An object of a JSON document: in a format that others define, or as its author wrote it, not yet checked by a model.
JsonObject: TypeAlias = dict[str, Json]
#: A JSON Schema, by the keywords that VALERIE reads or writes.
JsonSchema = TypedDict(
    "JsonSchema",
    {
        "$schema": str,
        "$ref": str,
        "$defs": "dict[str, JsonSchema]",
        "title": str,
        "description": str,
        "type": str | list[str],
        "enum": Sequence[Json],
        "const": Json,
        "default": Json,
        "examples": Sequence[Json],
        "anyOf": "list[JsonSchema]",
        "oneOf": "list[JsonSchema]",
        "allOf": "list[JsonSchema]",
        "not": "JsonSchema",
        "properties": "dict[str, JsonSchema]",
        "propertyNames": "JsonSchema",
        "additionalProperties": "bool | JsonSchema",
        "required": list[str],
        "items": "JsonSchema",
        "prefixItems": "list[JsonSchema]",
        "minItems": int,
        "maxItems": int,
        "minLength": int,
        "maxLength": int,
        "format": str,
    },
    total=False,
)


def json_values(value: object) -> Any:
    """Return dataclasses, arrays and plain data as JSON values; numbers that are not finite become None."""
    import orjson

    # orjson asks for the elements of an array that is not contiguous.
    data = orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY, default=lambda array: array.tolist())
    return orjson.loads(data)


def typed(form: type[T], document: object) -> T:
    """Return plain data as its type: the inverse of `dataclasses.asdict`, also after a round trip through JSON text.

    Raises:
        ValidationError: the data do not have this form.
    """
    # Commands that print no results start without pydantic.
    from pydantic import TypeAdapter

    return TypeAdapter(form).validate_python(document)
