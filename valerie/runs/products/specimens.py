"""Specimens: what an engine makes of a fixed scene, or a function of a fixed picture, by which numeric classes are compared.

The first worker of a numeric class makes them when it starts, and they are stored once per class and database. Two classes agree
if their specimens differ by no more than `valerie.runs.products.pins.Bounds`.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.parameters.assignment import digest
from valerie.runs.products.pins import TRUTH, Bounds, FunctionOffer, Offer
from valerie.runs.products.states import Stage

#: Raise it whenever the scene, the picture or the encoding changes; specimens of different revisions are never compared.
SPECIMEN_REVISION: Final = 1


def of_image(linear: NDArray[np.float16]) -> bytes:
    """Return the specimen of a linear image: the grey levels 255 √(v / (1 + v)), in which dark and bright places count alike."""
    value = linear.astype(np.float64).clip(0.0, None)
    return _packed(np.rint(255.0 * np.sqrt(value / (1.0 + value))))


def of_truth(class_map: NDArray[np.uint8], instance_map: NDArray[np.uint16]) -> bytes:
    """Return the specimen of a ground truth: the instance of each pixel, or its label where it has none."""
    return _packed(np.where(instance_map > 0, instance_map, class_map))


def of_labels(labels: NDArray[np.uint8]) -> bytes:
    """Return the specimen of a prediction."""
    return _packed(labels)


def _packed(values: NDArray[Any]) -> bytes:
    return zlib.compress(np.ascontiguousarray(values, "<u2").tobytes(), 9)


def specimen_key(offer: Offer) -> str:
    """Return the key under which the specimen of an offer is stored."""
    weights = offer.digest if isinstance(offer, FunctionOffer) else ""
    parts = (offer.stage, offer.name, offer.numeric_class, offer.revision, weights)
    return digest("specimen", SPECIMEN_REVISION, *parts)


def agree(offer: Offer, other: Offer, specimens: Mapping[str, bytes], bounds: Bounds) -> bool:
    """Return True if two offers of the same name are of one numeric class, or their specimens agree within bounds.

    Args:
        offer, other: the offers.
        specimens: the stored ones, by `specimen_key`.
        bounds: the bounds.
    """
    if offer.revision != other.revision:
        return False
    if isinstance(offer, FunctionOffer) and isinstance(other, FunctionOffer) and offer.digest != other.digest:
        return False
    if offer.numeric_class == other.numeric_class:
        return True
    one, two = (specimens.get(specimen_key(each)) for each in (offer, other))
    if one is None or two is None:
        return False
    if offer.stage is Stage.INFER:
        return _share(one, two, 0) >= bounds.labels
    if offer.name == TRUTH:
        return _share(one, two, 0) >= bounds.truth
    return _share(one, two, bounds.levels) >= bounds.values


def _share(one: bytes, other: bytes, levels: int) -> float:
    """Return the share of values that differ by at most ``levels``; 0 if the numbers of values differ."""
    here, there = (np.frombuffer(zlib.decompress(data), "<u2").astype(np.int32) for data in (one, other))
    if here.shape != there.shape or not here.size:
        return 0.0
    return float(np.mean(np.abs(here - there) <= levels))
