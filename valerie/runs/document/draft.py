"""The text of a spec while somebody writes it: read for a form, and changed in place without losing its comments.

The text stays the one document. A change replaces the characters of one value; what is not YAML's block style, such as JSON,
is written again as far as it encloses the change.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Final, Literal, NamedTuple, cast

import yaml
from pydantic import Field, JsonValue

from valerie.document import Document
from valerie.errors import InvalidInput
from valerie.loading import load_document, load_value
from valerie.plain import Json, JsonObject
from valerie.runs.document.notation import TOP_LEVEL, Normalization
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.document.varied import DISTRIBUTIONS, SHORT_WORDS
from valerie.runs.values import Scalar

#: Fields of a spec in the order in which people write them.
_FIELDS: Final = tuple(word for name in RunSpec.model_fields for word in (TOP_LEVEL if name == "blocks" else (name,)))
#: Places whose lines are listed; those of a document with thousands of points would cost more than they help.
_MOST_LINES: Final = 2_000
_INDENT: Final = "  "
#: Text that needs no quotes unless it reads back as another value.
_PLAIN: Final = re.compile(r"[\w.+-][\w.+/%°-]*(?: [\w.+/%°-]+)*")


class FieldChange(Document):
    """Sets a field of the document.

    Attributes:
        field: at the top level, such as ``cameras``.
        value: None removes the field.
    """

    kind: Literal["field"] = "field"
    field: Annotated[str, Field(min_length=1, max_length=200)]
    value: JsonValue


class ParameterChange(Document):
    """Sets how a parameter is treated: varied, constant, or left at the asset's default.

    Attributes:
        parameter: its name in the document.
        vary: its distribution by field, with ``distribution``; None where it is not varied.
        constant: its value; None where it is not constant.
    """

    kind: Literal["parameter"] = "parameter"
    parameter: Annotated[str, Field(min_length=1, max_length=200)]
    vary: dict[str, JsonValue] | None = None
    constant: Scalar | None = None


Change = Annotated[FieldChange | ParameterChange, Field(discriminator="kind")]


class VariedEntry(NamedTuple):
    """A varied parameter.

    Attributes:
        place: dotted, as problems name it.
        document: in canonical form: ``parameter``, ``distribution`` and its fields.
    """

    place: str
    document: JsonObject


class DraftReading(NamedTuple):
    """A draft as a form shows it.

    Attributes:
        fields: values at the top level, as they are written.
        vary: varied parameters of a run with one block.
        several_blocks: True if a form cannot show the parameters.
        lines: dotted place to the number of its line, from 1.
    """

    fields: JsonObject
    vary: tuple[VariedEntry, ...]
    several_blocks: bool
    lines: dict[str, int]


def read_draft(text: str) -> DraftReading:
    """Read a draft, which need not be a valid spec yet.

    Raises:
        InvalidInput: the text is no document (see `valerie.loading`).
    """
    document = load_document(text)
    normalization = Normalization(document)
    several = not _at_top_level(document)
    vary = tuple(
        VariedEntry(normalization.places.get(f"blocks.0.vary.{i}", f"vary.{i}"), entry)
        for i, entry in enumerate(() if several else normalization.varied())
    )
    return DraftReading(document, vary, several, _lines(text.removeprefix("\ufeff")))


def changed_draft(text: str, changes: Sequence[FieldChange | ParameterChange]) -> str:
    """Return the text after the changes; comments outside of what they replace stay.

    Raises:
        InvalidInput: the text is no document, or a parameter changes in a run of several blocks.
    """
    text = text.removeprefix("\ufeff")
    for change in changes:
        document = load_document(text)
        if isinstance(change, FieldChange):
            text = _with_field(text, change.field, change.value)
            continue
        if not _at_top_level(document):
            raise InvalidInput("a run of several blocks is edited as text", field="blocks")
        entry = None if change.vary is None else _entry(change.vary)
        text = _with_varied(text, document, change.parameter, entry)
        value = load_document(text).get("constants")
        constants = value if isinstance(value, dict) else {}
        if change.constant is not None or change.parameter in constants:
            text = _with_entry(text, "constants", constants, change.parameter, change.constant)
    return text


def draft_of(spec: RunSpec) -> str:
    """Return a spec as the text that somebody would write: reads back as an equal spec, in the mapping notation."""
    document = spec.short()
    blocks = cast("list[JsonObject]", document.pop("blocks", []))
    if len(blocks) == 1 and not blocks[0].get("constants") and blocks[0]:
        document |= _block(blocks[0])
    elif blocks:
        document["blocks"] = [_block(block) for block in blocks]
    order = {name: i for i, name in enumerate((*_FIELDS, "blocks"))}
    return "".join(_field(key, document[key]) + "\n" for key in sorted(document, key=order.__getitem__))


def _block(block: JsonObject) -> JsonObject:
    vary = block.get("vary")
    return {**block, "vary": _mapping(vary)} if isinstance(vary, list) else block


def _mapping(vary: Sequence[JsonObject]) -> Json:
    """Return varied parameters in the mapping notation, or unchanged where a name appears twice."""
    names = [str(entry["parameter"]) for entry in vary]
    if len(set(names)) < len(names):
        return [dict(entry) for entry in vary]
    return {name: _entry(entry) for name, entry in zip(names, vary, strict=True)}


def _entry(varied: Mapping[str, Json]) -> Json:
    """Return a distribution in the mapping notation: ``{homogeneous: {from: …, to: …, step: …}}``."""
    name = str(varied.get("distribution", "")).upper()
    if name not in DISTRIBUTIONS:
        raise InvalidInput("unknown distribution", field="vary", value=name, limit=", ".join(DISTRIBUTIONS))
    model = DISTRIBUTIONS[name]
    short = {field: word for word, field in SHORT_WORDS.items()}
    fields: dict[str, Json] = {
        short.get(key, key): value
        for key, value in varied.items()
        if key not in ("parameter", "distribution") and value is not None
    }
    if len(model.listed) == 1 and set(fields) == {model.listed[0]}:
        return {name.lower(): fields[model.listed[0]]}
    return {name.lower(): fields}


def _at_top_level(document: JsonObject) -> bool:
    """Return True if the document has its one block at the top level, or none."""
    return "blocks" not in document


def _with_field(text: str, field: str, value: Json) -> str:
    root = _composed(text)
    if root.flow_style:
        return _rewritten(text, field, value)
    pairs = {str(key.value): (key, node) for key, node in root.value}
    if field not in pairs:
        return text if value is None else _inserted(text, pairs, field, value)
    key, node = pairs[field]
    if value is None:
        return _without_lines(text, key.start_mark.index, _end(text, node))
    return text[: key.start_mark.index] + _field(field, value) + text[_end(text, node) :]


def _with_varied(text: str, document: JsonObject, parameter: str, entry: Json) -> str:
    """Return the text with a parameter's distribution set, or removed where ``entry`` is None."""
    vary = document.get("vary")
    if not isinstance(vary, list):
        known = vary if isinstance(vary, dict) else {}
        return text if entry is None and parameter not in known else _with_entry(text, "vary", known, parameter, entry)
    places = Normalization({"vary": vary}).varied()
    kept = [written for written, read in zip(vary, places, strict=True) if read.get("parameter") != parameter]
    if entry is not None:
        position = next((i for i, read in enumerate(places) if read.get("parameter") == parameter), len(kept))
        kept.insert(position, {parameter: entry})
    return _with_field(text, "vary", kept or None)


def _with_entry(text: str, field: str, known: Mapping[str, Json], name: str, value: Json) -> str:
    """Return the text with an entry of a mapping at the top level set, or removed where ``value`` is None."""
    after = {key: kept for key, kept in known.items() if key != name} if value is None else {**known, name: value}
    root = _composed(text)
    node = next((node for key, node in root.value if key.value == field), None)
    if not after or root.flow_style or not isinstance(node, yaml.MappingNode) or node.flow_style:
        return _with_field(text, field, after or None)
    for key, inner in node.value:
        if key.value == name:
            if value is None:
                return _without_lines(text, key.start_mark.index, _end(text, inner))
            return text[: _after_colon(text, key)] + f" {_written(value)}" + text[_end(text, inner) :]
    indent = " " * node.value[0][0].start_mark.column
    return _with_line(text, _end(text, node), f"{indent}{_written(name)}: {_written(value)}")


def _inserted(text: str, pairs: Mapping[str, tuple[yaml.Node, yaml.Node]], field: str, value: Json) -> str:
    """Return the text with a new field, after the last one that people write before it."""
    order = {name: i for i, name in enumerate(_FIELDS)}
    before = [name for name in pairs if order.get(name, len(order)) < order.get(field, len(order))]
    if not before:
        return f"{_field(field, value)}\n{text}"
    end = max(_end(text, pairs[name][1]) for name in before)
    return _with_line(text, end, _field(field, value))


def _rewritten(text: str, field: str, value: Json) -> str:
    """Return a document in flow style, such as JSON, with a field set or removed."""
    document = {key: kept for key, kept in load_document(text).items() if key != field or value is not None}
    if value is not None:
        document[field] = value
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _with_line(text: str, index: int, line: str) -> str:
    """Return the text with a line after the one that ``index`` is in."""
    end = text.find("\n", index)
    return f"{text.rstrip()}\n{line}\n" if end < 0 else f"{text[:end]}\n{line}{text[end:]}"


def _without_lines(text: str, start: int, end: int) -> str:
    first = text.rfind("\n", 0, start) + 1
    last = text.find("\n", end)
    return text[:first] + ("" if last < 0 else text[last + 1 :])


def _after_colon(text: str, key: yaml.Node) -> int:
    return text.index(":", key.end_mark.index) + 1


def _end(text: str, node: yaml.Node) -> int:
    """Return the end of a node's last character; the mark of a block lies after the blank lines and comments behind it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    end = int(node.end_mark.index)
    start = int(node.start_mark.index)
    return start + len(text[start:end].rstrip())


def _lines(text: str) -> dict[str, int]:
    lines: dict[str, int] = {}
    for place, line in _places(_composed(text), ""):
        if len(lines) == _MOST_LINES:
            break
        lines[place] = line
    return lines


def _places(node: yaml.Node, place: str) -> Iterator[tuple[str, int]]:
    """Yield the places of a node's parts with their lines, those near the root first."""
    inner: list[tuple[str, int, yaml.Node]] = []
    if isinstance(node, yaml.MappingNode):
        inner = [(str(key.value), key.start_mark.line + 1, value) for key, value in node.value]
    elif isinstance(node, yaml.SequenceNode):
        inner = [(str(i), value.start_mark.line + 1, value) for i, value in enumerate(node.value)]
    named = [(f"{place}.{name}" if place else name, line, value) for name, line, value in inner]
    yield from ((name, line) for name, line, _ in named)
    for name, _, value in named:
        yield from _places(value, name)


def _composed(text: str) -> yaml.MappingNode:
    """Return the nodes of a text that `load_document` reads."""
    node = yaml.compose(text, Loader=yaml.CSafeLoader)
    assert isinstance(node, yaml.MappingNode), "a document is a mapping"
    return node


def _field(name: str, value: Json) -> str:
    """Return a field at the top level as text: parameters and lists of structures one to a line."""
    if isinstance(value, dict) and name in ("vary", "constants"):
        return "\n".join([f"{name}:", *(f"{_INDENT}{_written(key)}: {_written(item)}" for key, item in value.items())])
    if isinstance(value, list) and value and all(isinstance(item, dict | list) for item in value):
        return "\n".join([f"{name}:", *(f"{_INDENT}- {_written(item)}" for item in value)])
    return f"{name}: {_written(value)}"


def _written(value: Json) -> str:
    """Return a value in YAML's flow style, on one line, so that it reads back as itself."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_written(key)}: {_written(item)}' for key, item in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    if isinstance(value, str):
        return value if _PLAIN.fullmatch(value) and load_value(value) == value else _quoted(value)
    return json.dumps(value)


def _quoted(text: str) -> str:
    """Return a text in YAML's double quotes. JSON's escapes are not enough: YAML knows more line breaks and no surrogates."""
    return f'"{"".join(_escaped(character) for character in text)}"'


def _escaped(character: str) -> str:
    if character in '"\\':
        return f"\\{character}"
    return character if character.isprintable() else f"\\U{ord(character):08x}"
