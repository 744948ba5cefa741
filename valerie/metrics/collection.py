"""Scores of a collection of frames per class, as frame mean and from pooled counts.

Every score follows from the frames' confusion matrices, so the same code scores a run and a data set of real pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from valerie.labels import NUM_TRAIN_CLASSES, PERSON, TRAIN_LABELS, Label
from valerie.metrics.aggregate import FrameMean, frame_mean, pooled
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import ClassCounts, class_counts, fwiou, macc, miou, pixel_accuracy
from valerie.plain import JsonObject


@dataclass(frozen=True, slots=True)
class Averages:
    """One score as frame mean and pooled.

    Attributes:
        frames: mean over the frames in which the score is defined, with minimum and maximum.
        pooled: score of the summed counts; None if undefined.
    """

    frames: FrameMean
    pooled: float | None


@dataclass(frozen=True, slots=True)
class ClassScores:
    """One class over all frames.

    Attributes:
        label: the class.
        counts: pixel counts over all frames.
        pacc: recall.
        precision, iou: precision and intersection over union.
    """

    label: Label
    counts: ClassCounts
    pacc: Averages
    precision: Averages
    iou: Averages


@dataclass(frozen=True, slots=True)
class OverallScores:
    """Scores over all judged classes.

    Attributes:
        pixel_accuracy, macc, miou, fwiou: over the judged classes in the truth.
        miou_cityscapes: mean IoU of the summed counts over the judged classes in truth *or* prediction, as in
            cityscapesScripts (pooled only).
    """

    pixel_accuracy: Averages
    macc: Averages
    miou: Averages
    fwiou: Averages
    miou_cityscapes: Averages


@dataclass(frozen=True, slots=True)
class CollectionScores:
    """Scores of each class and over all classes.

    Attributes:
        frames: number of frames.
        matrix: (19, 20) summed counts.
        classes: all 19 classes by train id, including those that are not judged.
        judged: train ids of the classes in ``overall``, ascending.
        overall: scores over all judged classes.
    """

    frames: int
    matrix: ConfusionMatrix
    classes: tuple[ClassScores, ...]
    judged: tuple[int, ...]
    overall: OverallScores

    def of(self, label: Label = PERSON) -> ClassScores:
        """Return the scores of one evaluated class."""
        return self.classes[label.train_id]

    def as_document(self) -> JsonObject:
        """Return JSON values: ratios in [0, 1], None if undefined.

        ``classes`` holds the judged classes. ``confusion`` holds all counts: rows are the truth, columns the prediction,
        void last.
        """
        return {
            "frames": self.frames,
            "judged_by": [self.classes[train_id].label.name for train_id in self.judged],
            "overall": asdict(self.overall),
            "classes": {
                scores.label.name: {
                    **asdict(scores.counts),
                    "pacc": asdict(scores.pacc),
                    "precision": asdict(scores.precision),
                    "iou": asdict(scores.iou),
                }
                for scores in map(self.classes.__getitem__, self.judged)
            },
            "confusion": self.matrix.tolist(),
        }


def collection_scores(matrices: Sequence[ConfusionMatrix], classes: Sequence[int] | None = None) -> CollectionScores:
    """Return the scores of all frames from their confusion matrices.

    Args:
        matrices: (19, 20) each, from `valerie.metrics.confusion.confusion_matrix`.
        classes: train ids of the classes in the scores over all classes; None for all 19.

    Raises:
        InvalidInput: a matrix is not (19, 20), or ``classes`` holds a value that is not a train id.
    """
    total = pooled(matrices)
    judged = tuple(range(NUM_TRAIN_CLASSES)) if classes is None else tuple(sorted(classes))

    def both(score: Callable[[ConfusionMatrix, Sequence[int]], float | None]) -> Averages:
        return Averages(frame_mean(score(matrix, judged) for matrix in matrices), score(total, judged))

    overall = OverallScores(
        pixel_accuracy=both(pixel_accuracy),
        macc=both(macc),
        miou=both(miou),
        fwiou=both(fwiou),
        miou_cityscapes=Averages(frame_mean(()), _miou_cityscapes(total, judged)),
    )
    by_class = tuple(_class_scores(label, matrices, total) for label in TRAIN_LABELS)
    return CollectionScores(len(matrices), total, by_class, judged, overall)


def _class_scores(label: Label, matrices: Sequence[ConfusionMatrix], total: ConfusionMatrix) -> ClassScores:
    counts = [class_counts(matrix, label.train_id) for matrix in matrices]
    summed = class_counts(total, label.train_id)

    def both(score: Callable[[ClassCounts], float | None]) -> Averages:
        return Averages(frame_mean(score(frame) for frame in counts), score(summed))

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
