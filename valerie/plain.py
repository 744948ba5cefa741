"""Plain data: names for the few kinds whose keys VALERIE cannot know, and the conversion of plain data to a type."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

T = TypeVar("T")

#: An object of a JSON document that another program or format defines, or that VALERIE writes but does not read: JSON Schema,
#: OpenAPI, COCO, OpenLABEL, glTF, plotly, messages to Blender, the inputs of a digest, printed results.
JsonObject = dict[str, Any]
#: A document, or a part of one, as its author wrote it. No model has checked it yet.
Written = dict[str, Any]
#: Entries of another program's file, such as a checkpoint or its configuration.
ForeignEntries = dict[str, object]
#: Values of a shader's uniforms by their names in GLSL.
Uniforms = dict[str, Any]
#: Values of one row by column. The run's parameters determine further columns.
Row = Mapping[str, Any]
#: Keyword arguments for a library's function, or changes to a frozen object's fields.
Keywords = dict[str, Any]


def typed(form: type[T], document: object) -> T:
    """Return plain data as its type: the inverse of `dataclasses.asdict`, also after a round trip through JSON text.

    Raises:
        ValidationError: the data do not have this form.
    """
    # Commands that print no results start without pydantic.
    from pydantic import TypeAdapter

    return TypeAdapter(form).validate_python(document)
