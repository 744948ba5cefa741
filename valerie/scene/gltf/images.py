"""Decode PNG and JPEG, encode PNG. A round trip through PNG keeps every texel."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.scene.gltf.common import MAX_IMAGE_SIDE


def decode_image(data: bytes, *, field: str) -> NDArray[np.uint8]:
    """Decode an image to (H, W, 3) or (H, W, 4) uint8, first row at the top; grey becomes RGB, 16 bits become 8.

    Raises:
        InvalidInput: the data is neither PNG nor JPEG, is broken, or is larger than `MAX_IMAGE_SIDE`.
    """
    import cv2

    width, height = image_size(data, field=field)
    if not (0 < width <= MAX_IMAGE_SIDE and 0 < height <= MAX_IMAGE_SIDE):
        raise InvalidInput(
            "the image is too large", field=field, value=f"{width} × {height}", limit=f"{MAX_IMAGE_SIDE} a side"
        )
    decoded: NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None:
        raise InvalidInput("the image cannot be decoded", field=field, value=f"{len(data)} bytes")
    if decoded.dtype == np.uint16:
        decoded = (decoded // 257).astype(np.uint8)
    if decoded.dtype != np.uint8:
        raise InvalidInput("not an image with 8 or 16 bits per channel", field=field, value=str(decoded.dtype))
    if decoded.ndim == 2:
        decoded = np.repeat(decoded[:, :, None], 3, axis=2)
    order = [2, 1, 0, 3][: decoded.shape[2]]
    return np.ascontiguousarray(decoded[:, :, order])


def encode_png(image: NDArray[np.uint8]) -> bytes:
    """Encode (H, W, 3) or (H, W, 4) uint8 as PNG."""
    import cv2

    order = [2, 1, 0, 3][: image.shape[2]]
    success, data = cv2.imencode(".png", np.ascontiguousarray(image[:, :, order]), [cv2.IMWRITE_PNG_COMPRESSION, 4])
    if not success:
        raise InvalidInput("the image cannot be written as PNG", value=str(image.shape))
    return bytes(data)


def image_size(data: bytes, *, field: str) -> tuple[int, int]:
    """Return width and height from the header of a PNG or JPEG, without decoding it."""
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return int(width), int(height)
    if data[:2] == b"\xff\xd8":
        position = 2
        while position + 9 <= len(data) and data[position] == 0xFF:
            marker = data[position + 1]
            if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
                height, width = struct.unpack_from(">HH", data, position + 5)
                return int(width), int(height)
            position += 2 + int(struct.unpack_from(">H", data, position + 2)[0])
    raise InvalidInput("neither a PNG nor a JPEG with a readable header", field=field, value=f"{len(data)} bytes")
