"""What a run says of all classes, not of persons only: IoU class by class and its mean, as networks are usually compared."""

from __future__ import annotations

from dataclasses import dataclass

from valerie.labels import TRAIN_LABELS
from valerie.metrics.aggregate import FrameMean
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import class_counts, miou, pixel_accuracy


@dataclass(frozen=True, slots=True)
class PooledClass:
    """One class over all frames, from summed counts; ratios in [0, 1], None where undefined.

    Attributes:
        name: of the class.
        pixels: of the truth.
        pacc: its recall.
        precision, iou: likewise.
    """

    name: str
    pixels: int
    pacc: float | None
    precision: float | None
    iou: float | None


@dataclass(frozen=True, slots=True)
class AllClasses:
    """One function behind one sensor setting, over all frames and all classes.

    Attributes:
        function, sensor: who looked.
        frames: evaluated.
        miou_mean: mean over the frames of each frame's mean IoU.
        miou_pooled: mean IoU of the summed counts, over the classes that the truth shows.
        pixel_accuracy_pooled: share of labelled pixels that were predicted right.
        classes: those that the truth shows, in the order of their train ids.
    """

    function: str
    sensor: str
    frames: int
    miou_mean: float | None
    miou_pooled: float | None
    pixel_accuracy_pooled: float | None
    classes: tuple[PooledClass, ...]


def all_classes(function: str, sensor: str, matrix: ConfusionMatrix, frame_mious: FrameMean) -> AllClasses:
    """The figures of one function behind one sensor setting.

    Args:
        function, sensor: who looked.
        matrix: (19, 20) summed counts of all frames (`valerie.metrics.aggregate.pooled`).
        frame_mious: mean IoU of the frames.

    Raises:
        InvalidInput: no such matrix.
    """
    shown = []
    for label in TRAIN_LABELS:
        counts = class_counts(matrix, label.train_id)
        if pixels := counts.tp + counts.fn:
            shown.append(PooledClass(label.name, pixels, counts.pacc, counts.precision, counts.iou))
    frames = frame_mious.defined + frame_mious.undefined
    return AllClasses(function, sensor, frames, frame_mious.mean, miou(matrix), pixel_accuracy(matrix), tuple(shown))
