import math

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.metrics.aggregate import FrameMean, frame_mean, pooled
from valerie.metrics.scores import frame_scores


def person_frame(tp: int, fn: int) -> np.ndarray:
    matrix = np.zeros((19, 20), np.int64)
    matrix[11, 11], matrix[11, 0] = tp, fn
    return matrix


def test_frame_mean_and_pooled_ratio_differ_when_pedestrians_differ_in_size() -> None:
    frames = [person_frame(90, 10), person_frame(1, 9)]
    mean = frame_mean(frame_scores(frame).pacc for frame in frames)
    assert mean.mean == pytest.approx((0.9 + 0.1) / 2)
    assert frame_scores(pooled(frames)).pacc == pytest.approx(91 / 110)


def test_undefined_frames_are_counted_and_not_averaged() -> None:
    assert frame_mean([0.5, None, 1.0, None]) == FrameMean(0.75, 0.5, 1.0, defined=2, undefined=2)


def test_a_mean_without_defined_values_is_undefined() -> None:
    assert frame_mean([None]) == FrameMean(None, None, None, defined=0, undefined=1)


def test_nan_is_refused_because_undefined_is_none() -> None:
    with pytest.raises(InvalidInput, match="finite"):
        frame_mean([0.5, math.nan])


def test_pooling_no_matrices_gives_zeros() -> None:
    assert pooled([]).sum() == 0


def test_pooling_does_not_change_the_matrices_of_frames() -> None:
    frame = person_frame(1, 1)
    pooled([frame, frame])
    assert frame.sum() == 2


def test_pooling_refuses_matrices_of_another_shape() -> None:
    with pytest.raises(InvalidInput, match="confusion matrix"):
        pooled([np.zeros((19, 19), np.int64)])
