"""The facts that an ONNX file states about its input and its classes, for what its document leaves out."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Final

import onnx

from valerie.errors import InvalidInput
from valerie.perception.documents.class_maps import CLASS_LISTS
from valerie.perception.importing.onnx_files import dimensions
from valerie.plain import Json, JsonObject

#: Entries of an input document that decide on the size.
_SIZING: Final = frozenset({"size", "mode", "multiple_of", "longest_side"})
#: Entries of the file's metadata that list the classes.
_NAMES: Final = ("names", "classes")
#: Number of channels to the list of classes that has as many.
_COUNTED: Final = {len(names): name for name, names in CLASS_LISTS.items()}


def with_stated_facts(entries: Mapping[str, Json], model: onnx.ModelProto) -> JsonObject:
    """Return the entries of a document, completed by the layout, the fixed size and the classes of its file.

    Raises:
        InvalidInput: neither document nor file say what the channels of the output mean.
    """
    own_input, own_output, options = (_part(entries, name) for name in ("input", "output", "options"))
    constants = {tensor.name for tensor in model.graph.initializer}
    shape = next((dimensions(value) for value in model.graph.input if value.name not in constants), [])
    layout = own_input.get("layout", "nhwc" if shape[1:] and shape[1] != 3 and shape[-1] == 3 else "nchw")
    of_input: JsonObject = {"layout": layout}
    height, width = shape[1:3] if layout == "nhwc" else shape[2:4] if len(shape) == 4 else (None, None)
    if height is not None and width is not None and not _SIZING & set(own_input):
        of_input |= {"mode": "resize", "size": [width, height]}
    completed: JsonObject = {**entries, "input": {**of_input, **own_input}}
    if "classes" not in own_output and own_output.get("kind") != "labels":
        name = options.get("output", "")
        result = next((dimensions(value) for value in model.graph.output if name in ("", value.name)), [])
        channels = result[-1 if layout == "nhwc" else 1] if len(result) == 4 else None
        completed["output"] = {"classes": _classes(model, channels), **own_output}
    return completed


def _classes(model: onnx.ModelProto, channels: int | None) -> Json:
    """Return the names in the file's metadata, or the list with as many classes as the network has channels."""
    for entry in model.metadata_props:
        names = _listed(entry.value) if entry.key in _NAMES else []
        if names and channels in (None, len(names)):
            return list(names)
    if channels is None:
        return "cityscapes"
    if channels not in _COUNTED:
        raise InvalidInput(
            "neither the file nor a document names its classes",
            field="output.classes",
            value=f"{channels} channels",
            limit="output: {classes: […]} in a document beside the file, with its name and .yaml",
        )
    return _COUNTED[channels]


def _listed(text: str) -> list[str]:
    """Return the names in ``['a', 'b']`` or ``{0: 'a', 1: 'b'}``; an empty list for anything else."""
    try:
        value = ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return []
    if isinstance(value, dict) and list(value) == list(range(len(value))):
        value = list(value.values())
    return value if isinstance(value, list) and all(isinstance(name, str) for name in value) else []


def _part(entries: Mapping[str, Json], name: str) -> Mapping[str, Json]:
    part = entries.get(name)
    return part if isinstance(part, Mapping) else {}
