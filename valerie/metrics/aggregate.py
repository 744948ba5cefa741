"""Many frames in one number, in the two ways that are easily mixed up: frame means, and ratios of pooled counts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from valerie.errors import InvalidInput
from valerie.metrics.matrix import SHAPE, ConfusionMatrix


@dataclass(frozen=True, slots=True)
class FrameMean:
    """Mean over the frames that have a value; each frame counts the same however many pixels it has.

    Attributes:
        mean, minimum, maximum: None where no frame has a value.
        defined: number of frames with a value.
        undefined: number of frames without; always to be shown beside the mean.
    """

    mean: float | None
    minimum: float | None
    maximum: float | None
    defined: int
    undefined: int


def frame_mean(values: Iterable[float | None]) -> FrameMean:
    """Average one score over frames; undefined frames (None) are counted, not averaged.

    Raises:
        InvalidInput: a value is NaN or infinite: undefined is None here.
    """
    listed = list(values)
    defined = [float(value) for value in listed if value is not None]
    for value in defined:
        if not math.isfinite(value):
            raise InvalidInput(
                "a score is not finite", field="values", value=value, limit="a number, or None for undefined"
            )
    missing = len(listed) - len(defined)
    if not defined:
        return FrameMean(None, None, None, 0, missing)
    return FrameMean(math.fsum(defined) / len(defined), min(defined), max(defined), len(defined), missing)


def pooled(matrices: Iterable[ConfusionMatrix]) -> ConfusionMatrix:
    """Sum the counts of frames: scores of the sum weigh every pixel the same, so near pedestrians weigh more.

    Raises:
        InvalidInput: one is not a (19, 20) matrix.
    """
    total = np.zeros(SHAPE, np.int64)
    for matrix in matrices:
        if matrix.shape != SHAPE:
            raise InvalidInput("not a confusion matrix", field="matrices", value=matrix.shape, limit=SHAPE)
        total += matrix
    return total
