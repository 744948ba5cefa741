"""Reads protobuf messages field by field without building them: what is not looked at costs neither time nor memory."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
_FIXED = {FIXED64: 8, FIXED32: 4}


class MalformedError(ValueError):
    """The bytes are no message."""


class Field(NamedTuple):
    """One field of a message.

    Attributes:
        number: as the schema numbers it.
        value: of a varint; 0 for other kinds.
        data: the bytes of other kinds.
    """

    number: int
    value: int
    data: memoryview


def fields(message: memoryview) -> Iterator[Field]:
    """The fields of a message in the order of the file.

    Raises:
        MalformedError: a length beyond the end, a kind that does not exist, a varint without end.
    """
    place, end = 0, len(message)
    nothing = message[:0]
    while place < end:
        tag, place = _varint(message, place)
        number, kind = tag >> 3, tag & 7
        if kind == VARINT:
            value, place = _varint(message, place)
            yield Field(number, value, nothing)
            continue
        if kind == BYTES:
            length, place = _varint(message, place)
        elif kind in _FIXED:
            length = _FIXED[kind]
        else:
            raise MalformedError(f"kind {kind} of field {number}")
        if number == 0 or length > end - place:
            raise MalformedError(f"field {number} of {length} bytes, with {end - place} left")
        yield Field(number, 0, message[place : place + length])
        place += length


def varints(packed: memoryview) -> Iterator[int]:
    """The numbers of a packed field.

    Raises:
        MalformedError: a number without end.
    """
    place = 0
    while place < len(packed):
        value, place = _varint(packed, place)
        yield value


def _varint(message: memoryview, place: int) -> tuple[int, int]:
    value = shift = 0
    while shift < 70:
        if place >= len(message):
            raise MalformedError("a number is cut off")
        byte = message[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & 0xFFFF_FFFF_FFFF_FFFF, place
        shift += 7
    raise MalformedError("a number of more than 64 bits")
