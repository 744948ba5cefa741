"""What single pixels of a frame show: truth and predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from threading import Lock
from typing import Final

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.labels import BY_ID, TRAIN_NAMES
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.capture import Capture
from valerie.pipeline.reading.frame_pictures import frame_sources
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.base import GroundTruth
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import PictureKind
from valerie.runs.products.states import ProductState

#: Numbers of kept truths and predictions: those of the last few frames.
_TRUTHS: Final = 4
_PREDICTIONS: Final = 16


@dataclass(frozen=True, slots=True)
class SeenPixel:
    """A pixel as one sensor sees it.

    Attributes:
        sensor: name of its setting.
        label: true class.
        instance_id: label id × 1000 + n; None where the class has no instances.
        depth_m: distance along the optical axis; None where nothing is hit.
        predictions: function to its class, or ``void``; only finished ones.
    """

    sensor: str
    label: str
    instance_id: int | None
    depth_m: float | None
    predictions: Mapping[str, str]


class Pixels:
    """Reader of pixels of one process."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._reader = ProductReader(context.store)
        self._lock = Lock()
        self._truths: LRUCache[str, GroundTruth] = LRUCache(_TRUTHS)
        self._predictions: LRUCache[str, NDArray[np.uint8]] = LRUCache(_PREDICTIONS)

    def at(self, key: FrameKey, x: int, y: int) -> list[SeenPixel]:
        """Return truth and predictions at a pixel for each sensor, counted from the frame's left upper corner.

        Raises:
            NotFound: no such run or frame.
            InvalidInput: the pixel is outside the frame.
            Conflict: the truth is not available yet.
            MissingInput: an object is gone.
        """
        sources = frame_sources(self._context, key, evaluated=True)
        spec = sources.resolved.spec
        for field, value, size in (("x", x, spec.resolution.width), ("y", y, spec.resolution.height)):
            if not 0 <= value < size:
                raise InvalidInput("outside the frame", field=field, value=value, limit=f"0 … {size - 1}")
        seen = []
        with self._lock:
            for number, setting in enumerate(spec.sensors):
                truth = self._truth(sources.picture(PictureKind.TRUTH, sensor=setting.name).capture)
                predictions = {
                    spec.functions[row.function_index]: TRAIN_NAMES[int(self._prediction(row.prediction)[y, x])]
                    for row in sources.predictions
                    if row.sensor_index == number and row.state == ProductState.DONE
                }
                depth = float(truth.depth[y, x])
                seen.append(
                    SeenPixel(
                        setting.name,
                        BY_ID[int(truth.class_map[y, x])].name,
                        int(truth.instance_map[y, x]) or None,
                        depth if isfinite(depth) else None,
                        predictions,
                    )
                )
        return seen

    def _truth(self, capture: Capture) -> GroundTruth:
        if capture.tag not in self._truths:
            self._truths[capture.tag] = capture.seen_truth(self._reader)
        return self._truths[capture.tag]

    def _prediction(self, digest: str) -> NDArray[np.uint8]:
        if digest not in self._predictions:
            self._predictions[digest] = self._reader.prediction(digest)
        return self._predictions[digest]
