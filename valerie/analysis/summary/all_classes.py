"""Scores of a run over all classes, not only persons: IoU per class and its mean, the usual comparison of networks.

A function that knows fewer than the 19 classes is judged by those that it knows; every page with its means names them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from valerie.labels import TRAIN_LABELS
from valerie.metrics.aggregate import FrameMean
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import class_counts, miou, pixel_accuracy
from valerie.perception.base import judged_ids


@dataclass(frozen=True, slots=True)
class PooledClass:
    """One class over all frames, from summed counts; ratios in [0, 1], None if undefined.

    Attributes:
        name: name of the class.
        pixels: pixels of the class in the truth.
        pacc: recall.
        precision, iou: precision and intersection over union. Like ``pacc``, None for a class that the function is not
            judged by.
    """

    name: str
    pixels: int
    pacc: float | None
    precision: float | None
    iou: float | None


@dataclass(frozen=True, slots=True)
class AllClasses:
    """Scores of one function with one sensor setting, over all frames and all classes that it is judged by.

    Attributes:
        function, sensor: names of the function and of the sensor setting.
        frames: number of evaluated frames.
        miou_mean: mean over the frames of each frame's mean IoU.
        miou_pooled: mean IoU of the summed counts, over the classes that the truth shows.
        pixel_accuracy_pooled: share of labelled pixels that were predicted correctly.
        classes: classes that the truth shows, in the order of their train ids.
        judged_by: names of the classes of the three scores; empty: all 19.
    """

    function: str
    sensor: str
    frames: int
    miou_mean: float | None
    miou_pooled: float | None
    pixel_accuracy_pooled: float | None
    classes: tuple[PooledClass, ...]
    judged_by: tuple[str, ...] = ()


def all_classes(
    function: str, sensor: str, matrix: ConfusionMatrix, frame_mious: FrameMean, judged_by: Sequence[str] = ()
) -> AllClasses:
    """Return the scores of one function with one sensor setting.

    Args:
        function, sensor: names of the function and of the sensor setting.
        matrix: (19, 20) summed counts of all frames (`valerie.metrics.aggregate.pooled`).
        frame_mious: mean IoU of the frames, over the same classes.
        judged_by: see `AllClasses`.

    Raises:
        InvalidInput: the matrix is not (19, 20).
    """
    judged = judged_ids(judged_by)
    shown = []
    for label in TRAIN_LABELS:
        counts = class_counts(matrix, label.train_id)
        if pixels := counts.tp + counts.fn:
            ratios = (counts.pacc, counts.precision, counts.iou) if label.train_id in judged else (None, None, None)
            shown.append(PooledClass(label.name, pixels, *ratios))
    return AllClasses(
        function,
        sensor,
        frames=frame_mious.defined + frame_mious.undefined,
        miou_mean=frame_mious.mean,
        miou_pooled=miou(matrix, judged),
        pixel_accuracy_pooled=pixel_accuracy(matrix, judged),
        classes=tuple(shown),
        judged_by=tuple(judged_by),
    )
