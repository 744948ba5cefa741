"""The envelope of stored arrays: safetensors bytes in one zstd frame with a checksum.

It contains only data, and equal input gives equal bytes. Any tool can read it: decompress, then `safetensors.numpy.load`. This
reader is strict: it checks every header, and allocates no more than a declared, bounded size.
"""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import orjson
import safetensors.numpy
import zstandard
from numpy.typing import NDArray

from valerie.errors import CorruptArtifact
from valerie.plain import JsonObject

#: Largest decompressed artifact: an 8192 × 8192 float16 RGB image has 384 MiB.
MAX_BYTES: Final = 512 * 1024 * 1024
#: Longest safetensors header that is read, bytes.
_MAX_HEADER: Final = 1_000_000
#: Longest header that is kept after it was read, bytes.
_SMALL_HEADER: Final = 1_000
_META: Final = "valerie"
_DTYPES: Final[dict[str, np.dtype[Any]]] = {
    "U8": np.dtype(np.uint8),
    "U16": np.dtype("<u2"),
    "I16": np.dtype("<i2"),
    "I64": np.dtype("<i8"),
    "F16": np.dtype("<f2"),
    "F32": np.dtype("<f4"),
}


class _PerThread(threading.local):
    """The decompressor of a thread: making one takes longer than reading a small frame, and no two threads may share it."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor()


_PER_THREAD: Final = _PerThread()


def pack(kind: str, arrays: Mapping[str, NDArray[Any]], meta: JsonObject) -> bytes:
    """Pack arrays and their metadata into one frame.

    Args:
        kind: kind of the content; `unpack` checks it.
        arrays: uint8, uint16, int16, int64, float16 or float32, any shape.
        meta: JSON values.
    """
    # One metadata entry: safetensors writes several in random order, so that equal input would give different bytes.
    text = orjson.dumps({"kind": kind, **meta}, option=orjson.OPT_SORT_KEYS).decode()
    raw = safetensors.numpy.save(
        {name: np.ascontiguousarray(array) for name, array in arrays.items()}, metadata={_META: text}
    )
    return zstandard.ZstdCompressor(level=1, write_checksum=True, write_content_size=True).compress(raw)


def unpack(kind: str | tuple[str, ...], data: bytes) -> tuple[dict[str, NDArray[Any]], JsonObject]:
    """Return arrays (read-only views) and metadata of a frame that `pack` wrote.

    Args:
        kind: expected kind of the content; if there are several, ``meta["kind"]`` is the one it has.
        data: the whole stored object.

    Raises:
        CorruptArtifact: not such a frame.
    """
    raw = decompress(data)
    try:
        arrays, meta = _parse(raw)
    except (ValueError, KeyError, TypeError, AttributeError, struct.error) as error:
        raise CorruptArtifact(f"artifact: {error}") from error
    kinds = (kind,) if isinstance(kind, str) else kind
    if meta.get("kind") not in kinds:
        expected = " or ".join(map(repr, kinds))
        raise CorruptArtifact(f"artifact: holds {meta.get('kind')!r} where {expected} was expected")
    return arrays, meta


def decompress(data: bytes) -> bytes:
    """Return the content of one zstd frame with a checksum and a stated, bounded size.

    Raises:
        CorruptArtifact: not such a frame.
    """
    try:
        parameters = zstandard.get_frame_parameters(data)
        size = parameters.content_size
        if not parameters.has_checksum or size in (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR):
            raise CorruptArtifact("artifact: the frame states no size or no checksum")
        if size > MAX_BYTES:
            raise CorruptArtifact(f"artifact: states {size} bytes; limit: {MAX_BYTES}")
        raw: bytes = _PER_THREAD.decompressor.decompress(data, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise CorruptArtifact(f"artifact: {error}") from error
    return raw


def intact(data: bytes) -> bool:
    """Return True if the bytes are one complete frame with a correct checksum."""
    try:
        decompress(data)
    except CorruptArtifact:
        return False
    return True


class _Entry(NamedTuple):
    """An array in a frame; ``begin`` counts from the end of the header."""

    name: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    begin: int


class _Layout(NamedTuple):
    """The content of a safetensors header; ``size`` is the number of bytes that follow it."""

    meta: str
    entries: tuple[_Entry, ...]
    size: int


def _parse(raw: bytes) -> tuple[dict[str, NDArray[Any]], JsonObject]:
    (length,) = struct.unpack_from("<Q", raw)
    start = 8 + length
    if length > _MAX_HEADER or start > len(raw):
        raise ValueError(f"expected {length} bytes as the header states, found {len(raw)}")
    header = raw[8:start]
    layout = _small_layout(header) if length <= _SMALL_HEADER else _layout(header)
    if start + layout.size != len(raw):
        raise ValueError(f"the arrays have {layout.size} bytes, but {len(raw) - start} follow the header")
    meta = orjson.loads(layout.meta)
    if not isinstance(meta, dict):
        raise TypeError("the metadata are not an object")
    return {
        name: np.frombuffer(raw, dtype, math.prod(shape), start + begin).reshape(shape)
        for name, dtype, shape, begin in layout.entries
    }, meta


def _layout(header: bytes) -> _Layout:
    entries = orjson.loads(header)
    meta = entries.pop("__metadata__")[_META]
    arrays: list[_Entry] = []
    covered = 0
    for name, entry in sorted(entries.items(), key=lambda item: item[1]["data_offsets"]):
        dtype, shape, (begin, end) = _DTYPES[entry["dtype"]], entry["shape"], entry["data_offsets"]
        if not all(isinstance(n, int) and n >= 0 for n in (*shape, begin, end)):
            raise ValueError(f"{name}: shape and offsets must be whole numbers")
        if begin != covered or end - begin != math.prod(shape) * dtype.itemsize:
            raise ValueError(f"{name}: bytes {begin} to {end} do not hold {dtype} {shape}")
        arrays.append(_Entry(name, dtype, tuple(shape), begin))
        covered = end
    return _Layout(meta, tuple(arrays), covered)


#: Small artifacts of a kind often have equal headers, whose reading takes longer than that of their content.
_small_layout = lru_cache(maxsize=256)(_layout)
