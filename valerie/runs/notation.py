"""The two notations of a spec, turned into the one form of `valerie.runs.documents`.

The paper's lists::

    parameters: [[p1, scene.person-1.pos.x, FLOAT, 0.0, 20.0]]
    vary: [[p1, HOMOGENEOUS, 1.5, 5.5, 1.0]]

and mappings with units::

    parameters: {p1: {path: scene.person-1.pos.x, type: FLOAT, from: 0 m, to: 20 m}}
    vary: {p1: {homogeneous: {from: 1.5 m, to: 5.5 m, step: 1 m}}}

One block may be written at the top (``design``, ``count``, ``vary``, ``points``) instead of under ``blocks``. What is
in the one form already passes unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.definitions import ParameterType
from valerie.runs.varied import DISTRIBUTIONS, SHORT_WORDS, VariedHomogeneous

_AT_TOP: Final = ("design", "count", "vary", "points")

_COUNTED: Final = {1: "{} takes one value", 2: "{} takes two numbers", 3: "{} takes three numbers"}
#: Short words of the mapping notation.
_WORDS: Final = {**SHORT_WORDS, "scene_graph_ref": "path"}


def normalized(document: dict[str, Any]) -> dict[str, Any]:
    """The document in its one form; other fields pass unchanged for the model to judge.

    Raises:
        InvalidInputs: every entry that is in neither notation.
    """
    normalization = Normalization(document)
    if normalization.problems:
        raise InvalidInputs(normalization.problems)
    return normalization.document


#: Reads one entry: as it was written, its name where a mapping gives one, its place.
_Read = Callable[[Any, str | None, str], dict[str, Any]]


class Normalization:
    """A document in its one form, what was wrong with its notation, and where its parts were written.

    Attributes:
        document: the one form; a harmless entry stands in for each that has a problem, so that indexes stay.
        problems: entries in neither notation.
        places: dotted place in the one form to the place that the user wrote, where they differ.
    """

    def __init__(self, document: dict[str, Any]) -> None:
        self.problems: list[InvalidInput] = []
        self.places: dict[str, str] = {}
        self.document = self._spec(dict(document))

    def _spec(self, found: dict[str, Any]) -> dict[str, Any]:
        at_top: dict[str, Any] = {key: found.pop(key) for key in _AT_TOP if key in found}
        blocks = found.get("blocks")
        if at_top and "blocks" in found:
            message = f"a spec has either blocks or {', '.join(at_top)} at the top"
            self.problems.append(InvalidInput(message, field=next(iter(at_top))))
        elif at_top:
            self.places |= {f"blocks.0.{key}": key for key in _AT_TOP}
            found["blocks"] = [self._block(at_top, "blocks.0.", "")]
        elif isinstance(blocks, list | tuple):
            found["blocks"] = [
                self._block(block, f"blocks.{i}.", f"blocks.{i}.") if isinstance(block, dict) else block
                for i, block in enumerate(blocks)
            ]
        if "parameters" in found:
            found["parameters"] = self._entries(found["parameters"], "parameters", "parameters", _declared, _ANY_NAME)
        if "trajectories" in found:
            found["trajectories"] = self._entries(
                found["trajectories"], "trajectories", "trajectories", _trajectory, _ANY_TRAJECTORY
            )
        if isinstance(found.get("sequence"), list | tuple):
            found["sequence"] = dict(zip(_SEQUENCE, self._sequence(list(found["sequence"])), strict=False))
        for key in ("asset", "renderer"):
            named = found.get(key)
            if isinstance(named, dict) and set(named) == {"name"}:
                found[key] = named["name"]
        return found

    def _sequence(self, given: list[Any]) -> list[Any]:
        if 2 <= len(given) <= len(_SEQUENCE):
            return given
        form = f"[{', '.join(_SEQUENCE)}]"
        self.problems.append(
            InvalidInput("a sequence has two or three numbers", field="sequence", value=given, limit=form)
        )
        return [1, 1]

    def _block(self, block: dict[str, Any], place: str, written: str) -> dict[str, Any]:
        found = dict(block)
        if "vary" in found:
            found["vary"] = self._entries(found["vary"], f"{place}vary", f"{written}vary", _varied, _ANY_VALUE)
        return found

    def _entries(self, given: Any, place: str, written: str, read: _Read, stand_in: dict[str, Any]) -> Any:
        """A list of lists or objects, or a mapping, as a list of objects."""
        if not isinstance(given, dict | list | tuple):
            return given
        pairs = list(given.items()) if isinstance(given, dict) else [(None, entry) for entry in given]
        found: list[dict[str, Any]] = []
        for i, (name, entry) in enumerate(pairs):
            field = f"{written}.{i if name is None else name}"
            self.places[f"{place}.{i}"] = field
            for word in _short_words(entry):
                self.places[f"{place}.{i}.{_WORDS[word]}"] = f"{field}.{word}"
            try:
                found.append(read(entry, name, field))
            except InvalidInput as problem:
                self.problems.append(problem)
                found.append({key: f"{value}{i}" if key == "name" else value for key, value in stand_in.items()})
        return found


#: What stands in for an entry with a problem.
_ANY_VALUE: Final = {"parameter": "?", "distribution": "CONSTANT", "value": 0}
_ANY_NAME: Final = {"name": "?", "path": "?", "type": "FLOAT"}
_ANY_TRAJECTORY: Final = {"path": "?", "keyframes": [{"time": 0, "?": 0}]}
#: What the numbers of a sequence and of a keyframe in list notation are.
_SEQUENCE: Final = ("frames", "step", "start")
_KEYFRAME: Final = ("time", "pos.x", "pos.y", "heading")


def _varied(entry: Any, name: str | None, field: str) -> Any:
    if name is not None:
        return _varied_mapping(entry, name, field)
    if isinstance(entry, list | tuple):
        return _varied_list(list(entry), field)
    if isinstance(entry, dict):
        if entry and all(value is None for value in entry.values()):
            raise InvalidInput(
                "curly brackets make a mapping: write the paper's list in square ones", field=field,
                limit="[p1, HOMOGENEOUS, 1.5, 5.5, 1.0]",
            )  # fmt: skip
        if "parameter" not in entry and len(entry) == 1:
            ((name, inner),) = entry.items()
            return _varied_mapping(inner, str(name), field)
        return _spelled(entry, field)
    raise InvalidInput("not a varied parameter", field=field, value=entry, limit=VariedHomogeneous.list_form("p1"))


def _varied_list(entry: list[Any], field: str) -> dict[str, Any]:
    if len(entry) < 2 or not all(isinstance(word, str) for word in entry[:2]):
        raise InvalidInput(
            "a list names parameter, distribution and numbers", field=field, value=entry,
            limit=VariedHomogeneous.list_form("p1"),
        )  # fmt: skip
    name, distribution = entry[0], _distribution(entry[1], field)
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


def _varied_mapping(entry: Any, name: str, field: str) -> dict[str, Any]:
    form = f"{name}: {_mapping_form(VariedHomogeneous.word())}"
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


def _declared(entry: Any, name: str | None, field: str) -> Any:
    form = "[p1, scene.person-1.pos.x, FLOAT, minimum, maximum]"
    if isinstance(entry, dict):
        named = _spelled(entry, field)
        return named if name is None else {"name": name, **named}
    if name is not None or not isinstance(entry, list | tuple):
        raise InvalidInput("not a parameter declaration", field=field, value=entry, limit=form)
    words: dict[str, Any] = dict(zip(("name", "path", "type"), entry, strict=False))
    rest = list(entry[3:])
    if words.get("type") == ParameterType.CATEGORICAL:
        choices = rest[0] if len(rest) == 1 and isinstance(rest[0], list) else rest
        return {**words, "choices": choices}
    if len(words) < 3 or len(rest) not in (0, 2):
        raise InvalidInput("a declaration has three or five entries", field=field, value=list(entry), limit=form)
    return {**words, **dict(zip(("minimum", "maximum"), rest, strict=False))}


def _trajectory(entry: Any, name: str | None, field: str) -> Any:
    form = "[person-1, [time, x, y], [time, x, y], …]"
    if name is None and isinstance(entry, list | tuple):
        if not entry or not isinstance(entry[0], str):
            raise InvalidInput(
                "a trajectory in a list names the thing first", field=field, value=list(entry), limit=form
            )
        name, entry = entry[0], list(entry[1:])
    if isinstance(entry, list | tuple):
        entry = {"keyframes": list(entry)}
    if not isinstance(entry, dict):
        raise InvalidInput("not a trajectory", field=field, value=entry, limit=form)
    found = dict(entry) if name is None else {"path": name, **entry}
    if isinstance(found.get("keyframes"), list | tuple):
        found["keyframes"] = [_keyframe(key, f"{field}.{i}") for i, key in enumerate(found["keyframes"])]
    return found


def _keyframe(key: Any, field: str) -> Any:
    if not isinstance(key, list | tuple):
        return key
    if not 3 <= len(key) <= len(_KEYFRAME):
        raise InvalidInput(
            "a keyframe in a list has three or four numbers",
            field=field,
            value=list(key),
            limit=f"[{', '.join(_KEYFRAME)}]",
        )
    return dict(zip(_KEYFRAME, key, strict=False))


def _distribution(word: Any, field: str) -> str:
    distribution = str(word).upper()
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


def _short_words(entry: Any) -> Iterator[str]:
    """The short words that an entry uses, also within its distribution."""
    if isinstance(entry, dict):
        for key, value in entry.items():
            if key in _WORDS:
                yield key
            yield from _short_words(value)


def _spelled(entry: dict[str, Any], field: str) -> dict[str, Any]:
    """The entry with the long words of the model instead of the short ones of people."""
    found: dict[str, Any] = {}
    for key, value in entry.items():
        word = _WORDS.get(key, key)
        if word in found:
            raise InvalidInput("given twice", field=f"{field}.{key}", value=value)
        found[word] = value
    if isinstance(found.get("distribution"), str):
        found["distribution"] = found["distribution"].upper()
    return found
