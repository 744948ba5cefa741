"""What is stored of each kind of product: arrays to bytes and back, exactly, bit for bit.

Decoding checks every dtype and shape before anything is built from them, so that a swapped, truncated
or forged object is a `CorruptArtifact` and never a wrong result. Decoded arrays are read-only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from valerie.errors import CorruptArtifact
from valerie.rendering.base import GroundTruth, Layer, LinearImage, PersonTruth, Rectangle
from valerie.scene.model import freeze
from valerie.storage import frames


def encode_image(image: LinearImage) -> bytes:
    """A linear image: ``pixels`` (H, W, 3) float16."""
    return frames.pack("image", {"pixels": image.pixels}, {})


def decode_image(data: bytes, *, key: str = "") -> LinearImage:
    """The inverse of `encode_image`.

    Raises:
        CorruptArtifact: not a whole, consistent image.
    """
    arrays, _ = frames.unpack("image", data, key=key)
    return LinearImage(_array(arrays, "pixels", np.float16, (None, None, 3), key))


def encode_layer(layer: Layer) -> bytes:
    """A layer: ``pixels`` (h, w, 3) float16 and its rectangle (x, y, w, h)."""
    box = layer.rectangle
    return frames.pack("layer", {"pixels": layer.pixels}, {"rectangle": [box.x, box.y, box.width, box.height]})


def decode_layer(data: bytes, *, key: str = "") -> Layer:
    """The inverse of `encode_layer`.

    Raises:
        CorruptArtifact: not a whole, consistent layer.
    """
    arrays, meta = frames.unpack("layer", data, key=key)
    rectangle = _rectangle(meta.get("rectangle"), key)
    return Layer(rectangle, _array(arrays, "pixels", np.float16, (rectangle.height, rectangle.width, 3), key))


def encode_truth(truth: GroundTruth) -> bytes:
    """Class map, instance map, depth, and per person the amodal mask, cropped to its box and packed to bits."""
    arrays: dict[str, NDArray[Any]] = {
        "class_map": truth.class_map,
        "instance_map": truth.instance_map,
        "depth": truth.depth,
    }
    persons = []
    for person in truth.persons:
        box = _bounds(person.amodal)
        arrays[f"amodal.{person.instance_id}"] = np.packbits(person.amodal[box.slices])
        persons.append([person.instance_id, person.padded_pixels, box.x, box.y, box.width, box.height])
    return frames.pack("truth", arrays, {"persons": persons})


def decode_truth(data: bytes, *, key: str = "") -> GroundTruth:
    """The inverse of `encode_truth`.

    Raises:
        CorruptArtifact: not a whole, consistent truth.
    """
    arrays, meta = frames.unpack("truth", data, key=key)
    class_map = _array(arrays, "class_map", np.uint8, (None, None), key)
    size = class_map.shape
    persons: list[PersonTruth] = []
    entries = meta.get("persons")
    if not isinstance(entries, list):
        raise _corrupt(key, "the persons are no list")
    for entry in entries:
        if not isinstance(entry, list) or len(entry) != 6 or not all(isinstance(n, int) and n >= 0 for n in entry):
            raise _corrupt(key, f"not a person: {entry!r}")
        if persons and entry[0] <= persons[-1].instance_id:
            raise _corrupt(key, f"instance {entry[0]} is out of order")
        box = _rectangle(entry[2:], key)
        if box.x + box.width > size[1] or box.y + box.height > size[0]:
            raise _corrupt(key, f"the mask of instance {entry[0]} leaves the image")
        count = box.width * box.height
        bits = _array(arrays, f"amodal.{entry[0]}", np.uint8, ((count + 7) // 8,), key)
        amodal = np.zeros(size, np.bool_)
        amodal[box.slices] = np.unpackbits(bits, count=count).reshape(box.height, box.width).view(np.bool_)
        persons.append(PersonTruth(entry[0], freeze(amodal), entry[1]))
    return GroundTruth(
        class_map=class_map,
        instance_map=_array(arrays, "instance_map", np.uint16, size, key),
        depth=_array(arrays, "depth", np.float32, size, key),
        persons=tuple(persons),
    )


def encode_prediction(train_ids: NDArray[np.uint8]) -> bytes:
    """What a function predicted: (H, W) uint8 train ids."""
    return frames.pack("prediction", {"train_ids": train_ids}, {})


def decode_prediction(data: bytes, *, key: str = "") -> NDArray[np.uint8]:
    """The inverse of `encode_prediction`.

    Raises:
        CorruptArtifact: not a whole, consistent prediction.
    """
    arrays, _ = frames.unpack("prediction", data, key=key)
    return _array(arrays, "train_ids", np.uint8, (None, None), key)


def encode_counts(counts: NDArray[np.int64]) -> bytes:
    """A confusion matrix: (rows, columns) int64 pixel counts."""
    return frames.pack("counts", {"counts": counts}, {})


def decode_counts(data: bytes, *, key: str = "") -> NDArray[np.int64]:
    """The inverse of `encode_counts`.

    Raises:
        CorruptArtifact: not a whole, consistent matrix.
    """
    arrays, _ = frames.unpack("counts", data, key=key)
    return _array(arrays, "counts", np.int64, (None, None), key)


def _array(
    arrays: dict[str, NDArray[Any]], name: str, dtype: DTypeLike, shape: tuple[int | None, ...], key: str
) -> NDArray[Any]:
    """The named array; ``None`` in ``shape`` stands for any length."""
    array = arrays.get(name)
    if array is None:
        raise _corrupt(key, f"there is no array {name!r}")
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    if array.dtype != np.dtype(dtype) or not fits:
        wanted = tuple("any" if length is None else length for length in shape)
        raise _corrupt(key, f"{name} is {array.dtype} {array.shape}, expected {np.dtype(dtype)} {wanted}")
    return array


def _rectangle(values: object, key: str) -> Rectangle:
    if not isinstance(values, list) or len(values) != 4 or not all(isinstance(n, int) and n >= 0 for n in values):
        raise _corrupt(key, f"not a rectangle: {values!r}")
    return Rectangle(*values)


def _bounds(mask: NDArray[np.bool_]) -> Rectangle:
    """The smallest rectangle around all true pixels; empty at the origin when there is none."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return Rectangle(0, 0, 0, 0)
    x, y = int(columns[0]), int(rows[0])
    return Rectangle(x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1)


def _corrupt(key: str, message: str) -> CorruptArtifact:
    return CorruptArtifact(f"{key or 'artifact'}: {message}")
