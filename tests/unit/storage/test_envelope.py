"""The envelope: equal input gives equal bytes; nothing that lies is believed."""

import json
import os
import struct
import subprocess
import sys

import numpy as np
import pytest
import safetensors.numpy
import zstandard

from valerie.errors import CorruptArtifact
from valerie.storage import envelope

ARRAYS = {"b": np.arange(12, dtype=np.uint8).reshape(3, 4), "a": np.array([1.5, -0.0, np.inf], np.float16)}
META = {"zebra": 1, "apple": [1, 2], "mango": {"x": None}}


def _frame(raw: bytes, *, checksum: bool = True, size: bool = True) -> bytes:
    return zstandard.ZstdCompressor(write_checksum=checksum, write_content_size=size).compress(raw)


def _raw(header: object, body: bytes) -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def _header(entry: object, kind: str = "image") -> dict[str, object]:
    return {"__metadata__": {"valerie": json.dumps({"kind": kind})}, "pixels": entry}


def test_what_was_packed_is_unpacked() -> None:
    arrays, meta = envelope.unpack("image", envelope.pack("image", ARRAYS, META))
    assert {name: (array.dtype, array.tolist()) for name, array in arrays.items()} == {
        name: (array.dtype, array.tolist()) for name, array in ARRAYS.items()
    }
    assert meta == {"kind": "image", **META}


def test_the_safetensors_library_reads_the_same_arrays() -> None:
    raw = zstandard.ZstdDecompressor().decompress(envelope.pack("image", ARRAYS, META))
    read = safetensors.numpy.load(raw)
    assert read.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(read[name], array)


def test_unpacked_arrays_are_read_only() -> None:
    arrays, _ = envelope.unpack("image", envelope.pack("image", ARRAYS, META))
    with pytest.raises(ValueError, match="read-only"):
        arrays["a"][0] = 0


def test_views_that_are_not_contiguous_are_packed_by_their_values() -> None:
    image = np.arange(24, dtype=np.float32).reshape(4, 6)
    arrays, _ = envelope.unpack("x", envelope.pack("x", {"flipped": image[::-1, ::2].T}, {}))
    np.testing.assert_array_equal(arrays["flipped"], image[::-1, ::2].T)


def test_equal_input_gives_equal_bytes_in_every_process() -> None:
    program = (
        "import sys, numpy as np; from valerie.storage import envelope\n"
        "arrays = {'b': np.arange(12, dtype=np.uint8), 'a': np.ones(3, np.float16)}\n"
        "sys.stdout.buffer.write(envelope.pack('image', arrays, {'z': 1, 'a': 2, 'm': 3, 'q': 4}))"
    )
    encodings = {
        subprocess.run(
            [sys.executable, "-c", program], check=True, capture_output=True, env={**os.environ, "PYTHONHASHSEED": seed}
        ).stdout
        for seed in ("0", "1", "2", "3")
    }
    assert len(encodings) == 1


def test_every_flipped_byte_is_noticed() -> None:
    data = envelope.pack("image", ARRAYS, META)
    for position in range(len(data)):
        broken = bytearray(data)
        broken[position] ^= 0x40
        try:
            arrays, meta = envelope.unpack("image", bytes(broken))
        except CorruptArtifact:
            continue
        # A bit of the frame's own header may be without meaning; the content must then be the same.
        assert meta == {"kind": "image", **META}, position
        assert all((arrays[name] == ARRAYS[name]).all() for name in ARRAYS), position


def test_every_truncation_is_noticed() -> None:
    data = envelope.pack("image", ARRAYS, META)
    for length in range(len(data)):
        with pytest.raises(CorruptArtifact):
            envelope.unpack("image", data[:length])


def test_bytes_after_the_frame_are_noticed() -> None:
    with pytest.raises(CorruptArtifact):
        envelope.unpack("image", envelope.pack("image", ARRAYS, META) + b"x")


def test_another_kind_is_refused_by_name() -> None:
    with pytest.raises(CorruptArtifact, match="holds 'layer' where 'image' was expected"):
        envelope.unpack("image", envelope.pack("layer", ARRAYS, META))


@pytest.mark.parametrize(("checksum", "size"), [(False, True), (True, False)])
def test_a_frame_without_checksum_or_size_is_refused(checksum: bool, size: bool) -> None:
    raw = zstandard.ZstdDecompressor().decompress(envelope.pack("image", ARRAYS, META))
    with pytest.raises(CorruptArtifact, match="states no"):
        envelope.unpack("image", _frame(raw, checksum=checksum, size=size))


def test_a_frame_that_states_more_than_the_limit_is_refused_before_it_is_decompressed() -> None:
    # A zstd frame header by hand (RFC 8878, 3.1.1): magic, descriptor (8-byte size, single segment, checksum), size.
    bomb = b"\x28\xb5\x2f\xfd" + bytes([0b11100100]) + struct.pack("<Q", 1 << 50) + b"\x01\x00\x00"
    with pytest.raises(CorruptArtifact, match="limit"):
        envelope.unpack("image", bomb)


@pytest.mark.parametrize(
    ("header", "body"),
    [
        (_header({"dtype": "U8", "shape": [4], "data_offsets": [0, 3]}), b"abc"),  # shape larger than the data
        (_header({"dtype": "U8", "shape": [1 << 40, 1 << 40], "data_offsets": [0, 3]}), b"abc"),
        (_header({"dtype": "U8", "shape": [-3, -1], "data_offsets": [0, 3]}), b"abc"),
        (_header({"dtype": "U8", "shape": [3], "data_offsets": [0, 3]}), b"ab"),  # data missing
        (_header({"dtype": "U8", "shape": [3], "data_offsets": [1, 4]}), b"abcd"),  # a gap
        (_header({"dtype": "U8", "shape": [3], "data_offsets": [0, 3]}), b"abcd"),  # data of nobody
        (_header({"dtype": "BOOL", "shape": [3], "data_offsets": [0, 3]}), b"abc"),  # a type that is never written
        (_header({"dtype": "U8", "shape": [1.5], "data_offsets": [0, 3]}), b"abc"),
        (_header({"dtype": "U8", "shape": 3, "data_offsets": [0, 3]}), b"abc"),
        (_header({"shape": [3]}), b"abc"),
        (_header(7), b"abc"),
        ({"pixels": {"dtype": "U8", "shape": [3], "data_offsets": [0, 3]}}, b"abc"),  # no metadata
        ({"__metadata__": {"valerie": "[]"}}, b""),
        ([], b""),
    ],
)
def test_a_lying_header_is_refused(header: object, body: bytes) -> None:
    with pytest.raises(CorruptArtifact):
        envelope.unpack("image", _frame(_raw(header, body)))


@pytest.mark.parametrize("raw", [b"", b"1234567", struct.pack("<Q", 1 << 63) + b"{}", struct.pack("<Q", 9) + b"{}"])
def test_a_header_length_beyond_the_content_is_refused(raw: bytes) -> None:
    with pytest.raises(CorruptArtifact):
        envelope.unpack("image", _frame(raw))


def test_bytes_that_are_no_frame_are_refused() -> None:
    with pytest.raises(CorruptArtifact, match="artifact: "):
        envelope.unpack("layer", b"junk")
