"""Conversion of the two notations of a spec to the canonical form of `valerie.runs.document.run_spec`.

The paper's lists::

    parameters: [[p1, scene.person-1.pos.x, FLOAT, 0.0, 20.0]]
    vary: [[p1, HOMOGENEOUS, 1.5, 5.5, 1.0]]

Mappings with units::

    parameters: {p1: {path: scene.person-1.pos.x, type: FLOAT, from: 0 m, to: 20 m}}
    vary: {p1: {homogeneous: {from: 1.5 m, to: 5.5 m, step: 1 m}}}

A single block may be written at the top level (``design``, ``count``, ``vary``, ``points``) instead of under
``blocks``. Parts in canonical form stay unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.definitions import ParameterType
from valerie.plain import Json, JsonObject
from valerie.runs.document.varied import DISTRIBUTIONS, SHORT_WORDS, VariedHomogeneous

#: Fields of a single block at the top level.
TOP_LEVEL: Final = ("design", "count", "vary", "points")

#: Other programs' names of distributions.
_ALSO_CALLED: Final = {
    **dict.fromkeys(("NORMAL", "NORM"), "gaussian"),
    **dict.fromkeys(("RANGE", "LINSPACE", "ARANGE", "LINEAR"), "homogeneous"),
    **dict.fromkeys(("VALUES", "LIST", "CHOICES", "CATEGORICAL"), "choice"),
    **dict.fromkeys(("VALUE", "FIXED"), "constant"),
}
_COUNTED: Final = {1: "{} takes one value", 2: "{} takes two numbers", 3: "{} takes three numbers"}
#: Short words of the mapping notation.
_WORDS: Final = {**SHORT_WORDS, "scene_graph_ref": "path"}


def normalized(document: Mapping[str, Json]) -> JsonObject:
    """Return the document in canonical form; other fields stay unchanged, and the model checks them.

    Raises:
        InvalidInputs: every entry that is in neither notation.
    """
    normalization = Normalization(document)
    if normalization.problems:
        raise InvalidInputs(normalization.problems)
    return normalization.document


#: Converts one entry. Arguments: the entry as written, its name if it is in a mapping, and its place.
_Read = Callable[[Json, str | None, str], JsonObject]


class _EntryKind(NamedTuple):
    """A kind of entry that both notations have.

    Attributes:
        read: converts one entry.
        placeholder: replaces an entry that has a problem.
        form: an entry as it may be written, for errors.
    """

    read: _Read
    placeholder: JsonObject
    form: str


class Normalization:
    """A document in canonical form, the problems with its notation, and the places of its parts.

    Attributes:
        document: in canonical form; a placeholder replaces each entry that has a problem, which keeps the indices.
        problems: entries in neither notation.
        places: dotted place in canonical form to the place where the user wrote it, if they differ.
    """

    def __init__(self, document: Mapping[str, Json]) -> None:
        self.problems: list[InvalidInput] = []
        self.places: dict[str, str] = {}
        self.document = self._spec(dict(document))

    def varied(self) -> list[JsonObject]:
        """Return the varied parameters of the first block in canonical form; none where the document has no such list."""
        blocks = self.document.get("blocks")
        block = blocks[0] if isinstance(blocks, list) and blocks else None
        entries = block.get("vary") if isinstance(block, dict) else None
        return [entry for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []

    def _spec(self, spec: JsonObject) -> JsonObject:
        top_level: JsonObject = {key: spec.pop(key) for key in TOP_LEVEL if key in spec}
        blocks = spec.get("blocks")
        if top_level and "blocks" in spec:
            message = f"a spec has either blocks or {', '.join(top_level)} at the top level"
            self.problems.append(InvalidInput(message, field=next(iter(top_level))))
        elif top_level:
            self.places |= {f"blocks.0.{key}": key for key in TOP_LEVEL}
            spec["blocks"] = [self._block(top_level, "blocks.0.", "")]
        elif isinstance(blocks, list | tuple):
            spec["blocks"] = [
                self._block(block, f"blocks.{i}.", f"blocks.{i}.") if isinstance(block, dict) else block
                for i, block in enumerate(blocks)
            ]
        if "parameters" in spec:
            spec["parameters"] = self._entries(spec["parameters"], "parameters", "parameters", _DECLARATION)
        if "trajectories" in spec:
            spec["trajectories"] = self._entries(spec["trajectories"], "trajectories", "trajectories", _TRAJECTORY)
        sequence = spec.get("sequence")
        if isinstance(sequence, list | tuple):
            spec["sequence"] = dict(zip(_SEQUENCE, self._sequence(list(sequence)), strict=False))
        for key in ("asset", "renderer"):
            reference = spec.get(key)
            if isinstance(reference, dict) and set(reference) == {"name"}:
                spec[key] = reference["name"]
        return spec

    def _sequence(self, numbers: list[Json]) -> list[Json]:
        if 2 <= len(numbers) <= len(_SEQUENCE):
            return numbers
        form = f"[{', '.join(_SEQUENCE)}]"
        self.problems.append(
            InvalidInput("a sequence has two or three numbers", field="sequence", value=numbers, limit=form)
        )
        return [1, 1]

    def _block(self, block: JsonObject, place: str, written_place: str) -> JsonObject:
        if "vary" not in block:
            return block
        return {**block, "vary": self._entries(block["vary"], f"{place}vary", f"{written_place}vary", _VARIED)}

    def _entries(self, entries: Json, place: str, written_place: str, kind: _EntryKind) -> Json:
        """Return a mapping, or a list of lists or objects, as a list of objects."""
        if not isinstance(entries, dict | list | tuple):
            message = "entries are needed here, indented"
            self.problems.append(InvalidInput(message, field=written_place, value=entries, limit=kind.form))
            return []
        if isinstance(entries, list) and _is_entry(entries):
            message, limit = "brackets around each entry are missing", f"[[{', '.join(map(str, entries))}]]"
            self.problems.append(InvalidInput(message, field=written_place, value=entries, limit=limit))
            return []
        pairs = list(entries.items()) if isinstance(entries, dict) else [(None, entry) for entry in entries]
        objects: list[JsonObject] = []
        for i, (name, entry) in enumerate(pairs):
            field = f"{written_place}.{i if name is None else name}"
            self.places[f"{place}.{i}"] = field
            for member, word in _short_words(entry):
                self.places[f"{place}.{i}.{member}"] = f"{field}.{word}"
            try:
                objects.append(kind.read(entry, name, field))
            except InvalidInput as problem:
                self.problems.append(problem)
                # Names must differ, or the model would report a second problem.
                objects.append(
                    {key: f"{value}{i}" if key == "name" else value for key, value in kind.placeholder.items()}
                )
        return objects


#: Fields of a sequence in list notation, in order.
_SEQUENCE: Final = ("frames", "step", "start")
#: Fields of a keyframe in list notation, in order.
_KEYFRAME: Final = ("time", "pos.x", "pos.y", "heading")


def _varied(entry: Json, name: str | None, field: str) -> JsonObject:
    if name is not None:
        return _varied_mapping(entry, name, field)
    if isinstance(entry, list | tuple):
        return _varied_list(list(entry), field)
    if isinstance(entry, dict):
        if entry and all(value is None for value in entry.values()):
            raise InvalidInput(
                "braces make a mapping: write the paper's list in square brackets", field=field,
                limit="[p1, HOMOGENEOUS, 1.5, 5.5, 1.0]",
            )  # fmt: skip
        if "parameter" not in entry and len(entry) == 1:
            ((name, inner),) = entry.items()
            return _varied_mapping(inner, str(name), field)
        return _spelled(entry, field)
    raise InvalidInput("not an entry of vary", field=field, value=entry, limit=VariedHomogeneous.list_form("p1"))


def _varied_list(entry: list[Json], field: str) -> JsonObject:
    if len(entry) < 2 or not all(isinstance(word, str) for word in entry[:2]):
        raise InvalidInput(
            "a list has a parameter, a distribution and numbers", field=field, value=entry,
            limit=VariedHomogeneous.list_form("p1"),
        )  # fmt: skip
    name, distribution = str(entry[0]), _distribution(entry[1], field)
    numbers, model = entry[2:], DISTRIBUTIONS[distribution]
    head = {"parameter": name, "distribution": distribution}
    if model.repeated:
        values = numbers[0] if len(numbers) == 1 and isinstance(numbers[0], list) else numbers
        return {**head, model.listed[0]: values}
    if len(numbers) != len(model.listed):
        form = model.list_form(name)
        if "count" in model.model_fields and len(numbers) == len(model.listed) + 1:
            form += f" or {name}: {_mapping_form(distribution)}"
        raise InvalidInput(_COUNTED[len(model.listed)].format(distribution), field=field, value=entry, limit=form)
    return {**head, **dict(zip(model.listed, numbers, strict=True))}


def _varied_mapping(entry: Json, name: str, field: str) -> JsonObject:
    form = f"{name}: {_mapping_form(VariedHomogeneous.word())}"
    if isinstance(entry, list):
        form = f"{name}: {{choice: [{', '.join(map(str, entry))}]}}"
    elif entry is not None and not isinstance(entry, dict):
        form = f"{name}: {{constant: {entry}}}"
    if isinstance(entry, dict) and "distribution" in entry:
        return {"parameter": name, **_spelled(entry, field)}
    if not isinstance(entry, dict) or len(entry) != 1:
        raise InvalidInput("a varied parameter has one distribution", field=field, value=entry, limit=form)
    ((word, arguments),) = entry.items()
    distribution = _distribution(word, field)
    listed = DISTRIBUTIONS[distribution].listed
    if len(listed) == 1 and not isinstance(arguments, dict):
        arguments = {listed[0]: arguments}
    elif arguments is None:
        arguments = {}
    if not isinstance(arguments, dict):
        raise InvalidInput(f"{word} takes a mapping", field=f"{field}.{word}", value=arguments, limit=form)
    return {"parameter": name, "distribution": distribution, **_spelled(arguments, field)}


def _declared(entry: Json, name: str | None, field: str) -> JsonObject:
    form = _DECLARATION.form
    if isinstance(entry, dict):
        declaration = _spelled(entry, field)
        return declaration if name is None else {"name": name, **declaration}
    if name is not None or not isinstance(entry, list | tuple):
        raise InvalidInput("not a parameter declaration", field=field, value=entry, limit=form)
    words: JsonObject = dict(zip(("name", "path", "type"), entry, strict=False))
    rest = list(entry[3:])
    if words.get("type") == ParameterType.CATEGORICAL:
        choices = rest[0] if len(rest) == 1 and isinstance(rest[0], list) else rest
        return {**words, "choices": choices}
    if len(words) < 3 or len(rest) not in (0, 2):
        raise InvalidInput("a declaration has three or five entries", field=field, value=list(entry), limit=form)
    return {**words, **dict(zip(("minimum", "maximum"), rest, strict=False))}


def _trajectory(entry: Json, name: str | None, field: str) -> JsonObject:
    form = _TRAJECTORY.form
    if name is None and isinstance(entry, list | tuple):
        if not entry or not isinstance(entry[0], str):
            raise InvalidInput(
                "a trajectory in list notation begins with its object", field=field, value=list(entry), limit=form
            )
        name, entry = entry[0], list(entry[1:])
    if isinstance(entry, list | tuple):
        entry = {"keyframes": list(entry)}
    if not isinstance(entry, dict):
        raise InvalidInput("not a trajectory", field=field, value=entry, limit=form)
    trajectory = dict(entry) if name is None else {"path": name, **entry}
    keyframes = trajectory.get("keyframes")
    if isinstance(keyframes, list | tuple):
        trajectory["keyframes"] = [_keyframe(keyframe, f"{field}.{i}") for i, keyframe in enumerate(keyframes)]
    return trajectory


def _keyframe(keyframe: Json, field: str) -> Json:
    if not isinstance(keyframe, list | tuple):
        return keyframe
    if not 3 <= len(keyframe) <= len(_KEYFRAME):
        raise InvalidInput(
            "a keyframe in list notation has three or four numbers",
            field=field,
            value=list(keyframe),
            limit=f"[{', '.join(_KEYFRAME)}]",
        )
    return dict(zip(_KEYFRAME, keyframe, strict=False))


def _is_entry(entries: list[Json]) -> bool:
    """Return True if a list of entries is itself one entry of the list notation."""
    plain = not any(isinstance(entry, dict | list) for entry in entries)
    return plain and len(entries) > 2 and all(isinstance(word, str) for word in entries[:2])


def _distribution(word: Json, field: str) -> str:
    distribution = str(word).upper()
    if distribution in _ALSO_CALLED:
        raise InvalidInput(f"unknown distribution {word!r}; did you mean {_ALSO_CALLED[distribution]}?", field=field)
    if distribution not in DISTRIBUTIONS:
        known = (*DISTRIBUTIONS, *(name.lower() for name in DISTRIBUTIONS))
        raise UnknownName("distribution", str(word), known, field=field)
    return distribution


def _mapping_form(distribution: str) -> str:
    """Return the mapping notation of a distribution with its fields named, for error messages."""
    short = {field: word for word, field in SHORT_WORDS.items()}
    model = DISTRIBUTIONS[distribution]
    fields = [*model.listed, *(["count"] if "count" in model.model_fields else [])]
    return f"{{{distribution.lower()}: {{{', '.join(f'{short.get(name, name)}: …' for name in fields)}}}}}"


_VARIED: Final = _EntryKind(
    _varied, {"parameter": "?", "distribution": "CONSTANT", "value": 0}, f"p1: {_mapping_form('HOMOGENEOUS')}"
)
_DECLARATION: Final = _EntryKind(
    _declared, {"name": "?", "path": "?", "type": "FLOAT"}, "[p1, scene.person-1.pos.x, FLOAT, minimum, maximum]"
)
_TRAJECTORY: Final = _EntryKind(
    _trajectory, {"path": "?", "keyframes": [{"time": 0, "?": 0}]}, "[person-1, [time, x, y], [time, x, y], …]"
)


def _short_words(entry: Json) -> Iterator[tuple[str, str]]:
    """Yield (field of the model, word that stands for it) of an entry, including those in its distribution."""
    if isinstance(entry, dict):
        for key, value in entry.items():
            if key in _WORDS:
                yield _WORDS[key], key
            model = DISTRIBUTIONS.get(key.upper())
            if model is not None and len(model.listed) == 1 and not isinstance(value, dict):
                yield model.listed[0], key
            yield from _short_words(value)


def _spelled(entry: JsonObject, field: str) -> JsonObject:
    """Return the entry with the model's field names instead of the short words."""
    fields: JsonObject = {}
    for key, value in entry.items():
        name = _WORDS.get(key, key)
        if name in fields:
            raise InvalidInput("given twice", field=f"{field}.{key}", value=value)
        fields[name] = value
    distribution = fields.get("distribution")
    if isinstance(distribution, str):
        fields["distribution"] = distribution.upper()
    return fields
