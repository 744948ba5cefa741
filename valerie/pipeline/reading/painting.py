"""Painted pictures: the sensor stage's output, truth, predictions and annotations."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import Final

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray
from PIL import Image

from valerie.errors import UnknownName
from valerie.labels import PERSON, VOID, colorize, to_label_ids, to_train_ids
from valerie.pipeline.reading.annotation_pictures import paint_boxes, paint_flow, paint_joints, paint_normals
from valerie.pipeline.reading.capture import Capture
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.base import WHOLE, GroundTruth, Window
from valerie.runs.products.pictures import ANNOTATION_KINDS, FRAME_KINDS, FUNCTION_KINDS, PictureKind
from valerie.sensing.sensor import pixelwise

#: Pixels of a person's close-up from top to bottom, at least; smaller windows are enlarged by a whole number.
_CLOSE_UP: Final = 360
#: What a close-up shows around the person: this share of the longer side, and at least so many pixels.
_MARGIN, _LEAST_MARGIN = 0.5, 12
_GAP: Final = 6
#: Raise it whenever equal products give other pictures.
PAINTING_REVISION: Final = 1

#: Colours of nothing, a miss, a false alarm and a hit, after Okabe and Ito: readable with every kind of colour vision.
_OUTCOMES: Final = np.array([(0, 0, 0), (213, 94, 0), (204, 121, 167), (0, 158, 115)])


def _error_colors() -> NDArray[np.uint32]:
    """Return the colour, four bytes, of every outcome over every grey: (1024,)."""
    colors = np.zeros((len(_OUTCOMES), 256, 4), np.uint8)
    grey = np.arange(256.0)[:, None]
    colors[..., :3] = grey
    colors[1:, :, :3] = np.rint(grey * 0.25 + _OUTCOMES[1:, None] * 0.75)
    return colors.view(np.uint32).ravel()


_ERRORS: Final = _error_colors()


class FramePainter:
    """Painter of the frames in one store, for one thread at a time.

    Args:
        reader: of the store.
        kept_bytes: size of the developed pictures and labels that are kept for the next painting.
    """

    def __init__(self, reader: ProductReader, *, kept_bytes: int = 0) -> None:
        self._reader = reader
        self._kept: LRUCache[tuple[str, Capture, str], NDArray[np.uint8]] = LRUCache(
            kept_bytes, lambda array: array.nbytes
        )

    def paint(
        self,
        kind: PictureKind,
        *,
        capture: Capture,
        prediction: str | None,
        annotation: str | None = None,
        window: Window = WHOLE,
    ) -> NDArray[np.uint8]:
        """Paint a picture: (H, W, 3) uint8 sRGB.

        Args:
            kind: what to show.
            capture: the frame and its sensor, which also distorts the truth.
            prediction, annotation: digests of finished products.
            window: what to paint; a part of a picture may have noise of its own.

        Raises:
            UnknownName: no such kind, or it needs a prediction and there is none.
            MissingInput: an object is gone.
        """
        known = FRAME_KINDS + (FUNCTION_KINDS if prediction else ()) + (ANNOTATION_KINDS if annotation else ())
        if kind not in known:
            raise UnknownName("kind of picture", kind, known, field="kind")
        if kind is PictureKind.TRUTH:
            return colorize(self._class_map(capture)[window])
        if kind is PictureKind.INSTANCES:
            return _instances(capture.seen_truth(self._reader))[window]
        if kind is PictureKind.DEPTH:
            return _depth(capture.seen_truth(self._reader).depth)[window]
        if kind is PictureKind.NORMALS and annotation is not None:
            return capture.seen_map(paint_normals(self._reader.normals(annotation)))[window]
        if kind is PictureKind.FLOW and annotation is not None:
            return capture.seen_map(paint_flow(self._reader.flow(annotation)))[window]
        if kind is PictureKind.VELOCITY and annotation is not None:
            return capture.seen_map(paint_flow(self._reader.velocity(annotation)))[window]
        if kind is PictureKind.PREDICTION and prediction is not None:
            return colorize(to_label_ids(self._reader.prediction(prediction)[window]))
        if kind in (PictureKind.BOXES, PictureKind.JOINTS) and annotation is not None:
            whole = self._picture(capture)
            height, width = whole.shape[:2]
            if kind is PictureKind.BOXES:
                lines, strokes = paint_boxes(self._reader.boxes(annotation), width, height)
            else:
                lines, strokes = paint_joints(self._reader.joints(annotation), width, height)
            return _blend(whole, capture.seen_map(lines), capture.seen_map(strokes), 0.9)[window]
        picture = self._picture(capture, window)
        if kind is PictureKind.TRUTH_OVERLAY:
            return _blend(picture, colorize(self._class_map(capture)[window]), None, 0.5)
        if kind is PictureKind.PICTURE or prediction is None:
            return picture
        predicted = self._reader.prediction(prediction)[window]
        if kind is PictureKind.OVERLAY:
            return _blend(picture, colorize(to_label_ids(predicted)), predicted != VOID, 0.5)
        return paint_errors(picture, to_train_ids(self._class_map(capture)[window]), predicted)

    def _picture(self, capture: Capture, window: Window = WHOLE) -> NDArray[np.uint8]:
        if pixelwise(capture.setting):
            return self._stored("picture", capture, window, lambda: capture.picture(self._reader, window))
        return self._stored("picture", capture, WHOLE, lambda: capture.picture(self._reader))[window]

    def _class_map(self, capture: Capture) -> NDArray[np.uint8]:
        return self._stored("classes", capture, WHOLE, lambda: capture.seen_classes(self._reader))

    def _stored(
        self, what: str, capture: Capture, window: Window, make: Callable[[], NDArray[np.uint8]]
    ) -> NDArray[np.uint8]:
        """Return the array that is kept, or make it and keep it if it is small enough."""
        key = (what, capture, str(window))  # slices have no hash
        array = self._kept.get(key)
        if array is None:
            array = make()
            if array.nbytes <= self._kept.maxsize:
                self._kept[key] = array
        return array

    def close_up(self, *, capture: Capture, prediction: str, person: int) -> NDArray[np.uint8]:
        """Paint a person from near: the picture on the left; on the right hits green, misses orange, false alarms purple.

        Args:
            capture: the frame and the sensor that sees it.
            prediction: digest of a finished product.
            person: instance id; the whole frame is shown where no pixel of the person is visible.

        Returns:
            (H, W, 3) uint8 sRGB, in whole multiples of the picture's pixels.

        Raises:
            MissingInput: an object is gone.
        """
        truth, picture = capture.seen_truth(self._reader), capture.picture(self._reader)
        outcome = paint_errors(picture, to_train_ids(truth.class_map), self._reader.prediction(prediction))
        window = _window_around(truth.instance_map == person)
        panes = [_enlarged(picture[window]), _enlarged(outcome[window])]
        gap = np.full((panes[0].shape[0], _GAP, 3), 255, np.uint8)
        return np.concatenate((panes[0], gap, panes[1]), axis=1)


def paint_errors(
    picture: NDArray[np.uint8], truth: NDArray[np.uint8], predicted: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Paint persons over a grey picture: hits green, misses orange, false alarms purple.

    Args:
        picture: (H, W, 3) uint8 sRGB.
        truth, predicted: (H, W) train ids.
    """
    person, claimed = truth == PERSON.train_id, (predicted == PERSON.train_id) & (truth != VOID)
    red, green, blue = np.moveaxis(picture, -1, 0)
    grey = (np.add(red, green, dtype=np.uint16) + blue) // np.uint16(3)
    outcome = person + np.uint16(2) * claimed
    colors = np.take(_ERRORS, outcome * np.uint16(256) + grey, mode="clip")
    painted: NDArray[np.uint8] = colors.view(np.uint8).reshape(*truth.shape, 4)[..., :3]
    return painted


def brightened_difference(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], float]:
    """Return the absolute difference of two pictures, (H, W, 3) uint8, and the factor that makes its largest value white."""
    difference = np.abs(first.astype(np.int16) - second)
    gain = 255 / float(difference.max() or 255)
    return np.rint(gain * difference).astype(np.uint8), gain


def jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """Encode (H, W, 3) uint8 as JPEG, for reports; not for functions under test."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=88)
    return buffer.getvalue()


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode (H, W, 3) uint8 as PNG."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=3)
    return buffer.getvalue()


def _window_around(mask: NDArray[np.bool_]) -> Window:
    """Return the rows and columns of a mask's pixels with a margin; of all pixels where it has none."""
    if not mask.any():
        return slice(None), slice(None)
    spans = [np.flatnonzero(mask.any(axis=axis))[[0, -1]] for axis in (1, 0)]
    margin = max(_LEAST_MARGIN, int(_MARGIN * max(last - first + 1 for first, last in spans)))
    rows, columns = (slice(max(int(first) - margin, 0), int(last) + margin + 1) for first, last in spans)
    return rows, columns


def _enlarged(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    factor = math.ceil(_CLOSE_UP / pixels.shape[0])
    return pixels.repeat(factor, axis=0).repeat(factor, axis=1)


def _blend(
    below: NDArray[np.uint8], above: NDArray[np.uint8], mask: NDArray[np.bool_] | None, strength: float
) -> NDArray[np.uint8]:
    if mask is None:
        mask = np.ones(below.shape[:2], np.bool_)
    mixed = below.copy()
    mixed[mask] = np.rint(below[mask] * (1 - strength) + above[mask] * strength).astype(np.uint8)
    return mixed


def _instances(truth: GroundTruth) -> NDArray[np.uint8]:
    """Paint every instance in its own colour over a darkened class map."""
    picture = colorize(truth.class_map) // 3
    # Python integers, since the products below overflow the type of the map.
    for number in np.unique(truth.instance_map[truth.instance_map > 0]).tolist():
        shade = np.array([(number * 67) % 156 + 100, (number * 131) % 156 + 100, (number * 29) % 156 + 100], np.uint8)
        picture[truth.instance_map == number] = shade
    return picture


def _depth(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Paint depth: near is bright, logarithmic between 1 m and 200 m; black where nothing is hit."""
    with np.errstate(divide="ignore"):
        nearness = 1.0 - np.log(np.clip(depth, 1.0, 200.0)) / np.log(200.0)
    grey = np.where(np.isfinite(depth), 30 + nearness * 225, 0).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
