"""Scores derived from a confusion matrix. An undefined score is None with a reason, never 0.

Matrices are (19, 20), from `valerie.metrics.confusion`, or sums of them. Scores are in [0, 1]. Means leave out classes that are
absent from the truth, as detectron2's ``SemSegEvaluator`` does (facebookresearch/detectron2,
``detectron2/evaluation/sem_seg_evaluation.py``). Unlike there, a function may predict void. Void on a labelled pixel is a miss
of that pixel's class.

Scores over all classes may be restricted to some classes, for functions with fewer than 19. A pixel of another class then has
neither recall nor weight, but it is a false positive if predicted as one of these classes. Predicting "person" everywhere
therefore stays wrong for a function without other classes. With a single class, pixel accuracy and mAcc equal its `pacc`, and
mIoU and fwIoU its `iou`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.labels import NUM_TRAIN_CLASSES, PERSON
from valerie.measures import Source, names_from
from valerie.metrics.matrix import SHAPE, ConfusionMatrix

#: Reason for an undefined recall of a class.
NOT_IN_TRUTH: Final = "no pixel of the class in the truth"
#: Reason for an undefined precision of a class.
NOT_PREDICTED: Final = "no labelled pixel predicted as the class"
#: Reason for an undefined IoU of a class.
IN_NEITHER: Final = "no pixel of the class in truth or prediction"
#: Reason for an undefined score over all classes.
NOTHING_LABELLED: Final = "no labelled pixel of the classes in the truth"


@dataclass(frozen=True, slots=True)
class ClassCounts:
    """Pixels of one class against all others. Pixels with void truth are not counted.

    Attributes:
        tp: pixels of the class that are predicted as the class.
        fp: pixels of other classes that are predicted as the class.
        fn: pixels of the class that are predicted as another class or void.
        tn: all other pixels.
    """

    tp: int
    fp: int
    fn: int
    tn: int

    @property
    def pacc(self) -> float | None:
        """Recall of the class, see `pacc`."""
        return pacc(self.tp, self.fn)

    @property
    def precision(self) -> float | None:
        """Precision of the class, see `precision`."""
        return precision(self.tp, self.fp)

    @property
    def iou(self) -> float | None:
        """Intersection over union of the class, see `iou`."""
        return iou(self.tp, self.fp, self.fn)


def class_counts(matrix: ConfusionMatrix, train_id: int = PERSON.train_id) -> ClassCounts:
    """Return the four counts of one class.

    Raises:
        InvalidInput: the matrix is not (19, 20), or the class has no such train id.
    """
    _require(matrix, (train_id,))
    tp = int(matrix[train_id, train_id])
    fp = int(matrix[:, train_id].sum()) - tp
    fn = int(matrix[train_id].sum()) - tp
    return ClassCounts(tp, fp, fn, int(matrix.sum()) - tp - fp - fn)


def pacc(tp: float, fn: float) -> float | None:
    """Return the paper's pixel accuracy of a class, its recall tp / (tp + fn); None if it is not in the truth."""
    return _ratio(tp, tp + fn)


def precision(tp: float, fp: float) -> float | None:
    """Return tp / (tp + fp); None if no pixel was predicted as the class."""
    return _ratio(tp, tp + fp)


def iou(tp: float, fp: float, fn: float) -> float | None:
    """Return the intersection over union, tp / (tp + fp + fn); None if the class is in neither truth nor prediction."""
    return _ratio(tp, tp + fp + fn)


def pixel_accuracy(matrix: ConfusionMatrix, classes: Sequence[int] | None = None) -> float | None:
    """Return the share of labelled pixels of ``classes`` (default: all 19) that were predicted correctly."""
    tp, truth, _ = _margins(matrix, classes)
    return _ratio(int(tp.sum()), int(truth.sum()))


def macc(matrix: ConfusionMatrix, classes: Sequence[int] | None = None) -> float | None:
    """Return the mean of tp / (tp + fn) over the classes in the truth; `pacc` for one class."""
    tp, truth, _ = _margins(matrix, classes)
    present = truth > 0
    return float(np.mean(tp[present] / truth[present])) if present.any() else None


def miou(matrix: ConfusionMatrix, classes: Sequence[int] | None = None) -> float | None:
    """Return the mean IoU over the classes in the truth."""
    tp, truth, union = _margins(matrix, classes)
    present = truth > 0
    return float(np.mean(tp[present] / union[present])) if present.any() else None


def fwiou(matrix: ConfusionMatrix, classes: Sequence[int] | None = None) -> float | None:
    """Return the mean IoU, each class weighted by its pixels in the truth; `miou` for one class."""
    tp, truth, union = _margins(matrix, classes)
    present = truth > 0
    if not present.any():
        return None
    weights = truth[present] / truth.sum()
    return float(np.sum(weights * tp[present] / union[present]))


@dataclass(frozen=True, slots=True)
class FrameScores:
    """All scores of one matrix, for one target class and over all classes.

    Attributes:
        counts: counts of the target class.
        pacc, precision, iou: scores of the target class.
        pixel_accuracy, macc, miou, fwiou: scores over all classes, or over the requested ones.
        undefined: score name to reason, for every score that is None.
    """

    counts: ClassCounts
    pacc: float | None
    precision: float | None
    iou: float | None
    pixel_accuracy: float | None
    macc: float | None
    miou: float | None
    fwiou: float | None
    undefined: dict[str, str] = field(default_factory=dict)

    @property
    def fp(self) -> int:
        """False positives of the target class."""
        return self.counts.fp

    @property
    def measures(self) -> dict[str, float | None]:
        """The frame's scores in the long table."""
        return {name: getattr(self, name) for name in names_from(Source.FRAME_SCORE)}


def frame_scores(matrix: ConfusionMatrix, *, classes: Sequence[int] | None = None) -> FrameScores:
    """Return every score of one frame's counts, or the pooled scores for summed counts.

    Args:
        matrix: (19, 20) counts.
        classes: train ids of the classes in the scores over all classes; None for all 19.
    """
    counts = class_counts(matrix, PERSON.train_id)
    values = {
        "pacc": counts.pacc,
        "precision": counts.precision,
        "iou": counts.iou,
        "pixel_accuracy": pixel_accuracy(matrix, classes),
        "macc": macc(matrix, classes),
        "miou": miou(matrix, classes),
        "fwiou": fwiou(matrix, classes),
    }
    reasons = {"pacc": NOT_IN_TRUTH, "precision": NOT_PREDICTED, "iou": IN_NEITHER}
    undefined = {name: reasons.get(name, NOTHING_LABELLED) for name, value in values.items() if value is None}
    return FrameScores(counts, **values, undefined=undefined)


def _margins(
    matrix: ConfusionMatrix, classes: Sequence[int] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return true positives, pixels of the truth and pixels of the union, each (C,) int64 over the requested classes."""
    train_ids = list(range(NUM_TRAIN_CLASSES)) if classes is None else list(classes)
    _require(matrix, train_ids)
    tp = np.diagonal(matrix)[train_ids]
    truth = matrix.sum(axis=1)[train_ids]
    predicted = matrix.sum(axis=0)[train_ids]
    return tp, truth, truth + predicted - tp


def _ratio(part: float, whole: float) -> float | None:
    return float(part / whole) if whole else None


def _require(matrix: ConfusionMatrix, classes: Sequence[int]) -> None:
    if matrix.shape != SHAPE:
        raise InvalidInput("not a confusion matrix", field="matrix", value=matrix.shape, limit=SHAPE)
    for train_id in classes:
        if not 0 <= train_id < NUM_TRAIN_CLASSES:
            raise InvalidInput("not a train id", field="classes", value=train_id, limit=f"0…{NUM_TRAIN_CLASSES - 1}")
    if len(set(classes)) != len(classes):
        raise InvalidInput("a class is named twice", field="classes", value=list(classes))
