"""Scores of a collection of frames, class by class, in both averages: frame mean and pooled.

Every figure follows from the frames' confusion matrices, so a run and a data set of real pictures are compared by the
same code and like with like.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from valerie.labels import NUM_TRAIN_CLASSES, PERSON, TRAIN_LABELS, Label
from valerie.metrics.aggregate import FrameMean, frame_mean, pooled
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import ClassCounts, class_counts, fwiou, macc, miou, pixel_accuracy


@dataclass(frozen=True, slots=True)
class Averages:
    """One score in both averages.

    Attributes:
        frames: over the frames in which it is defined, with the smallest and the largest.
        pooled: of the summed counts; None where undefined.
    """

    frames: FrameMean
    pooled: float | None


@dataclass(frozen=True, slots=True)
class ClassScores:
    """One class over all frames.

    Attributes:
        label: which class.
        counts: pixels, summed.
        pacc: its recall.
        precision, iou: likewise in both averages.
    """

    label: Label
    counts: ClassCounts
    pacc: Averages
    precision: Averages
    iou: Averages


@dataclass(frozen=True, slots=True)
class CollectionScores:
    """All classes and all-class scores over some frames.

    Attributes:
        frames: how many.
        matrix: (19, 20) summed counts.
        classes: in train-id order, also those that are not judged.
        judged: train ids of the classes that ``overall`` is over, ascending.
        overall: ``pixel_accuracy``, ``macc``, ``miou``, ``fwiou`` over the judged classes in the truth, and ``miou_cityscapes``:
            the mean IoU of the summed counts over the judged classes in truth *or* prediction, as cityscapesScripts averages
            (defined pooled only).
    """

    frames: int
    matrix: ConfusionMatrix
    classes: tuple[ClassScores, ...]
    judged: tuple[int, ...]
    overall: dict[str, Averages]

    def of(self, label: Label = PERSON) -> ClassScores:
        """The scores of one evaluated class."""
        return self.classes[label.train_id]

    def as_document(self) -> dict[str, Any]:
        """JSON values; ratios in [0, 1], None where undefined, the matrix as rows (truth) of columns (prediction, void last).

        ``classes`` holds the judged ones, ``confusion`` all that was counted.
        """
        return {
            "frames": self.frames,
            "judged_by": [self.classes[train_id].label.name for train_id in self.judged],
            "overall": {name: asdict(value) for name, value in self.overall.items()},
            "classes": {
                one.label.name: {
                    **asdict(one.counts),
                    "pacc": asdict(one.pacc),
                    "precision": asdict(one.precision),
                    "iou": asdict(one.iou),
                }
                for one in map(self.classes.__getitem__, self.judged)
            },
            "confusion": self.matrix.tolist(),
        }


def collection_scores(matrices: Sequence[ConfusionMatrix], classes: Sequence[int] | None = None) -> CollectionScores:
    """Scores of all frames from their matrices.

    Args:
        matrices: (19, 20) each, as `valerie.metrics.confusion.confusion_matrix` counts.
        classes: train ids that all-class scores are over; None: all 19.

    Raises:
        InvalidInput: one is no such matrix, or a class is none.
    """
    total = pooled(matrices)
    judged = tuple(range(NUM_TRAIN_CLASSES)) if classes is None else tuple(sorted(classes))

    def both(score: Callable[[ConfusionMatrix, Sequence[int]], float | None]) -> Averages:
        return Averages(frame_mean(score(matrix, judged) for matrix in matrices), score(total, judged))

    overall = {
        "pixel_accuracy": both(pixel_accuracy),
        "macc": both(macc),
        "miou": both(miou),
        "fwiou": both(fwiou),
        "miou_cityscapes": Averages(frame_mean(()), _miou_cityscapes(total, judged)),
    }
    found = tuple(_class_scores(label, matrices, total) for label in TRAIN_LABELS)
    return CollectionScores(len(matrices), total, found, judged, overall)


def _class_scores(label: Label, matrices: Sequence[ConfusionMatrix], total: ConfusionMatrix) -> ClassScores:
    counts = [class_counts(matrix, label.train_id) for matrix in matrices]
    summed = class_counts(total, label.train_id)

    def both(score: Callable[[ClassCounts], float | None]) -> Averages:
        return Averages(frame_mean(score(one) for one in counts), score(summed))

    return ClassScores(
        label,
        summed,
        pacc=both(lambda c: c.pacc),
        precision=both(lambda c: c.precision),
        iou=both(lambda c: c.iou),
    )


def _miou_cityscapes(matrix: ConfusionMatrix, judged: Sequence[int]) -> float | None:
    ious = (class_counts(matrix, train_id).iou for train_id in judged)
    values = [value for value in ious if value is not None]
    return float(np.mean(values)) if values else None
