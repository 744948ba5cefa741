"""Load documents from outside as plain data, with limits on size, depth and values.

Scalars follow YAML 1.2 where 1.1 is surprising: ``no``, ``on`` and ``1:30`` are text, ``1e3`` is a number. Aliases and
tags are refused, since no document needs them and both have been used to exhaust or subvert parsers.
"""

from __future__ import annotations

import json
import re
from collections.abc import Hashable, Mapping
from typing import Any, Final

import yaml

from valerie.errors import InvalidInput
from valerie.parameters.definitions import MAX_MAGNITUDE
from valerie.plain import Json, JsonObject

MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 20


class _Loader(yaml.CSafeLoader):
    """Safe YAML without aliases, tags and duplicate keys, with the scalars of YAML 1.2's core schema."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012  the base class's own, replaced and not extended

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        keys: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise InvalidInput(f"a key must be text (line {key_node.start_mark.line + 1})", value=key)
            if key in keys:
                raise InvalidInput(f"the key appears twice (line {key_node.start_mark.line + 1})", value=key)
            keys.add(key)
        return super().construct_mapping(node, deep)


for _tag, _pattern, _first in (
    ("null", r"~|null|", ["~", "n", ""]),
    ("bool", r"true|True|false|False", list("tTfF")),
    ("int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+0123456789."),
    ),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"(?:{_pattern})\Z"), _first)
# 0123 is a decimal number, as in YAML 1.2.
_Loader.add_constructor("tag:yaml.org,2002:int", lambda _, node: int(str(node.value)))
_Loader.add_constructor("tag:yaml.org,2002:float", lambda _, node: _float(str(node.value)))


def load_document(source: str | bytes | Mapping[str, Json], *, max_bytes: int = MAX_BYTES) -> JsonObject:
    """Load a YAML or JSON document, or check a loaded one.

    Args:
        source: the text, or plain data.
        max_bytes: largest size of the text.

    Returns:
        A new document of dictionaries, lists, text, finite numbers, truth values and None.

    Raises:
        InvalidInput: the document is larger than ``max_bytes``, not UTF-8, not YAML or JSON, more than 20 levels deep, or not a
            mapping; or it has duplicate keys, aliases, tags, or a number that is not finite or beyond ±10¹² (an integer
            ``seed`` may be larger).
    """
    data = _read(_text(source, max_bytes)) if isinstance(source, str | bytes) else source
    if data is None:
        raise InvalidInput("the document is empty", limit="lines of the form  key: value")
    if not isinstance(data, dict):
        raise InvalidInput("the document is not a mapping", value=type(data).__name__, limit="key: value")
    checked = _checked(data, "", 1)
    assert isinstance(checked, dict), "a mapping remains a mapping"
    return checked


def load_value(text: str) -> object:
    """Return the value of a scalar in YAML's plain style: a number, a truth value, None or the text itself."""
    return yaml.load(text, Loader=_Loader)  # noqa: S506  a safe loader of our own


def _text(source: str | bytes, max_bytes: int) -> str:
    size = len(source) if isinstance(source, bytes) else len(source.encode("utf-8", "surrogatepass"))
    if size > max_bytes:
        raise InvalidInput("the document is too large", value=f"{size} bytes", limit=f"{max_bytes} bytes")
    try:
        text = source.decode("utf-8") if isinstance(source, bytes) else source
        text.encode("utf-8")
    except (UnicodeDecodeError, UnicodeEncodeError) as error:
        raise InvalidInput(f"the document is not UTF-8 ({error.reason}, byte {error.start})") from None
    return text.removeprefix("\ufeff")


def _read(text: str) -> Any:
    if text.lstrip()[:1] in ("{", "["):
        try:
            return json.loads(text, object_pairs_hook=_pairs)
        except RecursionError:
            raise _too_deep() from None
        except ValueError:
            # It is not JSON, but YAML's flow style begins in the same way.
            pass
    try:
        _check_events(text)
        return yaml.load(text, Loader=_Loader)  # noqa: S506  a safe loader of our own
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark is not None else ""
        raise InvalidInput(f"not YAML or JSON: {_fault(error, text)}{place}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InvalidInput(f"not YAML or JSON: {str(error).splitlines()[0]}") from None


def _fault(error: yaml.MarkedYAMLError, text: str) -> str:
    """Return the probable fault, in words for people who do not know YAML's grammar."""
    problem, mark = str(error.problem or error.context), error.problem_mark
    if problem == "found character that cannot start any token" and mark is not None:
        character = text.splitlines()[mark.line][mark.column]
        return "spaces indent, not tabs" if character == "\t" else f"text that begins with {character!r} is quoted"
    if problem == "mapping values are not allowed in this context":
        return "no colon is expected here: a key ends with a colon and a space, and text with ': ' is quoted"
    if problem.startswith("did not find expected ','") and error.context_mark is not None:
        return f"the bracket of line {error.context_mark.line + 1} is not closed"
    if problem in ("did not find expected key", "did not find expected '-' indicator"):
        return "this does not fit the lines above: entries of one mapping begin in the same column, and a quote ends its text"
    return problem


def _check_events(text: str) -> None:
    depth = 0
    documents = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        line = event.start_mark.line + 1 if event.start_mark is not None else 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise InvalidInput(f"YAML anchors and aliases are not accepted (line {line})")
        if getattr(event, "tag", None) is not None:
            raise InvalidInput(f"YAML tags are not accepted (line {line})")
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise InvalidInput(f"more than one document (line {line})")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise _too_deep()
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _pairs(pairs: list[tuple[str, Any]]) -> JsonObject:
    mapping: JsonObject = {}
    for key, value in pairs:
        if key in mapping:
            raise InvalidInput("the key appears twice", value=key)
        mapping[key] = value
    return mapping


def _checked(value: Any, field: str, depth: int) -> Any:
    if depth > MAX_DEPTH:
        raise _too_deep()
    if isinstance(value, dict):
        for key in value:
            if not isinstance(key, str):
                raise InvalidInput("a key must be text", field=field, value=key)
        return {key: _checked(item, f"{field}.{key}" if field else key, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_checked(item, f"{field}.{i}" if field else str(i), depth + 1) for i, item in enumerate(value)]
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int | float):
        if field == "seed" and isinstance(value, int):
            return value
        if not -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE:
            shown = repr(value) if isinstance(value, float) else f"an integer of {value.bit_length()} bits"
            raise InvalidInput("not finite or too large", field=field, value=shown, limit=MAX_MAGNITUDE)
        return value
    if isinstance(value, str):
        if "\x00" in value:
            raise InvalidInput("text with a null character", field=field)
        return value
    raise InvalidInput(f"a document cannot hold a {type(value).__name__}", field=field)


def _float(text: str) -> float:
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


def _too_deep() -> InvalidInput:
    return InvalidInput("the document is nested too deeply", limit=f"{MAX_DEPTH} levels")
