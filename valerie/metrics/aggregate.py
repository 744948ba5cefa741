"""Averages over frames, of two kinds that are easily confused: frame means, and ratios of pooled counts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from valerie.errors import InvalidInput
from valerie.metrics.matrix import SHAPE, ConfusionMatrix


@dataclass(frozen=True, slots=True)
class FrameMean:
    """Mean over the frames that have a value. Every frame has the same weight.

    Attributes:
        mean, minimum, maximum: None if no frame has a value.
        defined: number of frames with a value.
        undefined: number of frames without a value, which is always shown beside the mean.
    """

    mean: float | None
    minimum: float | None
    maximum: float | None
    defined: int
    undefined: int


def frame_mean(values: Iterable[float | None]) -> FrameMean:
    """Return the mean of one score over frames. Undefined values (None) are counted, not averaged.

    Raises:
        InvalidInput: a value is NaN or infinite.
    """
    scores = list(values)
    defined = [float(value) for value in scores if value is not None]
    for value in defined:
        if not math.isfinite(value):
            raise InvalidInput(
                "a score is not finite", field="values", value=value, limit="a number, or None for undefined"
            )
    undefined = len(scores) - len(defined)
    if not defined:
        return FrameMean(None, None, None, 0, undefined)
    return FrameMean(math.fsum(defined) / len(defined), min(defined), max(defined), len(defined), undefined)


def pooled(matrices: Iterable[ConfusionMatrix]) -> ConfusionMatrix:
    """Return the summed counts of frames: (19, 20) int64.

    Scores of the sum give every pixel the same weight, so near pedestrians count more than far ones.

    Raises:
        InvalidInput: a matrix is not (19, 20).
    """
    total = np.zeros(SHAPE, np.int64)
    for matrix in matrices:
        if matrix.shape != SHAPE:
            raise InvalidInput("not a confusion matrix", field="matrices", value=matrix.shape, limit=SHAPE)
        total += matrix
    return total
