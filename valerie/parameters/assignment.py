"""One point of a parameter space, and the canonical JSON and digest behind every identity in the project."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Self

import orjson

from valerie.errors import InvalidInput
from valerie.parameters.definitions import Value

#: Hexadecimal characters of a digest: SHA-256 truncated to 128 bits.
DIGEST_LENGTH: Final = 32
#: Integral floats below this limit are written as integers. Larger ones keep their exponent.
_INTEGRAL_LIMIT: Final = float(2**63)


@dataclass(frozen=True, slots=True)
class Assignment:
    """One point of a space.

    Attributes:
        index: its index in the space, from 0.
        block: index of its block.
        values: path to value, for every parameter that the spec sets. All others keep the asset's default.
    """

    index: int
    block: int
    values: Mapping[str, Value]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))


class CanonicalJson(bytes):
    """Text that is already canonical JSON; `digest` does not encode it again."""


def canonical_json(value: object) -> bytes:
    """Return the canonical JSON of a value, so that equal values have equal bytes.

    Keys are sorted, and there are no spaces. −0.0 is written as 0 and 45.0 as 45. True and 1 differ; a tuple equals a list. The
    value consists of None, bool, int, float, str, mappings with str keys, lists, tuples and numpy scalars.

    Raises:
        InvalidInput: a value is NaN, infinite, an integer beyond 64 bits, or of a type without canonical form.
    """
    try:
        if type(value) is str:  # a shortcut: most parts of digests are digests
            return orjson.dumps(value)
        return orjson.dumps(_canonical(value), option=orjson.OPT_SORT_KEYS)
    except TypeError as error:
        raise InvalidInput(f"no canonical JSON: {error}") from None


def digest(*parts: object) -> str:
    """Return the digest of ``parts``, 32 hexadecimal characters. Every digest in the project is computed here.

    It is SHA-256, truncated to 128 bits, over the kind, length and bytes of each part, so that different sequences of parts
    never share an encoding. A part of type ``bytes`` is hashed as it is, and every other part as its `canonical_json`.
    """
    return DigestPrefix(*parts).digest()


class DigestPrefix:
    """The first parts of several digests, hashed once: ``DigestPrefix(a, b).digest(c) == digest(a, b, c)``."""

    __slots__ = ("_hash",)

    def __init__(self, *parts: object) -> None:
        self._hash = hashlib.sha256()
        _update(self._hash, parts)

    def extended(self, *parts: object) -> Self:
        """Return a longer prefix. This one does not change."""
        longer = type(self)()
        longer._hash = self._hash.copy()  # noqa: SLF001  same class
        _update(longer._hash, parts)  # noqa: SLF001
        return longer

    def digest(self, *parts: object) -> str:
        """Return the digest of the prefix followed by ``parts``."""
        hasher = self._hash.copy()
        _update(hasher, parts)
        return hasher.hexdigest()[:DIGEST_LENGTH]


def _update(hasher: Any, parts: Iterable[object]) -> None:
    for part in parts:
        data = part if isinstance(part, bytes) else canonical_json(part)
        is_json = data is not part or type(part) is CanonicalJson
        hasher.update(b"%c%d:%b" % (106 if is_json else 98, len(data), data))


def _canonical(value: Any) -> Any:
    # Exact types come first for speed: this runs for every product of every frame.
    kind = type(value)
    if kind is str or kind is int or kind is bool or value is None:
        return value
    if kind is float:
        return _canonical_float(value)
    if kind is dict:
        return {key: _canonical_float(item) if type(item) is float else _canonical(item) for key, item in value.items()}
    if kind is list or kind is tuple:
        return [_canonical(item) for item in value]
    if isinstance(value, Mapping):
        return {key: _canonical(item) for key, item in value.items()}
    if isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return _canonical_float(float(value))
    if hasattr(value, "item") and getattr(value, "ndim", None) == 0:
        return _canonical(value.item())
    raise InvalidInput(f"{kind.__name__} has no canonical JSON", value=value)


def _canonical_float(value: float) -> float | int:
    if value.is_integer():
        return int(value) if -_INTEGRAL_LIMIT < value < _INTEGRAL_LIMIT else value
    if not math.isfinite(value):
        raise InvalidInput("not a finite number", value=repr(value))
    return value
