"""The JSON Schema of a spec file, for editors: both notations, with the descriptions of the model.

``python -m valerie.runs.schema`` prints it; the committed copy is ``docs/run-spec.schema.json``.
"""

from __future__ import annotations

import json
from typing import Any, Final

from valerie import plugins
from valerie.parameters.definitions import ParameterType
from valerie.runs.documents import BlockDocument, RunSpec

_DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_DESIGNS: Final = ("grid", "latin_hypercube", "sobol", "halton", "random", "points")


def run_spec_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a spec as people write it."""
    schema = RunSpec.model_json_schema(mode="validation")
    definitions = schema["$defs"]
    for part in (schema, *definitions.values()):
        _describe(part)
    definitions["Quantity"] = {
        "description": "a number, or text with a number and a unit",
        "type": ["number", "string"],
    }
    definitions["Scalar"] = {"description": "any value of any parameter", "type": ["number", "string", "boolean"]}
    vary = _vary(definitions)
    block = definitions[BlockDocument.__name__]["properties"]
    block["vary"] = vary
    block["design"] |= {"examples": list(_DESIGNS)}
    properties = schema["properties"]
    for key in ("design", "count", "vary", "points"):
        # One block may stand at the top.
        properties[key] = block[key]
    properties["parameters"] = _parameters()
    properties["trajectories"] = _trajectories(definitions)
    numbers = {"type": "array", "minItems": 2, "maxItems": 3, "description": "[frames, step, start]"}
    properties["sequence"]["anyOf"].append(numbers)
    properties["renderer"] |= {"anyOf": _renderers()}
    schema["not"] = {
        "required": ["blocks"],
        "anyOf": [{"required": [key]} for key in ("design", "count", "vary", "points")],
    }
    return {"$schema": _DIALECT, "title": "VALERIE run spec", **_without_titles(schema)}


def _vary(definitions: dict[str, Any]) -> dict[str, Any]:
    quantity, scalar = {"$ref": "#/$defs/Quantity"}, {"$ref": "#/$defs/Scalar"}
    count = {"type": "integer", "minimum": 1, "description": "number of mid-quantiles in a grid"}
    spread = {"type": "object", "additionalProperties": False}
    definitions["Varied"] = {
        "description": "one distribution of one parameter, with units",
        "oneOf": [
            _one("homogeneous", {
                **spread,
                "description": "from + k · step, up to and including to",
                "properties": {"from": quantity, "to": quantity, "step": quantity},
                "required": ["from", "to", "step"],
            }),
            _one("gaussian", {
                **spread,
                "description": "normal, truncated to the declared range",
                "properties": {"mean": quantity, "sigma": quantity, "standard_deviation": quantity, "count": count},
                "required": ["mean"],
                "oneOf": [{"required": ["sigma"]}, {"required": ["standard_deviation"]}],
            }),
            _one("uniform", {
                **spread,
                "description": "equally likely, by default over the declared range",
                "properties": {"from": quantity, "to": quantity, "count": count},
            }),
            _one("choice", {"type": "array", "minItems": 1, "items": scalar}),
            _one("constant", scalar),
        ],
    }  # fmt: skip
    definitions["VariedList"] = {
        "description": "the paper's notation",
        "oneOf": [
            _listed("HOMOGENEOUS", "[name, HOMOGENEOUS, minimum, maximum, step]", 3),
            _listed("GAUSSIAN", "[name, GAUSSIAN, mean, standard deviation]", 2),
            _listed("UNIFORM", "[name, UNIFORM, minimum, maximum]", 2),
            _listed("CONSTANT", "[name, CONSTANT, value]", 1),
            {
                "description": "[name, CHOICE, value, value, …]",
                "type": "array",
                "prefixItems": [{"type": "string"}, {"const": "CHOICE"}],
                "minItems": 3,
            },
        ],
    }
    objects = [
        {"$ref": f"#/$defs/{name}"}
        for name in ("VariedHomogeneous", "VariedGaussian", "VariedUniform", "VariedChoice", "VariedConstant")
    ]
    return {
        "description": "varied parameters; in a grid the right-most (last) moves fastest",
        "anyOf": [
            {"type": "object", "additionalProperties": {"$ref": "#/$defs/Varied"}},
            {"type": "array", "items": {"anyOf": [{"$ref": "#/$defs/VariedList"}, *objects]}},
        ],
    }


def _renderers() -> list[dict[str, Any]]:
    """A name; a name with the settings of a built-in engine; a name with settings that only its package knows."""
    forms: list[dict[str, Any]] = [
        {"type": "string", "minLength": 1, "maxLength": 200, "examples": list(plugins.RENDERERS)}
    ]
    for name, model in plugins.engine_settings_models().items():
        schema = model.model_json_schema()
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


def _one(distribution: str, arguments: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": {distribution: arguments},
        "required": [distribution],
        "additionalProperties": False,
    }


def _listed(distribution: str, form: str, numbers: int) -> dict[str, Any]:
    return {
        "description": form,
        "type": "array",
        "prefixItems": [{"type": "string"}, {"const": distribution}],
        "minItems": 2 + numbers,
        "maxItems": 2 + numbers,
    }


def _parameters() -> dict[str, Any]:
    quantity = {"$ref": "#/$defs/Quantity"}
    types = [kind.value for kind in ParameterType]
    declared = {
        "path": {"type": "string"},
        "scene_graph_ref": {"type": "string"},
        "type": {"enum": types},
        **dict.fromkeys(("minimum", "maximum", "from", "to"), quantity),
        "choices": {"type": "array", "items": {"type": "string"}},
    }
    entry = {
        "type": "object",
        "properties": declared,
        "additionalProperties": False,
        "required": ["type"],
        "oneOf": [{"required": ["path"]}, {"required": ["scene_graph_ref"]}],
    }
    return {
        "description": "names of this spec's own: [name, scene_graph_ref, type, minimum, maximum], within the asset's range",
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


def _trajectories(definitions: dict[str, Any]) -> dict[str, Any]:
    """A mapping by thing or a list; keyframes as mappings or as lists of numbers."""
    quantity = {"$ref": "#/$defs/Quantity"}
    numbers = {"type": "array", "minItems": 3, "maxItems": 4, "items": quantity, "description": "[time, x, y, heading]"}
    document = definitions["TrajectoryDocument"]
    keyframes = document["properties"]["keyframes"]
    keyframes["items"] = {
        "anyOf": [{"type": "object", "required": ["time"], "additionalProperties": quantity}, numbers]
    }
    fields = {name: field for name, field in document["properties"].items() if name != "path"}
    named = {"type": "object", "properties": fields, "required": ["keyframes"], "additionalProperties": False}
    listed = {"type": "array", "minItems": 1, "items": numbers}
    in_a_list = {"type": "array", "prefixItems": [{"type": "string"}], "items": numbers, "minItems": 2}
    return {
        "description": "how things move, by keyframes, beside or instead of what the asset says",
        "anyOf": [
            {"type": "object", "additionalProperties": {"anyOf": [named, listed]}},
            {"type": "array", "items": {"anyOf": [{"$ref": "#/$defs/TrajectoryDocument"}, in_a_list]}},
        ],
    }


def _describe(schema: dict[str, Any]) -> None:
    """Move what a docstring says of each field from the model's description to the field's."""
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
    """Pydantic titles every field with its own name, which only makes editors noisy."""
    if isinstance(schema, list):
        return [_without_titles(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        key: _without_titles(value) for key, value in schema.items() if not (key == "title" and isinstance(value, str))
    }


def schema_text() -> str:
    """The schema as it is committed."""
    return json.dumps(run_spec_schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    import sys

    sys.stdout.write(schema_text())
