"""The configuration inside a checkpoint of mmsegmentation: Python text, which is parsed and never run."""

from __future__ import annotations

import ast
from typing import Final

from valerie.plain import JsonObject

#: Entries that contain the text, of mmcv and of mmengine.
_PLACES: Final = ("meta.config", "meta.cfg")
_MAX_TEXT: Final = 1_000_000
_MAX_DEPTH: Final = 12


def config_values(entries: JsonObject) -> JsonObject:
    """Return the literal values of a configuration by dotted name, e.g. ``model.decode_head.align_corners``.

    Args:
        entries: entries beside the weights; see `valerie.perception.importing.checkpoints.checkpoint_files.StoredCheckpoint`.

    Returns:
        The values; empty without a configuration, or if it cannot be parsed.
    """
    text = next((entries[place] for place in _PLACES if place in entries), None)
    if not isinstance(text, str) or len(text) > _MAX_TEXT:
        return {}
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return {}
    values: JsonObject = {}
    for statement in tree.body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            _collect(statement.value, statement.targets[0].id, values, 0)
    return values


def _collect(node: ast.expr, name: str, into: JsonObject, depth: int) -> None:
    if depth > _MAX_DEPTH:
        return
    if isinstance(node, ast.Call):  # dict(a=…, b=…), as these files write mappings
        for keyword in node.keywords:
            if keyword.arg is not None:
                _collect(keyword.value, f"{name}.{keyword.arg}", into, depth + 1)
        return
    if isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            if isinstance(key, ast.Constant) and isinstance(key.value, str):
                _collect(value, f"{name}.{key.value}", into, depth + 1)
        return
    try:
        into[name] = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError):
        return  # a list of dictionaries or an expression, which no caller needs
