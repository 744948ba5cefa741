"""Automatic exposure: metering brings the log-average luminance of an image to that of a scene in daylight.

A run meters the background of a frame, so frames that differ only in people share an exposure.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.color import luminance_of

#: The metering target: log-average luminance of the built-in asset on a clear day at 0 EV.
DAYLIGHT: Final = 0.1
#: Range of the automatic exposure, stops. It is enough to darken sunlit snow, and too little to turn night into day.
DARKEST_EV: Final = -6.0
BRIGHTEST_EV: Final = 11.0
#: Largest part of it that the exposure time provides; the rest is gain, which amplifies noise.
LONGEST_EV: Final = 5.0
#: Keeps the logarithm finite; below the smallest positive value of a linear image.
_LEAST: Final = 1e-8


def metered_ev(linear: NDArray[np.float16]) -> float:
    """Return the exposure that brings the log-average luminance to `DAYLIGHT`, clipped to the camera's range, stops.

    The log-average luminance is the key of a scene (Reinhard et al. 2002, doi:10.1145/566654.566575, equation 1). The result is
    rounded to a hundredth of a stop.

    Args:
        linear: (H, W, 3) float16, scene-referred; NaN and −inf count as black, inf as white.
    """
    light = np.nan_to_num(linear.astype(np.float32), nan=0.0, posinf=65504.0, neginf=0.0)
    luminance = luminance_of(np.maximum(light, 0.0))
    mean = float(np.exp(np.mean(np.log(luminance + np.float32(_LEAST)), dtype=np.float64)))
    return round(float(np.clip(np.log2(DAYLIGHT / mean), DARKEST_EV, BRIGHTEST_EV)), 2)
