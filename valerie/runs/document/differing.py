"""Compare two specs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Final, NamedTuple, cast

from valerie.parameters.paths import short_name
from valerie.plain import JsonObject
from valerie.runs.document.run_spec import BlockDocument, RunSpec
from valerie.runs.values import Scalar

#: Fields that change no frame, besides the numeric class that makes it.
FREE: Final = frozenset(
    {
        "name",
        "description",
        "functions",
        "requirements",
        "detection_threshold",
        "retention",
        "reproducible",
        "parent_run",
        "iteration",
    }
)


class Difference(NamedTuple):
    """A value that two specs set differently, with its dotted place; None: not set."""

    place: str
    here: object
    there: object


def differing(here: RunSpec, there: RunSpec, *, besides: Collection[str] = FREE) -> Iterator[Difference]:
    """Yield the differences of two specs, without those in the fields ``besides``; places are named as people write them."""
    own, other = (_written(spec, besides) for spec in (here, there))
    if "blocks" not in besides and len(here.blocks) == len(there.blocks) == 1:
        own, other = _unwrapped(own), _unwrapped(other)
    yield from _differing(own, other, "")


def _written(spec: RunSpec, besides: Collection[str]) -> JsonObject:
    document: JsonObject = spec.model_dump(mode="json", exclude=set(besides))
    if isinstance(name := document.get("asset"), str):  # the short form of a mapping
        document["asset"] = {"name": name}
    if "constants" in document:
        document["constants"] = _named(spec.constants)
    if "blocks" in document:
        document["blocks"] = {str(i): _block(block) for i, block in enumerate(spec.blocks)}
    return document


def _block(block: BlockDocument) -> JsonObject:
    varied = {short_name(entry.parameter): entry.model_dump(mode="json", exclude={"parameter"}) for entry in block.vary}
    return {**block.model_dump(mode="json"), "vary": varied, "constants": _named(block.constants)}


def _named(constants: Mapping[str, Scalar]) -> JsonObject:
    return {short_name(path): value for path, value in constants.items()}


def _unwrapped(document: JsonObject) -> JsonObject:
    """Return a document whose only block stands at its top level."""
    whole = {name: value for name, value in document.items() if name != "blocks"}
    block = cast("JsonObject", cast("JsonObject", document["blocks"])["0"])
    of_all, of_block = (cast("JsonObject", one.get("constants", {})) for one in (whole, block))
    return {**whole, **block, "constants": {**of_all, **of_block}}


def differing_fields(here: RunSpec, there: RunSpec, *, same_asset: bool) -> list[str]:
    """Return the names of the fields that change frames and differ, sorted.

    Args:
        here, there: the specs.
        same_asset: True if the digests of their assets are equal, since an asset's files can change below its name.
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
