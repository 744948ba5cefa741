"""Statistics of training frames: channels, for the network's normalisation, and classes, for the loss."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import NUM_TRAIN_CLASSES
from valerie.perception.training.frame_folder import TrainingFrame

_FRAMES: Final = 64
#: Largest weight of a class, in units of the average pixel: a class of few pixels must not dominate the loss.
_LARGEST_WEIGHT: Final = 12.0
#: Smallest deviation: a channel that hardly varies must not be amplified.
_LEAST_DEVIATION: Final = 0.05

Triple = tuple[float, float, float]


def channel_statistics(frames: Sequence[TrainingFrame]) -> tuple[Triple, Triple]:
    """Return mean and standard deviation of sRGB values in [0, 1] per channel, over at most 64 evenly spread frames.

    They are rounded to four decimals, so that the header of the function file states them exactly.
    """
    sample = spread(frames, _FRAMES)
    pixels = np.concatenate([frame.picture[::4, ::4].reshape(-1, 3) for frame in sample]).astype(np.float64) / 255.0
    mean = [round(float(x), 4) for x in pixels.mean(axis=0)]
    std = [round(max(float(x), _LEAST_DEVIATION), 4) for x in pixels.std(axis=0)]
    return (mean[0], mean[1], mean[2]), (std[0], std[1], std[2])


def class_weights(frames: Sequence[TrainingFrame], balance: float) -> NDArray[np.float32]:
    """Return the (19,) weights of the classes: their share of the labelled pixels to the power of ``−balance``, scaled so that
    the average pixel weighs 1. At most 64 evenly spread frames are counted; classes missing in them weigh as the rarest.
    """
    counts = np.zeros(NUM_TRAIN_CLASSES, np.int64)
    for frame in spread(frames, _FRAMES):
        counts += np.bincount(frame.train_ids[::2, ::2].ravel(), minlength=256)[:NUM_TRAIN_CLASSES]
    present = counts > 0
    if not present.any():
        return np.ones(NUM_TRAIN_CLASSES, np.float32)
    share = np.maximum(counts, counts[present].min()) / counts.sum()
    weights = share**-balance
    weights /= (weights * counts).sum() / counts.sum()
    bounded: NDArray[np.float32] = np.minimum(weights, _LARGEST_WEIGHT).astype(np.float32)
    return bounded


def spread(frames: Sequence[TrainingFrame], count: int) -> list[TrainingFrame]:
    """Return at most ``count`` frames, spread evenly over all of them."""
    stride = max(1, len(frames) // count)
    return [frames[i] for i in range(0, len(frames), stride)][:count]
