"""Tone curves from scene-referred linear values to display-referred linear values, in float64.

Curves are monotone and apply to each channel separately. Inputs are non-negative and finite. Results may exceed 1; the sensor
stage clips them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


def filmic(linear: Values) -> Values:
    """Apply Hable's filmic curve: a toe, a straight part and a shoulder that reaches white at 11.2.

    ``h(x) = (x(Ax + CB) + DE) / (x(Ax + B) + DF) − E/F`` with A 0.15, B 0.50, C 0.10, D 0.20, E 0.02, F 0.30, applied
    to twice the input (Hable's exposure bias) and divided by ``h(11.2)``. Like Blender's Filmic it preserves highlights. It maps
    middle grey to a darker value than the plain sRGB curve: 0.18 becomes 0.128.

    Source: J. Hable, "Filmic Tonemapping Operators", 2010,
    http://filmicworlds.com/blog/filmic-tonemapping-operators/ (and
    "Uncharted 2: HDR Lighting", Game Developers Conference 2010).
    """

    def curve(x: Values) -> Values:
        return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.50) + 0.06) - 0.02 / 0.30

    return curve(2.0 * linear) / curve(np.array(11.2))


def aces(linear: Values) -> Values:
    """Apply Narkowicz' rational fit of the ACES reference rendering transform for an sRGB display.

    ``x(2.51x + 0.03) / (x(2.43x + 0.59) + 0.14)``. The input is scaled by 0.6, at which the fit follows the ACES curve and
    middle grey stays near its value on the plain sRGB curve.

    Source: K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2016,
    https://knarkowicz.wordpress.com/2016/01/06/aces-filmic-tone-mapping-curve/
    """
    x = 0.6 * linear
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


def plain(linear: Values) -> Values:
    """Return the values unchanged."""
    return linear


#: Curves by name in a spec.
CURVES: Final[Mapping[str, Callable[[Values], Values]]] = MappingProxyType(
    {"srgb": plain, "filmic": filmic, "aces": aces}
)
