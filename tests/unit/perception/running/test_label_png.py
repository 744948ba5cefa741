import struct
import zlib
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from valerie.errors import InvalidInput
from valerie.perception.running.label_png import decode_labels, encode_png, max_label_bytes

LABELS = np.arange(6 * 9, dtype=np.uint8).reshape(6, 9)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, *, depth: int = 8, colour: int = 0, data: bytes = b"", before: bytes = b"") -> bytes:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + before + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def saved(image: Image.Image, **options: object) -> bytes:
    stream = BytesIO()
    image.save(stream, "PNG", **options)
    return stream.getvalue()


def test_labels_survive_png() -> None:
    np.testing.assert_array_equal(decode_labels(encode_png(LABELS), 6, 9), LABELS)


def test_a_palette_counts_by_index_and_not_by_colour() -> None:
    image = Image.frombytes("P", (9, 6), LABELS.tobytes())
    image.putpalette([255 - value // 3 for value in range(768)])
    np.testing.assert_array_equal(decode_labels(saved(image, bits=8), 6, 9), LABELS)


@pytest.mark.parametrize(("width", "height"), [(1 << 30, 1 << 30), (9, 7), (6, 9)])
def test_another_size_is_refused_before_anything_is_allocated(width: int, height: int) -> None:
    with pytest.raises(InvalidInput, match=f"got {width} × {height}; limit: 9 × 6"):
        decode_labels(png(width, height), 6, 9)


def test_pixels_that_unpack_to_gigabytes_are_not_unpacked() -> None:
    import resource

    unpacked = 60 << 20
    bomb = png(9, 6, data=b"\0" * unpacked)  # 60 kB of file
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InvalidInput, match="got more than 60 bytes; limit: 60 bytes"):
        decode_labels(bomb, 6, 9)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < unpacked / 1024 / 2


def test_texts_and_profiles_are_never_unpacked() -> None:
    text = chunk(b"zTXt", b"key\0\0" + zlib.compress(b"x" * (50 << 20)))
    profile = chunk(b"iCCP", b"name\0\0" + b"broken")
    rows = b"".join(b"\0" + bytes(row) for row in LABELS)
    np.testing.assert_array_equal(decode_labels(png(9, 6, data=rows, before=text + profile), 6, 9), LABELS)


def test_a_file_larger_than_any_label_map_is_refused() -> None:
    with pytest.raises(InvalidInput, match="too large"):
        decode_labels(b"\x89PNG\r\n\x1a\n" + b"\0" * max_label_bytes(6, 9), 6, 9)


def test_the_limit_holds_the_worst_case() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (300, 500), dtype=np.uint8)
    assert len(saved(Image.fromarray(noise), compress_level=0)) <= max_label_bytes(300, 500)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA", "1", "I;16"])
def test_pixels_of_more_or_less_than_a_byte_are_refused(mode: str) -> None:
    with pytest.raises(InvalidInput, match="one byte"):
        decode_labels(saved(Image.new(mode, (9, 6))), 6, 9)


@pytest.mark.parametrize("data", [b"", b"GIF89a", b"\x89PNG\r\n\x1a\n", b"\x80\x04pickle", encode_png(LABELS)[:40]])
def test_something_else_is_refused(data: bytes) -> None:
    with pytest.raises(InvalidInput, match="PNG"):
        decode_labels(data, 6, 9)


def test_pixels_that_are_cut_off_are_refused() -> None:
    with pytest.raises(InvalidInput, match="got 20 bytes; limit: 60 bytes"):
        decode_labels(png(9, 6, data=b"\0" * 20), 6, 9)


def test_a_changed_byte_is_noticed() -> None:
    data = bytearray(encode_png(LABELS))
    data[-20] ^= 1
    with pytest.raises(InvalidInput, match="damaged PNG"):
        decode_labels(bytes(data), 6, 9)


def test_interlaced_rows_are_refused() -> None:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 9, 6, 8, 0, 0, 0, 1))
    data = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"\0" * 60)) + chunk(b"IEND", b"")
    with pytest.raises(InvalidInput, match="interlaced"):
        decode_labels(data, 6, 9)
