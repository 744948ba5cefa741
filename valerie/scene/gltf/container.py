"""A glTF document and its buffers, checked before they are used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import cattrs
import numpy as np
import pygltflib
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.plain import Json, JsonObject
from valerie.scene.gltf.common import MAX_NODES, MAX_VERTICES, SUPPORTED_EXTENSIONS
from valerie.scene.gltf.files import Resources, open_document

_COMPONENTS: Final[dict[int, np.dtype[Any]]] = {
    pygltflib.BYTE: np.dtype("<i1"),
    pygltflib.UNSIGNED_BYTE: np.dtype("<u1"),
    pygltflib.SHORT: np.dtype("<i2"),
    pygltflib.UNSIGNED_SHORT: np.dtype("<u2"),
    pygltflib.UNSIGNED_INT: np.dtype("<u4"),
    pygltflib.FLOAT: np.dtype("<f4"),
}
#: Reads JSON into the library's classes several times faster than the library itself.
_CONVERTER: Final = cattrs.Converter(detailed_validation=False)
_CONVERTER.register_structure_hook(pygltflib.Attributes, lambda plain, _: pygltflib.Attributes(**plain))
_WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}

Item = TypeVar("Item")


class Container:
    """A parsed file and its buffers.

    Attributes:
        document: the JSON part.
        name: file name, for messages.
    """

    def __init__(self, document: pygltflib.GLTF2, binary: bytes | None, name: str, resources: Resources) -> None:
        self.document, self.name, self._resources = document, name, resources
        self._buffers = _buffers(document, binary, name, resources)

    def view(self, index: int) -> bytes:
        """Return the bytes of a buffer view."""
        data, start, length, _ = self._view(index)
        return data[start : start + length]

    def resource(self, uri: str, *, field: str) -> bytes:
        """Return the bytes behind a URI of this file."""
        return self._resources.read(uri, field=field)

    def _view(self, index: int) -> tuple[bytes, int, int, int | None]:
        view = item(self.document.bufferViews, index, f"{self.name}: bufferViews")
        data = item(self._buffers, view.buffer, f"{self.name}: buffers")
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
        """Return an accessor as a contiguous array: (count,) for SCALAR, else (count, 2 … 4), in its own component type.

        Args:
            kind: the expected type, ``SCALAR``, ``VEC2`` …
        """
        field = f"{self.name}: accessors.{index}"
        accessor = item(self.document.accessors, index, f"{self.name}: accessors")
        if accessor.sparse is not None:
            raise InvalidInput("sparse accessors are not supported; export without them", field=field)
        if accessor.type != kind or accessor.componentType not in _COMPONENTS:
            raise InvalidInput("not of the expected type", field=field, value=accessor.type, limit=kind)
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
        elements = strided.copy()
        return elements[:, 0] if width == 1 else elements


def open_container(path: Path, root: Path | None = None) -> Container:
    """Read a .glb or .gltf with the files that it refers to.

    Args:
        root: folder that no reference may lead out of; by default the file's own.

    Raises:
        InvalidInput: the file is too large, truncated, not glTF 2.0 or requires an unknown extension, or a file that it refers
            to is missing or outside.
    """
    plain, binary = open_document(path)
    return Container(_parse(plain, path.name), binary, path.name, Resources(path, root))


def _list(plain: JsonObject, name: str) -> Sequence[Json]:
    entries = plain.get(name) or []
    if not isinstance(entries, list):
        raise TypeError(f"{name} is not a list")
    return entries


def _parse(plain: JsonObject, name: str) -> pygltflib.GLTF2:
    try:
        unsupported = sorted({str(name) for name in _list(plain, "extensionsRequired")} - SUPPORTED_EXTENSIONS)
        if unsupported:
            raise InvalidInput(
                "the file requires extensions that are not supported; export without them",
                field=f"{name}: extensionsRequired",
                value=", ".join(unsupported),
                limit=", ".join(sorted(SUPPORTED_EXTENSIONS)),
            )
        nodes = len(_list(plain, "nodes"))
        if nodes > MAX_NODES:
            raise InvalidInput("too many nodes", field=f"{name}: nodes", value=nodes, limit=MAX_NODES)
        fields = {key: value for key, value in plain.items() if value is not None}
        return _CONVERTER.structure(fields, pygltflib.GLTF2)
    except (TypeError, ValueError, KeyError, AttributeError, RecursionError) as error:
        raise InvalidInput(f"the JSON is not glTF: {error}", field=name) from None


def _buffers(document: pygltflib.GLTF2, binary: bytes | None, name: str, resources: Resources) -> list[bytes]:
    buffers = []
    for index, buffer in enumerate(document.buffers):
        field = f"{name}: buffers.{index}"
        if buffer.uri is None:
            if index or binary is None:
                raise InvalidInput("the buffer has no data", field=field)
            data = binary
        else:
            data = resources.read(buffer.uri, field=f"{field}.uri")
        if len(data) < int(buffer.byteLength):
            raise InvalidInput(
                "the file is truncated: the buffer is shorter than declared",
                field=field,
                value=f"{len(data)} bytes",
                limit=f"{buffer.byteLength} bytes",
            )
        buffers.append(data)
    return buffers


def item(items: Sequence[Item], index: Any, field: str) -> Item:
    """Return the item that an index of the file refers to.

    Args:
        items: the list that the index refers to.
        index: a value from the file.
        field: field of the list, or of the reference, for the error.

    Raises:
        InvalidInput: the index is not a whole number, or out of range.
    """
    if not isinstance(index, int) or not 0 <= index < len(items):
        valid = f"0…{len(items) - 1}" if items else "there are none"
        raise InvalidInput("refers to something that is not there", field=field, value=index, limit=valid)
    return items[index]
