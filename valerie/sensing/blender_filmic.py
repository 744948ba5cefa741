"""Blender's Filmic view transform, from linear Rec. 709 to display values, without Blender.

As in Blender's OpenColorIO configuration: each channel is put on a logarithmic scale of 25 stops from 2^−12.47, a lattice of
33³ colours (interpolated in tetrahedra) takes the saturation out of highlights, the lower 16.5 stops become the range [0, 1],
and one contrast curve makes display values of it, already with a display's transfer. Middle grey 0.18 becomes 0.5, white is
reached at 16.3.

The lattice and the curve (`blender_filmic.npz`) were sampled from Blender 4.5 LTS itself by
``tools/sample_blender_filmic.py``; Filmic is by Troy Sobotka (https://github.com/sobotka/filmic-blender). Interpolation: J.
Hardeberg and F. Schmitt, "Color printer characterization using a computational geometry approach", IS&T/SID Color Imaging
Conference, 1997.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

_LOWEST_STOP: Final = -12.473931188
_STOPS: Final = 25.0
_TABLE: Final = Path(__file__).with_suffix(".npz")

Floats = NDArray[np.float32]


def blender_filmic(linear: Floats) -> Floats:
    """Display values in [0, 1] of linear ones.

    Args:
        linear: (…, 3), not negative.
    """
    lattice, curve = _tables()
    size = round(len(lattice) ** (1 / 3))
    smallest = np.float32(2.0**_LOWEST_STOP)
    stops = np.log2(np.maximum(linear.reshape(-1, 3), smallest)) - np.float32(_LOWEST_STOP)
    place = np.minimum(stops * np.float32((size - 1) / _STOPS), np.float32(size - 1))
    corner = np.minimum(place.astype(np.int32), size - 2)
    part = place - corner
    log = _interpolated(lattice, corner, part, size)
    index = np.minimum(log, np.float32(1.0)) * np.float32(len(curve) - 1)
    lower = np.minimum(index.astype(np.int32), len(curve) - 2)
    below = curve[lower]
    display: Floats = below + (curve[lower + 1] - below) * (index - lower)
    return display.reshape(linear.shape)


def _interpolated(lattice: Floats, corner: NDArray[np.int32], part: Floats, size: int) -> Floats:
    """(N, 3) values between the lattice's corners: a walk along the axes, the one with the largest part first."""
    strides = np.array([size * size, size, 1], np.int32)
    first = corner @ strides
    largest, smallest = part.argmax(axis=1), part.argmin(axis=1)
    # Where two parts are equal the middle one is whichever is left; where all are, the middle is of no weight.
    middle = np.where(largest == smallest, largest, 3 - largest - smallest)
    rows = np.arange(len(part))
    a, b, c = (part[rows, axis][:, None] for axis in (largest, middle, smallest))
    second = first + strides[largest]
    last = first + strides.sum()
    third = last - strides[smallest]
    one = np.float32(1.0)
    mixed: Floats = (
        lattice[first] * (one - a) + lattice[second] * (a - b) + lattice[third] * (b - c) + lattice[last] * c
    )
    return mixed


@cache
def _tables() -> tuple[Floats, Floats]:
    """The lattice as (33³, 3) and the curve as (4096,), both float32 in [0, 1]."""
    with np.load(_TABLE) as stored:
        lattice, curve = stored["desaturated"].reshape(-1, 3), stored["curve"]
    return lattice.astype(np.float32) / np.float32(65535), curve.astype(np.float32) / np.float32(65535)
