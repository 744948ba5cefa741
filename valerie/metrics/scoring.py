"""Score one frame: counts, scores and persons of a prediction against its ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from valerie.labels import to_train_ids
from valerie.metrics.confusion import confusion_matrix
from valerie.metrics.instances import InstanceCounts, InstanceTruth, person_counts
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import FrameScores, frame_scores


class LabelledTruth(InstanceTruth, Protocol):
    """The part of a ground truth that scores need (`valerie.rendering.base.GroundTruth` has it).

    Attributes:
        class_map: (H, W) uint8 label ids.
    """

    @property
    def class_map(self) -> NDArray[np.uint8]: ...


@dataclass(frozen=True, slots=True, eq=False)
class ScoredFrame:
    """One prediction against one ground truth.

    Attributes:
        matrix: (19, 20) counts.
        scores: scores of the class person, and over the classes that the function is judged by.
        persons: counts per person of the scene, by ascending instance id.
    """

    matrix: ConfusionMatrix
    scores: FrameScores
    persons: tuple[InstanceCounts, ...]

    def person(self, instance_id: int) -> InstanceCounts:
        """Return the counts of a person, which are 0 if the person is not in the scene."""
        return next(
            (counts for counts in self.persons if counts.instance_id == instance_id), InstanceCounts(instance_id, 0, 0)
        )


def score_frame(
    truth: LabelledTruth,
    prediction: NDArray[np.uint8],
    judged: Sequence[int],
    *,
    empty: NDArray[np.uint8] | None = None,
) -> ScoredFrame:
    """Score a prediction.

    Args:
        truth: ground truth of the frame, aligned with the picture.
        prediction: (H, W) uint8 train ids.
        judged: train ids of the classes that the function is judged by.
        empty: (H, W) uint8, the prediction of the same scene without movables.

    Raises:
        InvalidInput: prediction and truth differ in shape.
    """
    matrix = confusion_matrix(to_train_ids(truth.class_map), prediction)
    return ScoredFrame(matrix, frame_scores(matrix, classes=judged), person_counts(truth, prediction, empty=empty))
