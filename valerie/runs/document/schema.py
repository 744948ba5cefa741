"""The JSON Schema of spec files, for editors. It covers both notations and takes its descriptions from the docstrings.

``python -m valerie.runs.document.schema`` prints it; the committed copy is ``docs/run-spec.schema.json``.
"""

from __future__ import annotations

import json
from typing import Any, Final, cast

from valerie import plugins
from valerie.parameters.definitions import ParameterType
from valerie.parameters.odd import OddAttribute
from valerie.plain import JsonSchema
from valerie.runs.document.run_spec import BlockDocument, RunSpec
from valerie.runs.document.varied import DISTRIBUTIONS, SHORT_WORDS, VariedDocument

_DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_DESIGNS: Final = ("grid", "latin_hypercube", "sobol", "halton", "random", "points")


def run_spec_schema() -> JsonSchema:
    """Return the JSON Schema (2020-12) of a spec in either notation."""
    schema = cast("JsonSchema", RunSpec.model_json_schema(mode="validation"))
    definitions = schema["$defs"]
    for part in (schema, *definitions.values()):
        _describe(part)
    definitions["Quantity"] = {
        "description": "a number, or a text of a number and a unit",
        "type": ["number", "string"],
    }
    definitions["Scalar"] = {"description": "a value of any parameter", "type": ["number", "string", "boolean"]}
    vary = _vary(definitions)
    block = definitions[BlockDocument.__name__]["properties"]
    block["vary"] = vary
    block["design"] |= {"examples": list(_DESIGNS)}
    properties = schema["properties"]
    for key in ("design", "count", "vary", "points"):
        # The fields of a single block may be at the top level.
        properties[key] = block[key]
    properties["parameters"] = _parameters()
    properties["trajectories"] = _trajectories(definitions)
    numbers: JsonSchema = {"type": "array", "minItems": 2, "maxItems": 3, "description": "[frames, step, start]"}
    properties["sequence"]["anyOf"].append(numbers)
    properties["renderer"] |= {"anyOf": _renderers()}
    schema["not"] = {
        "required": ["blocks"],
        "anyOf": [{"required": [key]} for key in ("design", "count", "vary", "points")],
    }
    return {"$schema": _DIALECT, "title": "VALERIE run spec"} | cast("JsonSchema", _without_titles(schema))


def _vary(definitions: dict[str, JsonSchema]) -> JsonSchema:
    definitions["Varied"] = {
        "description": "the distribution of one parameter, with units",
        "oneOf": [_mapping_form(model, definitions) for model in DISTRIBUTIONS.values()],
    }
    definitions["VariedList"] = {
        "description": "the paper's list notation",
        "oneOf": [_list_form(model) for model in DISTRIBUTIONS.values()],
    }
    objects: list[JsonSchema] = [{"$ref": f"#/$defs/{model.__name__}"} for model in DISTRIBUTIONS.values()]
    return {
        "description": "varied parameters; in a grid the right-most (last) moves fastest",
        "anyOf": [
            {"type": "object", "additionalProperties": {"$ref": "#/$defs/Varied"}},
            {"type": "array", "items": {"anyOf": [{"$ref": "#/$defs/VariedList"}, *objects]}},
        ],
    }


def _mapping_form(model: type[VariedDocument], definitions: dict[str, JsonSchema]) -> JsonSchema:
    """Return the schema of ``homogeneous: {from: 0 m, to: 9 m, step: 1 m}``, or of ``choice: [a, b]``."""
    form = definitions[model.__name__]
    fields = {key: value for key, value in form["properties"].items() if key not in ("parameter", "distribution")}
    if len(model.listed) == 1:
        arguments = fields[model.listed[0]]
    else:
        spellings = {field: [*(word for word, long in SHORT_WORDS.items() if long == field), field] for field in fields}
        required: list[JsonSchema] = [
            {"oneOf": [{"required": [word]} for word in spellings[field]]}
            for field in form["required"]
            if field in fields
        ]
        arguments = {
            "type": "object",
            "additionalProperties": False,
            "description": form["description"],
            "properties": {word: fields[field] for field in fields for word in spellings[field]},
            **({"allOf": required} if required else {}),
        }
    key = model.word().lower()
    return {"type": "object", "properties": {key: arguments}, "required": [key], "additionalProperties": False}


def _list_form(model: type[VariedDocument]) -> JsonSchema:
    """Return the schema of ``[name, HOMOGENEOUS, minimum, maximum, step]``."""
    least = 2 + len(model.listed)
    return {
        "description": model.list_form("name"),
        "type": "array",
        "prefixItems": [{"type": "string"}, {"const": model.word()}],
        "minItems": least,
        **({} if model.repeated else {"maxItems": least}),
    }


def _renderers() -> list[JsonSchema]:
    """Return the schemas of a name, of each built-in engine with settings, and of a plugin with any settings."""
    forms: list[JsonSchema] = [
        {"type": "string", "minLength": 1, "maxLength": 200, "examples": list(plugins.RENDERERS)}
    ]
    for name in plugins.RENDERERS:
        engine = plugins.declared_engine(name)
        if not engine.has_settings:
            continue
        schema = cast("JsonSchema", engine.settings.model_json_schema())
        _describe(schema)
        forms.append(
            {
                **schema,
                "properties": {"name": {"const": name}, **schema["properties"]},
                "required": ["name"],
                "additionalProperties": False,
            }
        )
    forms.append(
        {
            "type": "object",
            "properties": {"name": {"type": "string", "not": {"enum": list(plugins.RENDERERS)}}},
            "required": ["name"],
        }
    )
    return forms


def _parameters() -> JsonSchema:
    quantity: JsonSchema = {"$ref": "#/$defs/Quantity"}
    types = [kind.value for kind in ParameterType]
    declared: dict[str, JsonSchema] = {
        "path": {"type": "string"},
        "scene_graph_ref": {"type": "string"},
        "type": {"enum": types},
        **dict.fromkeys(("minimum", "maximum", "from", "to"), quantity),
        "choices": {"type": "array", "items": {"type": "string"}},
        "odd": {"enum": [*(attribute.value for attribute in OddAttribute), None]},
        "source": {"type": "string", "maxLength": 1000},
    }
    entry: JsonSchema = {
        "type": "object",
        "properties": declared,
        "additionalProperties": False,
        "required": ["type"],
        "oneOf": [{"required": ["path"]}, {"required": ["scene_graph_ref"]}],
    }
    return {
        "description": "this spec's names for parameters: [name, scene_graph_ref, type, minimum, maximum]; ranges are within "
        "the asset's",
        "anyOf": [
            {"type": "object", "additionalProperties": entry},
            {
                "type": "array",
                "items": {
                    "anyOf": [
                        {
                            "type": "array",
                            "prefixItems": [{"type": "string"}, {"type": "string"}, {"enum": types}],
                            "minItems": 3,
                        },
                        {
                            **entry,
                            "properties": {"name": {"type": "string"}, **declared},
                            "required": ["name", "type"],
                        },
                    ]
                },
            },
        ],
    }


def _trajectories(definitions: dict[str, JsonSchema]) -> JsonSchema:
    """Return the schema of trajectories by object or in a list, with keyframes as mappings or as lists of numbers."""
    quantity: JsonSchema = {"$ref": "#/$defs/Quantity"}
    numbers: JsonSchema = {
        "type": "array",
        "minItems": 3,
        "maxItems": 4,
        "items": quantity,
        "description": "[time, x, y, heading]",
    }
    document = definitions["TrajectoryDocument"]
    keyframes = document["properties"]["keyframes"]
    keyframes["items"] = {
        "anyOf": [{"type": "object", "required": ["time"], "additionalProperties": quantity}, numbers]
    }
    fields = {name: field for name, field in document["properties"].items() if name != "path"}
    named: JsonSchema = {
        "type": "object",
        "properties": fields,
        "required": ["keyframes"],
        "additionalProperties": False,
    }
    listed: JsonSchema = {"type": "array", "minItems": 1, "items": numbers}
    in_a_list: JsonSchema = {"type": "array", "prefixItems": [{"type": "string"}], "items": numbers, "minItems": 2}
    return {
        "description": "movements of objects by keyframes, in addition to or instead of the asset's trajectories",
        "anyOf": [
            {"type": "object", "additionalProperties": {"anyOf": [named, listed]}},
            {"type": "array", "items": {"anyOf": [{"$ref": "#/$defs/TrajectoryDocument"}, in_a_list]}},
        ],
    }


def _describe(schema: JsonSchema) -> None:
    """Move the text about each attribute from the model's description (its docstring) to the field's description."""
    summary, _, attributes = schema.get("description", "").partition("Attributes:\n")
    if summary:
        schema["description"] = summary.split("\n\n")[0].strip()
    names: list[str] = []
    for line in attributes.split("\n\n")[0].splitlines():
        head, colon, text = line.partition(": ")
        if colon and line.startswith("    ") and not line.startswith("     "):
            names = [name.strip() for name in head.split(",")]
        else:
            text = line
        for name in names:
            if name in schema["properties"]:
                known = schema["properties"][name].get("description", "")
                schema["properties"][name]["description"] = f"{known} {text.strip()}".strip()


def _without_titles(schema: Any) -> Any:
    """Return a schema without pydantic's titles, which repeat the names of fields."""
    if isinstance(schema, list):
        return [_without_titles(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        key: _without_titles(value) for key, value in schema.items() if not (key == "title" and isinstance(value, str))
    }


def schema_text() -> str:
    """Return the schema as the text of its committed file."""
    return json.dumps(run_spec_schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    import sys

    sys.stdout.write(schema_text())
