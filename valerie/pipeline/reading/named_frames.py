"""The frames that the results of a run name as examples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NotRequired, TypedDict, cast

from valerie.runs.products.frame_keys import FrameKey


@dataclass(slots=True)
class NamedFrame:
    """A frame through one sensor setting that findings or verdicts name, with the functions and persons that they name."""

    key: FrameKey
    sensor: str | None
    functions: set[str] = field(default_factory=set)
    persons: set[int] = field(default_factory=set)


class _View(TypedDict):
    frame_id: str
    sensor: NotRequired[str | None]
    function: NotRequired[str | None]
    instance_id: NotRequired[int | None]


def named_frames(document: object) -> list[NamedFrame]:
    """Return the frames that a document of results names, sorted.

    An object names a frame by ``frame_id``, and its pictures by ``sensor``, ``function`` and ``instance_id``.
    """
    named: dict[tuple[FrameKey, str], NamedFrame] = {}
    for view in _views(document):
        key, sensor = FrameKey.parse(view["frame_id"]), view.get("sensor")
        frame = named.setdefault((key, sensor or ""), NamedFrame(key, sensor))
        if function := view.get("function"):
            frame.functions.add(function)
        if isinstance(person := view.get("instance_id"), int):
            frame.persons.add(person)
    return [frame for _, frame in sorted(named.items(), key=lambda item: item[0])]


def _views(document: object) -> Iterator[_View]:
    if isinstance(document, dict):
        if isinstance(document.get("frame_id"), str):
            yield cast("_View", document)
        for value in document.values():
            yield from _views(value)
    elif isinstance(document, list):
        for value in document:
            yield from _views(value)
