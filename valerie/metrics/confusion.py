"""Confusion matrix of one frame. Every score is derived from these counts."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.labels import NUM_TRAIN_CLASSES, VOID
from valerie.metrics.matrix import SHAPE, ConfusionMatrix

try:
    import cv2
except ImportError:  # numpy gives the same counts at four times the cost
    cv2 = None  # type: ignore[assignment]

#: cv2.calcHist counts in float32, which is exact up to this count.
_EXACT_FLOAT32: Final = 1 << 24

TrainIds = NDArray[np.uint8]


def confusion_matrix(truth: TrainIds, predicted: TrainIds) -> ConfusionMatrix:
    """Count the pixels of each class by predicted class.

    Args:
        truth: (H, W) uint8 train ids, 0…18 or 255; void pixels (255) are ignored.
        predicted: (H, W) uint8 train ids, 0…18 or 255; void on a labelled pixel counts in the last column.

    Returns:
        (19, 20) int64, rows truth, columns prediction.

    Raises:
        InvalidInput: a map has another shape or type, or holds a value that is not a train id.
    """
    for name, array in (("truth", truth), ("predicted", predicted)):
        if array.dtype != np.uint8 or array.ndim != 2:
            raise InvalidInput(
                "not a map of train ids", field=name, value=f"{array.dtype} {array.shape}", limit="(H, W) uint8"
            )
    if truth.shape != predicted.shape:
        raise InvalidInput(
            "differs from the truth in shape", field="predicted", value=predicted.shape, limit=truth.shape
        )
    if truth.size == 0:
        return np.zeros(SHAPE, np.int64)
    if cv2 is not None and truth.size <= _EXACT_FLOAT32:
        return _by_histogram(truth, predicted)
    return _by_bincount(truth, predicted)


def _by_histogram(truth: TrainIds, predicted: TrainIds) -> ConfusionMatrix:
    """Count with OpenCV's two-dimensional histogram: 0.6 CPU-ms for 960 × 540."""
    truth, predicted = np.ascontiguousarray(truth), np.ascontiguousarray(predicted)
    n = NUM_TRAIN_CLASSES
    truth_counts = cv2.calcHist([truth], [0], None, [256], [0, 256]).reshape(-1).astype(np.int64)
    predicted_counts = cv2.calcHist([predicted], [0], None, [256], [0, 256]).reshape(-1).astype(np.int64)
    _refuse_others("truth", truth_counts)
    _refuse_others("predicted", predicted_counts)
    matrix = np.zeros(SHAPE, np.int64)
    matrix[:, :n] = cv2.calcHist([truth, predicted], [0, 1], None, [n, n], [0, n, 0, n])
    # The pixels that are missing from a row were predicted void.
    matrix[:, n] = truth_counts[:n] - matrix[:, :n].sum(axis=1)
    return matrix


def _by_bincount(truth: TrainIds, predicted: TrainIds) -> ConfusionMatrix:
    """Count with numpy, for any number of pixels."""
    code = truth.ravel().astype(np.uint16)
    code <<= 8
    code |= predicted.ravel()
    pairs = np.bincount(code, minlength=65536).reshape(256, 256)
    _refuse_others("truth", pairs.sum(axis=1))
    _refuse_others("predicted", pairs.sum(axis=0))
    columns = [*range(NUM_TRAIN_CLASSES), VOID]
    return np.ascontiguousarray(pairs[:NUM_TRAIN_CLASSES, columns], np.int64)


def _refuse_others(name: str, counts: NDArray[np.int64]) -> None:
    wrong = np.flatnonzero(counts[NUM_TRAIN_CLASSES:VOID])
    if wrong.size:
        raise InvalidInput("not a train id", field=name, value=int(wrong[0]) + NUM_TRAIN_CLASSES, limit="0…18 or 255")
