"""Untrusted label maps as PNG, checked before memory is allocated for them.

A PNG of a few kilobytes can state a size of gigapixels, or contain text and profiles that unpack to gigabytes. So the header
is compared with the frame first, and the decoder sees only the chunks with pixels.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from valerie.errors import InvalidInput

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
#: Colour types with one byte per pixel: grey levels, and indices into a palette.
_GREY, _PALETTE = 0, 3
_PIXEL_CHUNKS: Final = (b"IHDR", b"PLTE", b"IDAT", b"IEND")


def max_label_bytes(height: int, width: int) -> int:
    """Return the largest file size of a label map: uncompressed, with room for other chunks."""
    return height * (width + 1) + height * width // 100 + 65_536


def decode_labels(data: bytes, height: int, width: int, *, field: str = "labels") -> NDArray[np.uint8]:
    """Read the label map of a frame.

    Args:
        data: PNG with 8 bits per pixel, grey or with a palette; a pixel's value (index into the palette) is its id.
        height, width: size of the frame.
        field: source of the data, for errors.

    Returns:
        (height, width) uint8.

    Raises:
        InvalidInput: the file is not such a PNG, has another size than the frame, exceeds `max_label_bytes`, or is damaged.
    """
    limit = max_label_bytes(height, width)
    if len(data) > limit:
        raise InvalidInput("the file is too large", field=field, value=f"{len(data)} bytes", limit=f"{limit} bytes")
    pixels_alone = _pixel_chunks(data, field)
    png_width, png_height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", pixels_alone[16:29])
    if (png_height, png_width) != (height, width):
        raise InvalidInput(
            "another size than the frame's",
            field=field,
            value=f"{png_width} × {png_height}",
            limit=f"{width} × {height}",
        )
    if depth != 8 or colour not in (_GREY, _PALETTE) or interlaced:
        raise InvalidInput(
            "a pixel must be one byte, rows from top to bottom",
            field=field,
            value=f"{depth} bits of colour type {colour}{', interlaced' if interlaced else ''}",
            limit="8 bits, grey (0) or palette (3), not interlaced",
        )
    _require_rows(pixels_alone, height, width, field)
    try:
        with Image.open(BytesIO(pixels_alone), formats=["PNG"]) as image:
            return np.array(image, np.uint8)
    except (OSError, SyntaxError, ValueError) as error:
        raise InvalidInput(f"a damaged PNG ({error})", field=field) from None


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return the PNG of (H, W) grey or (H, W, 3) sRGB pixels, uint8."""
    stream = BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(stream, "PNG", compress_level=1)
    return stream.getvalue()


def _require_rows(png: bytes, height: int, width: int, field: str) -> None:
    """Refuse missing rows: decoders fill them with zeros, which are valid ids."""
    size = height * (width + 1)  # each row begins with a byte that names its filter
    compressed = b"".join(data for kind, data in _chunks(png, field) if kind == b"IDAT")
    try:
        length = len(zlib.decompressobj().decompress(compressed, size + 1))
    except zlib.error as error:
        raise InvalidInput(f"a damaged PNG ({error})", field=field) from None
    if length != size:
        count = f"{length} bytes" if length < size else f"more than {size} bytes"
        raise InvalidInput(
            "a damaged PNG (its rows are not those of its size)", field=field, value=count, limit=f"{size} bytes"
        )


def _pixel_chunks(data: bytes, field: str) -> bytes:
    """Return the file with only the chunks that define pixels; it begins with signature and IHDR."""
    chunks = [_SIGNATURE]
    for kind, content in _chunks(data, field):
        if (len(chunks) == 1) != (kind == b"IHDR") or (kind == b"IHDR" and len(content) != 13):
            raise InvalidInput("a damaged PNG (it does not begin with one header)", field=field)
        if kind in _PIXEL_CHUNKS:
            chunks.append(
                struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
            )
    return b"".join(chunks)


def _chunks(data: bytes, field: str) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of each chunk up to IEND; checksums are verified."""
    if not data.startswith(_SIGNATURE):
        raise InvalidInput("not a PNG", field=field)
    place = len(_SIGNATURE)
    kind = b""
    while kind != b"IEND":
        if place + 12 > len(data):
            raise InvalidInput("a damaged PNG (its chunks do not end)", field=field)
        (length,) = struct.unpack_from(">I", data, place)
        kind, content = data[place + 4 : place + 8], data[place + 8 : place + 8 + length]
        place += 12 + length
        if place > len(data) or int.from_bytes(data[place - 4 : place], "big") != zlib.crc32(kind + content):
            raise InvalidInput("a damaged PNG (a chunk is cut off or changed)", field=field)
        yield kind, content
