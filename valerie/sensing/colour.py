"""White balance: the camera multiplies its channels so that light of one colour temperature becomes grey.

The scene's white is the linear image's. A camera set to a temperature T other than 6504 K multiplies red, green and blue by
``white(6504 K) / white(T)``, in linear Rec. 709 and normalised to green: a von Kries transform on the camera's own channels,
as in raw converters. The image is too warm if the setting is too high, and too cold if it is too low.

``white(T)`` lies on the Planckian locus, or at a distance of ``tint`` thousandths of Duv from it, perpendicular in the CIE 1960
diagram. A positive tint lies on the green side: green light counts as white, and the image turns magenta.

Sources: locus, B. Kim et al., "Design of advanced color temperature control system for HDTV applications", J. Korean
Physical Society 41(6), 2002, 865-871 (cubic approximation, 1667 to 25,000 K); Duv, ANSI C78.377; matrix, ITU-R BT.709.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Colour temperature at which all gains are 1, kelvins.
NEUTRAL_K: Final = 6504.0
#: Linear Rec. 709 from CIE XYZ (the inverse of BT.709's primaries and D65).
_RGB_FROM_XYZ: Final = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
#: Least value of an illuminant's channel, as a share of green. Strong tints leave the gamut of Rec. 709.
_FLOOR: Final = 0.02


def planckian_locus(temperature_k: float) -> tuple[float, float]:
    """Return the CIE 1931 chromaticity (x, y) of a black body between 1667 and 25,000 K."""
    t = 1000.0 / temperature_k
    if temperature_k <= 4000.0:
        x = ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.179910
    else:
        x = ((-3.0258469 * t + 2.1070379) * t + 0.2226347) * t + 0.240390
    if temperature_k <= 2222.0:
        y = ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683
    elif temperature_k <= 4000.0:
        y = ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867
    else:
        y = ((3.0817580 * x - 5.87338670) * x + 3.75112997) * x - 0.37001483
    return x, y


@lru_cache(maxsize=1024)
def white_balance_gains(temperature_k: float, tint: float) -> tuple[float, float, float]:
    """Return the gains of red, green and blue; exactly 1 at the neutral setting.

    Args:
        temperature_k: colour temperature that becomes white, kelvins.
        tint: thousandths of Duv.
    """
    if temperature_k == NEUTRAL_K and tint == 0.0:
        return 1.0, 1.0, 1.0
    gains = _white(NEUTRAL_K, 0.0) / _white(temperature_k, tint)
    return float(gains[0]), 1.0, float(gains[2])


def _white(temperature_k: float, tint: float) -> NDArray[np.float64]:
    """Return the linear Rec. 709 colour of an illuminant, (3,), with green 1."""
    u, v = _uv(temperature_k)
    if tint:
        step = 1e-3 * temperature_k
        before, after = _uv(temperature_k - step), _uv(temperature_k + step)
        along_u, along_v = after[0] - before[0], after[1] - before[1]
        # Towards higher temperatures the locus runs to smaller u and v. Green lies above it, at larger v.
        length = math.hypot(along_u, along_v)
        u += 1e-3 * tint * along_v / length
        v -= 1e-3 * tint * along_u / length
    x, y = 3.0 * u / (2.0 * u - 8.0 * v + 4.0), 2.0 * v / (2.0 * u - 8.0 * v + 4.0)
    rgb = _RGB_FROM_XYZ @ np.array([x / y, 1.0, (1.0 - x - y) / y])
    result: NDArray[np.float64] = np.maximum(rgb / rgb[1], _FLOOR)
    return result


def _uv(temperature_k: float) -> tuple[float, float]:
    """Return the CIE 1960 chromaticity (u, v) of a black body."""
    x, y = planckian_locus(temperature_k)
    scale = -2.0 * x + 12.0 * y + 3.0
    return 4.0 * x / scale, 6.0 * y / scale
