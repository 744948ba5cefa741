"""Painted pictures: the sensor stage's output, truth, predictions and annotations."""

from __future__ import annotations

import io
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from valerie.errors import UnknownName
from valerie.labels import PERSON, VOID, colorize, to_label_ids, to_train_ids
from valerie.pipeline.reading.annotation_pictures import paint_boxes, paint_flow, paint_joints, paint_normals
from valerie.pipeline.reading.capture import Capture
from valerie.pipeline.reading.products import ProductReader
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.base import GroundTruth

#: Kinds of picture that every frame has, and those that show a prediction.
FRAME_KINDS: Final = ("picture", "truth", "truth-overlay", "instances", "depth")
FUNCTION_KINDS: Final = ("prediction", "overlay", "errors")
#: Kinds of picture of a requested annotation. A scan is visible in the picture of its sensor.
ANNOTATION_KINDS: Final = tuple(
    kind.value for kind in AnnotationKind if kind.stored and kind is not AnnotationKind.SCAN
)
KINDS: Final = FRAME_KINDS + FUNCTION_KINDS + ANNOTATION_KINDS
#: Raise it whenever equal products give other pictures.
PAINTING_REVISION: Final = 1

_HIT, _MISS, _FALSE = (
    (0, 158, 115),
    (213, 94, 0),
    (204, 121, 167),
)  # after Okabe and Ito: readable with every kind of colour vision


class FramePainter:
    """Painter of the frames in one store."""

    def __init__(self, reader: ProductReader) -> None:
        self._reader = reader

    def paint(
        self,
        kind: str,
        *,
        capture: Capture,
        prediction: str | None,
        annotation: str | None = None,
    ) -> NDArray[np.uint8]:
        """Paint a picture: (H, W, 3) uint8 sRGB.

        Args:
            kind: one of `KINDS`.
            capture: the frame and its sensor, which also distorts the truth.
            prediction, annotation: digests of finished products.

        Raises:
            UnknownName: no such kind, or it needs a prediction and there is none.
            MissingInput: an object is gone.
        """
        known = FRAME_KINDS + (FUNCTION_KINDS if prediction else ()) + (ANNOTATION_KINDS if annotation else ())
        if kind not in known:
            raise UnknownName("kind of picture", kind, known, field="kind")
        if kind == "truth":
            return colorize(capture.seen_truth(self._reader).class_map)
        if kind == "instances":
            return _instances(capture.seen_truth(self._reader))
        if kind == "depth":
            return _depth(capture.seen_truth(self._reader).depth)
        if kind == AnnotationKind.NORMALS and annotation is not None:
            return capture.seen_map(paint_normals(self._reader.normals(annotation)))
        if kind == AnnotationKind.FLOW and annotation is not None:
            return capture.seen_map(paint_flow(self._reader.flow(annotation)))
        if kind == AnnotationKind.VELOCITY and annotation is not None:
            return capture.seen_map(paint_flow(self._reader.velocity(annotation)))
        if kind == "prediction" and prediction is not None:
            return colorize(to_label_ids(self._reader.prediction(prediction)))
        picture = capture.picture(self._reader)
        if kind in (AnnotationKind.BOXES, AnnotationKind.JOINTS) and annotation is not None:
            height, width = picture.shape[:2]
            if kind == AnnotationKind.BOXES:
                lines, drawn = paint_boxes(self._reader.boxes(annotation), width, height)
            else:
                lines, drawn = paint_joints(self._reader.joints(annotation), width, height)
            return _blend(picture, capture.seen_map(lines), capture.seen_map(drawn), 0.9)
        if kind == "truth-overlay":
            return _blend(picture, colorize(capture.seen_truth(self._reader).class_map), None, 0.5)
        if kind == "picture" or prediction is None:
            return picture
        predicted = self._reader.prediction(prediction)
        if kind == "overlay":
            return _blend(picture, colorize(to_label_ids(predicted)), predicted != VOID, 0.5)
        return _errors(picture, to_train_ids(capture.seen_truth(self._reader).class_map), predicted)


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


def _errors(picture: NDArray[np.uint8], truth: NDArray[np.uint8], predicted: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Paint persons over a grey picture: hits green, misses orange, false alarms purple."""
    grey = np.repeat(picture.mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8)
    person, claimed = truth == PERSON.train_id, (predicted == PERSON.train_id) & (truth != VOID)
    for mask, color in ((person & claimed, _HIT), (person & ~claimed, _MISS), (~person & claimed, _FALSE)):
        grey = _blend(grey, np.broadcast_to(np.array(color, np.uint8), grey.shape), mask, 0.75)
    return grey


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
    painted = colorize(truth.class_map) // 3
    # Python integers, since the products below overflow the type of the map.
    for number in np.unique(truth.instance_map[truth.instance_map > 0]).tolist():
        shade = np.array([(number * 67) % 156 + 100, (number * 131) % 156 + 100, (number * 29) % 156 + 100], np.uint8)
        painted[truth.instance_map == number] = shade
    return painted


def _depth(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Paint depth: near is bright, logarithmic between 1 m and 200 m; black where nothing is hit."""
    with np.errstate(divide="ignore"):
        nearness = 1.0 - np.log(np.clip(depth, 1.0, 200.0)) / np.log(200.0)
    grey = np.where(np.isfinite(depth), 30 + nearness * 225, 0).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
