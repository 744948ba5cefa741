"""Compare two specs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Final, NamedTuple

from valerie.plain import JsonObject
from valerie.runs.document.run_spec import RunSpec

#: Fields that change no frame.
FREE: Final = frozenset(
    {"name", "description", "functions", "requirements", "detection_threshold", "retention", "parent_run", "iteration"}
)


class Difference(NamedTuple):
    """A value that two specs set differently, with its dotted place; None: not set."""

    place: str
    here: object
    there: object


def differing(here: RunSpec, there: RunSpec, *, besides: Collection[str] = FREE) -> Iterator[Difference]:
    """Yield the differences of two specs, without those in the fields ``besides``."""
    own, other = (spec.model_dump(mode="json", exclude=set(besides)) for spec in (here, there))
    for document in (own, other):
        if isinstance(name := document.get("asset"), str):  # the short form of a mapping
            document["asset"] = {"name": name}
    yield from _differing(own, other, "")


def differing_fields(here: RunSpec, there: RunSpec, *, same_asset: bool) -> list[str]:
    """Return the names of the fields that change frames and differ, sorted.

    Args:
        here, there: the specs.
        same_asset: whether the digests of their assets are equal, since an asset's files can change below its name.
    """
    fields = {difference.place.partition(".")[0] for difference in differing(here, there)}
    return sorted(fields if same_asset else fields | {"asset"})


def _differing(here: object, there: object, place: str) -> Iterator[Difference]:
    own, other = _entries(here), _entries(there)
    if own is None or other is None:
        if here != there:
            yield Difference(place, here, there)
        return
    for key in dict.fromkeys((*own, *other)):
        yield from _differing(own.get(key), other.get(key), f"{place}.{key}" if place else key)


def _entries(value: object) -> JsonObject | None:
    """Return the parts of a JSON object or list by name; None for a plain value."""
    if isinstance(value, Mapping):
        return dict(value)
    return {str(i): part for i, part in enumerate(value)} if isinstance(value, list | tuple) else None
