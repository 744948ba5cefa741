"""Opening a glTF file: header, chunks, JSON and buffers, checked before they are trusted."""

from __future__ import annotations

import base64
import binascii
import json
import struct
import warnings
from pathlib import Path
from typing import Any, Final

import numpy as np
import pygltflib
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.scene.gltf.common import MAX_FILE_BYTES, MAX_NODES, MAX_VERTICES, SUPPORTED_EXTENSIONS

_JSON_CHUNK: Final = 0x4E4F534A
_BINARY_CHUNK: Final = 0x004E4942

_COMPONENTS: Final[dict[int, np.dtype[Any]]] = {
    pygltflib.BYTE: np.dtype("<i1"),
    pygltflib.UNSIGNED_BYTE: np.dtype("<u1"),
    pygltflib.SHORT: np.dtype("<i2"),
    pygltflib.UNSIGNED_SHORT: np.dtype("<u2"),
    pygltflib.UNSIGNED_INT: np.dtype("<u4"),
    pygltflib.FLOAT: np.dtype("<f4"),
}
_WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Container:
    """A parsed file and its buffers.

    Attributes:
        document: the JSON part.
        name: file name, for messages.
    """

    def __init__(self, document: pygltflib.GLTF2, buffers: list[bytes], name: str) -> None:
        self.document, self.name, self._buffers = document, name, buffers

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view."""
        data, start, length, _ = self._view(index)
        return data[start : start + length]

    def _view(self, index: int) -> tuple[bytes, int, int, int | None]:
        view = _item(self.document.bufferViews, index, f"{self.name}: bufferViews")
        data = _item(self._buffers, view.buffer, f"{self.name}: buffers")
        start, length = int(view.byteOffset or 0), int(view.byteLength)
        if start < 0 or length < 0 or start + length > len(data):
            raise InvalidInput(
                "the buffer view reaches beyond its buffer",
                field=f"{self.name}: bufferViews.{index}",
                value=f"{start} + {length} bytes",
                limit=f"{len(data)} bytes",
            )
        return data, start, length, view.byteStride

    def array(self, index: int, *, kind: str) -> NDArray[Any]:
        """An accessor as a contiguous array: (count,) for SCALAR, else (count, 2 … 4), in its own component type.

        Args:
            index: of the accessor.
            kind: ``SCALAR``, ``VEC2`` … that is expected.
        """
        field = f"{self.name}: accessors.{index}"
        accessor = _item(self.document.accessors, index, f"{self.name}: accessors")
        if accessor.sparse is not None:
            raise InvalidInput("sparse accessors are not read; export without them", field=field)
        if accessor.type != kind or accessor.componentType not in _COMPONENTS:
            raise InvalidInput("another type than expected", field=field, value=accessor.type, limit=kind)
        dtype, width, count = _COMPONENTS[accessor.componentType], _WIDTHS[kind], int(accessor.count)
        if not 0 <= count <= 3 * MAX_VERTICES:
            raise InvalidInput("too many elements", field=field, value=count, limit=3 * MAX_VERTICES)
        if accessor.bufferView is None:
            return np.zeros((count,) if width == 1 else (count, width), dtype)
        data, start, length, stride = self._view(accessor.bufferView)
        element, offset = dtype.itemsize * width, int(accessor.byteOffset or 0)
        step = int(stride or element)
        if step < element or offset < 0 or (count and offset + (count - 1) * step + element > length):
            raise InvalidInput(
                "the accessor reaches beyond its buffer view",
                field=field,
                value=f"{count} elements",
                limit=f"{length} bytes",
            )
        strided: NDArray[Any] = np.ndarray(
            (count, width), dtype, buffer=data, offset=start + offset, strides=(step, dtype.itemsize)
        )
        copied = strided.copy()
        return copied[:, 0] if width == 1 else copied


def open_container(path: Path) -> Container:
    """Read a .glb, or a .gltf whose buffers are embedded.

    Raises:
        InvalidInput: too large, truncated, not glTF 2.0, requires an unknown extension, or refers to other files.
    """
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise InvalidInput("the file is too large", field=path.name, value=f"{size} bytes", limit=MAX_FILE_BYTES)
    raw = path.read_bytes()
    text, binary = _chunks(raw, path.name) if path.suffix.lower() == ".glb" else (raw, None)
    document = _parse(text, path.name)
    return Container(document, _buffers(document, binary, path.name), path.name)


def _chunks(raw: bytes, name: str) -> tuple[bytes, bytes | None]:
    """JSON and binary chunk of a .glb (glTF 2.0, section 4.4)."""
    if len(raw) < 20 or raw[:4] != b"glTF":
        raise InvalidInput("not a binary glTF file", field=name, value=f"{len(raw)} bytes", limit="starts with glTF")
    version, length = struct.unpack_from("<II", raw, 4)
    if version != 2:
        raise InvalidInput("another version of glTF", field=name, value=version, limit=2)
    if length > len(raw):
        raise InvalidInput(
            "the file is truncated", field=name, value=f"{len(raw)} bytes", limit=f"its header promises {length}"
        )
    chunks: dict[int, bytes] = {}
    position = 12
    while position + 8 <= length:
        size, kind = struct.unpack_from("<II", raw, position)
        position += 8
        if position + size > length:
            raise InvalidInput(
                "the file is truncated inside a chunk",
                field=name,
                value=f"{length - position} bytes",
                limit=f"the chunk promises {size}",
            )
        chunks.setdefault(kind, raw[position : position + size])
        position += size
    if _JSON_CHUNK not in chunks:
        raise InvalidInput("no JSON chunk", field=name)
    return chunks[_JSON_CHUNK], chunks.get(_BINARY_CHUNK)


def _parse(text: bytes, name: str) -> pygltflib.GLTF2:
    try:
        plain = json.loads(text.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"not readable as JSON: {error}", field=name) from None
    version = plain.get("asset", {}).get("version") if isinstance(plain, dict) else None
    if not isinstance(version, str) or not version.startswith("2."):
        raise InvalidInput("not glTF 2.0", field=f"{name}: asset.version", value=version)
    unsupported = sorted(set(plain.get("extensionsRequired", [])) - SUPPORTED_EXTENSIONS)
    if unsupported:
        raise InvalidInput(
            "the file requires extensions that are not read; export without them",
            field=f"{name}: extensionsRequired",
            value=", ".join(map(str, unsupported)),
            limit=", ".join(sorted(SUPPORTED_EXTENSIONS)),
        )
    if len(plain.get("nodes", [])) > MAX_NODES:
        raise InvalidInput("too many nodes", field=f"{name}: nodes", value=len(plain["nodes"]), limit=MAX_NODES)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the library warns of nulls that the format allows
            document = pygltflib.GLTF2.gltf_from_json(text.decode("utf-8"))
    except (TypeError, ValueError, KeyError, AttributeError, RecursionError) as error:
        raise InvalidInput(f"the JSON is not glTF: {error}", field=name) from None
    assert isinstance(document, pygltflib.GLTF2)
    return document


def _buffers(document: pygltflib.GLTF2, binary: bytes | None, name: str) -> list[bytes]:
    for index, image in enumerate(document.images):
        if image.uri is not None and not image.uri.startswith("data:"):
            _refuse_uri(image.uri, f"{name}: images.{index}.uri")
    buffers = []
    for index, buffer in enumerate(document.buffers):
        field = f"{name}: buffers.{index}"
        if buffer.uri is None:
            if index or binary is None:
                raise InvalidInput("the buffer has no data", field=field)
            data = binary
        else:
            data = decode_data_uri(buffer.uri, f"{field}.uri")
        if len(data) < int(buffer.byteLength):
            raise InvalidInput(
                "the file is truncated: the buffer is shorter than it says",
                field=field,
                value=f"{len(data)} bytes",
                limit=f"{buffer.byteLength} bytes",
            )
        buffers.append(data)
    return buffers


def decode_data_uri(uri: str, field: str) -> bytes:
    """The bytes of a ``data:…;base64,…`` URI; any other URI is refused, since assets are self-contained."""
    head, comma, body = uri.partition(",")
    if not head.startswith("data:") or not comma or not head.endswith(";base64"):
        _refuse_uri(uri, field)
    try:
        return base64.b64decode(body, validate=True)
    except binascii.Error:
        raise InvalidInput("not valid base64", field=field) from None


def _refuse_uri(uri: str, field: str) -> None:
    raise InvalidInput(
        "external URIs are refused; embed the data", field=field, value=uri[:80], limit="data:…;base64,…"
    )


def _item(items: list[Any], index: Any, field: str) -> Any:
    if not isinstance(index, int) or not 0 <= index < len(items):
        raise InvalidInput(
            "refers to something that is not there", field=field, value=index, limit=f"0…{len(items) - 1}"
        )
    return items[index]
