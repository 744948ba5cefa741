"""Mean and standard deviation of the training pictures, for the network's normalisation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from valerie.perception.training.frames import TrainingFrame

_FRAMES: Final = 64
#: A channel that hardly varies must not be blown up.
_LEAST_DEVIATION: Final = 0.05

Triple = tuple[float, float, float]


def channel_statistics(frames: Sequence[TrainingFrame]) -> tuple[Triple, Triple]:
    """Per channel mean and standard deviation of sRGB values in [0, 1], over at most 64 frames spread over all.

    Rounded to four decimals, so that the header of the function file holds them exactly.
    """
    stride = max(1, len(frames) // _FRAMES)
    chosen = [frames[i] for i in range(0, len(frames), stride)][:_FRAMES]
    pixels = np.concatenate([frame.picture[::4, ::4].reshape(-1, 3) for frame in chosen]).astype(np.float64) / 255.0
    mean = [round(float(x), 4) for x in pixels.mean(axis=0)]
    std = [round(max(float(x), _LEAST_DEVIATION), 4) for x in pixels.std(axis=0)]
    return (mean[0], mean[1], mean[2]), (std[0], std[1], std[2])
