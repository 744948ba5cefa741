"""Encode and decode products, bit for bit.

Decoding checks every dtype and shape before anything is built from them, so that a swapped, truncated or forged object raises
`CorruptArtifact` and never gives a wrong result. Decoded arrays are read-only.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import DTypeLike, NDArray

from valerie.errors import CorruptArtifact
from valerie.plain import JsonObject
from valerie.rendering.base import GroundTruth, Layer, LinearImage, PersonTruth, Rectangle, TruthLayer
from valerie.storage import envelope


def encode_image(image: LinearImage) -> bytes:
    """Pack a linear image: ``planes`` (2, H, W, 3) uint8, the low and the high bytes of its float16 pixels.

    Apart, they compress to three quarters: neighbours share the high byte, which has sign, exponent and two bits.
    """
    return envelope.pack("image", {"planes": _split(image.pixels)}, {})


def decode_image(data: bytes) -> LinearImage:
    """Read an image that `encode_image` packed.

    Raises:
        CorruptArtifact: not a whole, consistent image.
    """
    arrays, _ = envelope.unpack("image", data)
    return LinearImage(_pixels(arrays, None, None))


def encode_layer(layer: Layer) -> bytes:
    """Pack a layer: its pixels, as in `encode_image`, and its rectangle (x, y, w, h)."""
    box = layer.rectangle
    meta: JsonObject = {"rectangle": [box.x, box.y, box.width, box.height]}
    return envelope.pack("layer", {"planes": _split(layer.pixels)}, meta)


def decode_layer(data: bytes) -> Layer:
    """Read a layer that `encode_layer` packed.

    Raises:
        CorruptArtifact: not a whole, consistent layer.
    """
    arrays, meta = envelope.unpack("layer", data)
    rectangle = _rectangle(meta.get("rectangle"))
    return Layer(rectangle, _pixels(arrays, rectangle.height, rectangle.width))


def encode_truth(truth: GroundTruth) -> bytes:
    """Encode class map, instance map, depth and amodal masks. A mask is packed as bits within its person's box."""
    arrays: dict[str, NDArray[Any]] = {
        "class_map": truth.class_map,
        "instance_map": truth.instance_map,
        "depth": truth.depth,
    }
    return envelope.pack("truth", arrays, {"persons": _pack_persons(truth.persons, arrays)})


def decode_truth(data: bytes) -> GroundTruth:
    """Read a truth that `encode_truth` packed.

    Raises:
        CorruptArtifact: not a whole, consistent truth.
    """
    return _truth(*envelope.unpack("truth", data))


def encode_truth_layer(layer: TruthLayer, statics: str) -> bytes:
    """Pack the changes that movables make: rectangle, changed pixels as bits, their values, the persons' masks.

    Args:
        layer: the changes.
        statics: digest of the truth below the layer (`statics_digest`).
    """
    box = layer.rectangle
    arrays: dict[str, NDArray[Any]] = {
        "changed": np.packbits(layer.changed),
        "classes": layer.classes,
        "instances": layer.instances,
        "depths": layer.depths,
    }
    meta: JsonObject = {
        "statics": statics,
        "rectangle": [box.x, box.y, box.width, box.height],
        "size": list(layer.size),
    }
    return envelope.pack("truth-layer", arrays, meta | {"persons": _pack_persons(layer.persons, arrays)})


@dataclass(frozen=True, slots=True)
class StoredTruthLayer:
    """A stored layer, and the digest of the truth below it."""

    layer: TruthLayer
    statics: str


def decode_stored_truth(data: bytes) -> GroundTruth | StoredTruthLayer:
    """Read a stored truth: a whole one, or a layer over the truth of the statics.

    Raises:
        CorruptArtifact: neither, or inconsistent.
    """
    arrays, meta = envelope.unpack(("truth", "truth-layer"), data)
    if meta["kind"] == "truth":
        return _truth(arrays, meta)
    statics, whole = meta.get("statics"), meta.get("size")
    if not isinstance(statics, str) or not isinstance(whole, list):
        raise _corrupt("the layer does not name the truth below it")
    image, box = _rectangle([0, 0, *whole[::-1]]), _rectangle(meta.get("rectangle"))
    size = (image.height, image.width)
    if box != box.clipped(image.width, image.height):
        raise _corrupt(f"the layer leaves the image: {box}")
    changed = _mask(arrays, "changed", box)
    count = (int(np.count_nonzero(changed)),)
    layer = TruthLayer(
        box,
        changed,
        _array(arrays, "classes", np.uint8, count),
        _array(arrays, "instances", np.uint16, count),
        _array(arrays, "depths", np.float32, count),
        _unpack_persons(arrays, meta, size),
        size,
    )
    return StoredTruthLayer(layer, statics)


def statics_digest(statics: GroundTruth) -> str:
    """Return the digest, 32 hexadecimal characters, of the content of a truth of statics."""
    content = hashlib.sha256(repr(statics.class_map.shape).encode())
    for array in (statics.class_map, statics.instance_map, statics.depth):
        content.update(np.ascontiguousarray(array).tobytes())
    return content.hexdigest()[:32]


def encode_prediction(train_ids: NDArray[np.uint8]) -> bytes:
    """Pack a prediction: (H, W) uint8 train ids."""
    return envelope.pack("prediction", {"train_ids": train_ids}, {})


def decode_prediction(data: bytes) -> NDArray[np.uint8]:
    """Read a prediction that `encode_prediction` packed.

    Raises:
        CorruptArtifact: not a whole, consistent prediction.
    """
    arrays, _ = envelope.unpack("prediction", data)
    return _array(arrays, "train_ids", np.uint8, (None, None))


def encode_counts(counts: NDArray[np.int64]) -> bytes:
    """Pack a confusion matrix: (rows, columns) int64 pixel counts."""
    return envelope.pack("counts", {"counts": counts}, {})


def decode_counts(data: bytes) -> NDArray[np.int64]:
    """Read a matrix that `encode_counts` packed.

    Raises:
        CorruptArtifact: not a whole, consistent matrix.
    """
    arrays, _ = envelope.unpack("counts", data)
    return _array(arrays, "counts", np.int64, (None, None))


def _split(pixels: NDArray[np.float16]) -> NDArray[np.uint8]:
    bits = pixels.view(np.uint16)
    return np.stack([bits & 0xFF, bits >> 8]).astype(np.uint8)


def _pixels(arrays: dict[str, NDArray[Any]], height: int | None, width: int | None) -> NDArray[np.float16]:
    if "pixels" in arrays:  # as release 0.1.0 stored them
        return _array(arrays, "pixels", np.float16, (height, width, 3))
    low, high = _array(arrays, "planes", np.uint8, (2, height, width, 3)).astype(np.uint16)
    pixels: NDArray[np.float16] = (low | high << 8).view(np.float16)
    pixels.flags.writeable = False
    return pixels


def _array(arrays: dict[str, NDArray[Any]], name: str, dtype: DTypeLike, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return the named array; ``None`` in ``shape`` stands for any length."""
    array = arrays.get(name)
    if array is None:
        raise _corrupt(f"there is no array {name!r}")
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    if array.dtype != np.dtype(dtype) or not fits:
        expected = tuple("any" if length is None else length for length in shape)
        raise _corrupt(f"{name} is {array.dtype} {array.shape}, expected {np.dtype(dtype)} {expected}")
    return array


def _truth(arrays: dict[str, NDArray[Any]], meta: JsonObject) -> GroundTruth:
    class_map = _array(arrays, "class_map", np.uint8, (None, None))
    size = class_map.shape
    return GroundTruth(
        class_map=class_map,
        instance_map=_array(arrays, "instance_map", np.uint16, size),
        depth=_array(arrays, "depth", np.float32, size),
        persons=_unpack_persons(arrays, meta, size),
    )


class _PersonEntry(NamedTuple):
    """A person in the metadata of a truth."""

    instance_id: int
    padded_pixels: int
    x: int
    y: int
    width: int
    height: int

    @property
    def mask(self) -> str:
        """Name of the array with the person's mask."""
        return f"amodal.{self.instance_id}"


def _pack_persons(persons: Sequence[PersonTruth], arrays: dict[str, NDArray[Any]]) -> list[list[int]]:
    """Add the persons' masks to ``arrays``; return a `_PersonEntry` for each person."""
    entries: list[list[int]] = []
    for person in persons:
        box = person.box
        entry = _PersonEntry(person.instance_id, person.padded_pixels, box.x, box.y, box.width, box.height)
        arrays[entry.mask] = np.packbits(person.mask)
        entries.append(list(entry))
    return entries


def _unpack_persons(
    arrays: dict[str, NDArray[Any]], meta: JsonObject, size: tuple[int, ...]
) -> tuple[PersonTruth, ...]:
    persons: list[PersonTruth] = []
    entries = meta.get("persons")
    if not isinstance(entries, list):
        raise _corrupt("the persons are not a list")
    for numbers in entries:
        if not _counts(numbers, len(_PersonEntry._fields)):
            raise _corrupt(f"not a person: {numbers!r}")
        entry = _PersonEntry(*numbers)
        if persons and entry.instance_id <= persons[-1].instance_id:
            raise _corrupt(f"instance {entry.instance_id} is out of order")
        box = Rectangle(entry.x, entry.y, entry.width, entry.height)
        if box.x + box.width > size[1] or box.y + box.height > size[0]:
            raise _corrupt(f"the mask of instance {entry.instance_id} leaves the image")
        mask = _mask(arrays, entry.mask, box)
        persons.append(PersonTruth(entry.instance_id, box, mask, entry.padded_pixels, (size[0], size[1])))
    return tuple(persons)


def _mask(arrays: dict[str, NDArray[Any]], name: str, box: Rectangle) -> NDArray[np.bool_]:
    """Unpack a mask stored as bits: (box.height, box.width) bool."""
    count = box.width * box.height
    bits = _array(arrays, name, np.uint8, ((count + 7) // 8,))
    return np.unpackbits(bits, count=count).reshape(box.height, box.width).view(np.bool_)


def _rectangle(values: object) -> Rectangle:
    if not _counts(values, 4):
        raise _corrupt(f"not a rectangle: {values!r}")
    return Rectangle(*values)


def _counts(values: object, length: int) -> TypeGuard[list[int]]:
    """Return True for a list of this many integers from 0."""
    return isinstance(values, list) and len(values) == length and all(isinstance(n, int) and n >= 0 for n in values)


def _corrupt(message: str) -> CorruptArtifact:
    return CorruptArtifact(f"artifact: {message}")
