"""Blender's Filmic view transform from linear Rec. 709 to display values, without Blender.

The steps are those of Blender's OpenColorIO configuration:

1. Map each channel to a logarithmic scale: 25 stops from 2^−12.47.
2. Desaturate highlights with a 33³ colour lattice (3D LUT). Every channel of a lattice colour moves towards the brightest one by
   a share that depends only on the brightest channel's step on the scale: 0 below step 21 (linear 15), 1 from step 27 on.
   Interpolation between lattice colours is tetrahedral.
3. Map the lower 16.5 stops to [0, 1].
4. Apply a contrast curve. Its result is display-encoded.

Middle grey 0.18 becomes 0.5, and 16.3 becomes white. ``tools/fit_blender_filmic.py`` fitted the shares of the second step and the
nodes of the curve to the output of Blender 4.5 LTS; no data of Blender's configuration is included. Results are within one grey
level of Blender's own 8-bit images (tested on pairs).

Sources: Filmic by T. Sobotka, https://github.com/sobotka/filmic-blender; interpolation, J. Hardeberg and F. Schmitt, "Color
printer characterization using a computational geometry approach", IS&T/SID Color Imaging Conference, 1997; monotone curve
between nodes, F. Fritsch and R. Carlson, SIAM J. Numerical Analysis 17(2), 1980, doi:10.1137/0717021.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

_LOWEST_STOP: Final = -12.473931188
_STOPS: Final = 25.0
#: Share of these stops below display white.
_SHOWN: Final = 0.66
#: Lattice colours along each axis.
_SIZE: Final = 33
#: Share by which channels move towards the brightest channel, by its step on the scale; 0 below these steps, 1 above.
_SHARES: Final = {21: 0.000305, 22: 0.001373, 23: 0.003402, 24: 0.007153, 25: 0.014022, 26: 0.026552}
#: The contrast curve at evenly spaced points of [0, 1].
_NODES: Final = (
    0.00002, 0.00092, 0.00197, 0.00314, 0.00448, 0.00598, 0.00770, 0.00962, 0.01179, 0.01426, 0.01702, 0.02016,
    0.02367, 0.02765, 0.03212, 0.03714, 0.04277, 0.04909, 0.05618, 0.06411, 0.07296, 0.08282, 0.09379, 0.10595,
    0.11942, 0.13427, 0.15059, 0.16851, 0.18802, 0.20926, 0.23221, 0.25691, 0.28332, 0.31141, 0.34111, 0.37224,
    0.40471, 0.43825, 0.47269, 0.50758, 0.54239, 0.57723, 0.61173, 0.64567, 0.67869, 0.71059, 0.74110, 0.77003,
    0.79726, 0.82266, 0.84619, 0.86775, 0.88743, 0.90518, 0.92110, 0.93527, 0.94775, 0.95867, 0.96810, 0.97620,
    0.98304, 0.98874, 0.99340, 0.99712, 1.00000,
)  # fmt: skip
#: Number of entries of the curve's look-up table.
_CURVE: Final = 4096

Floats = NDArray[np.float32]


def blender_filmic(linear: Floats) -> Floats:
    """Return display values in [0, 1], (…, 3).

    Args:
        linear: (…, 3) linear Rec. 709, not negative.
    """
    lattice, curve = _tables()
    smallest = np.float32(2.0**_LOWEST_STOP)
    # One contiguous row per channel: numpy is several times faster on long rows than on rows of three.
    values = np.ascontiguousarray(linear.reshape(-1, 3).T)
    stops = np.log2(np.maximum(values, smallest)) - np.float32(_LOWEST_STOP)
    place = np.minimum(stops * np.float32((_SIZE - 1) / _STOPS), np.float32(_SIZE - 1))
    index = _interpolated(lattice, place) * np.float32(len(curve) - 1)
    floor = np.minimum(np.floor(index), np.float32(len(curve) - 2))
    lower = floor.astype(np.int32)
    below = np.take(curve, lower)
    display: Floats = below + (np.take(curve, lower + 1) - below) * (index - floor)
    return display.T.reshape(linear.shape)


def _interpolated(lattice: Floats, place: Floats) -> Floats:
    """Return (3, N) lattice values at (3, N) places, by tetrahedral interpolation.

    The tetrahedron's edges lead from the cell's lower corner to the upper one, along the axis with the largest fraction first.
    """
    floor = np.minimum(np.floor(place), np.float32(_SIZE - 2))
    red, green, blue = place - floor
    strides = np.array([_SIZE * _SIZE, _SIZE, 1], np.int32)
    first = strides @ floor.astype(np.int32)
    # Where fractions are equal, the order of their axes does not matter, but the axes must differ.
    largest = np.where(red >= np.maximum(green, blue), strides[0], np.where(green >= blue, strides[1], strides[2]))
    smallest = np.where(blue <= np.minimum(red, green), strides[2], np.where(green <= red, strides[1], strides[0]))
    high, low = np.maximum(red, green), np.minimum(red, green)
    a, b, c = np.maximum(high, blue), np.maximum(low, np.minimum(high, blue)), np.minimum(low, blue)
    last = first + strides.sum()
    corners = ((first, np.float32(1.0) - a), (first + largest, a - b), (last - smallest, b - c), (last, c))
    result = np.zeros_like(place)
    for channel, values in enumerate(lattice):
        for at, weight in corners:
            result[channel] += np.take(values, at) * weight
    return result


@cache
def _tables() -> tuple[Floats, Floats]:
    """Return the lattice, (3, 33³), clipped at white, and the curve, (4096,). Both are float32 in [0, 1]."""
    from scipy.interpolate import PchipInterpolator  # 25 MB and 0.15 s, which other curves do not need

    steps = np.arange(_SIZE)
    linear = 2.0 ** (_LOWEST_STOP + _STOPS * steps / (_SIZE - 1))
    shares = np.where(steps > max(_SHARES), 1.0, 0.0)
    shares[list(_SHARES)] = list(_SHARES.values())
    corner = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    brightest = corner.max(axis=1, keepdims=True)
    desaturated = linear[corner] + shares[brightest] * (linear[brightest] - linear[corner])
    scale = (np.log2(desaturated) - _LOWEST_STOP) / _STOPS
    lattice = np.minimum(scale / _SHOWN, 1.0)
    curve = PchipInterpolator(np.linspace(0.0, 1.0, len(_NODES)), _NODES)(np.linspace(0.0, 1.0, _CURVE))
    return np.ascontiguousarray(lattice.T, np.float32), np.asarray(curve, np.float32)
