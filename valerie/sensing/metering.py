"""Exposure that a camera chooses itself: the picture's logarithmic mean is brought to that of a street by day."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Logarithmic mean of luminance of the generated street on a clear day at 0 EV: what metering aims at.
DAYLIGHT: Final = 0.1
#: Stops between which a camera can choose: it darkens snow in the sun, and at night it stays short of the day.
DARKEST_EV: Final = -6.0
BRIGHTEST_EV: Final = 11.0
_LUMINANCE: Final = np.array([0.2126, 0.7152, 0.0722], np.float32)
#: Below the least value that a linear image holds.
_LEAST: Final = 1e-8


def metered_ev(linear: NDArray[np.float16]) -> float:
    """Stops that bring the logarithmic mean of luminance to `DAYLIGHT`, within what a camera can choose.

    The mean of the logarithm is the key of a scene (Reinhard et al. 2002, doi:10.1145/566654.566575, equation 1). Rounded to a
    hundredth of a stop.

    Args:
        linear: (H, W, 3) float16, scene-referred; what is not finite counts as black or white.
    """
    light = np.nan_to_num(linear.astype(np.float32), nan=0.0, posinf=65504.0, neginf=0.0)
    luminance = np.maximum(light, 0.0) @ _LUMINANCE
    mean = float(np.exp(np.mean(np.log(luminance + np.float32(_LEAST)), dtype=np.float64)))
    return round(float(np.clip(np.log2(DAYLIGHT / mean), DARKEST_EV, BRIGHTEST_EV)), 2)
