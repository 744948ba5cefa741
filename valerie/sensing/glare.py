"""Veiling glare: light that the lens scatters over the whole picture.

Surfaces and dust of a lens scatter a small share of its light. The scattered light falls with the square of the angle from its
source: the law of Stiles and Holladay, which also describes the eye (CIE 135/1, "Disability glare", 1999). It veils dark areas
beside the sun, the sky or lamps, and surrounds lamps with a glow. See E.-V. Talvala et al., "Veiling glare in high dynamic range
imaging", ACM TOG 26(3), 2007, doi:10.1145/1276377.1276424.

The law has no scale of its own: every octave of distance receives equal light. The scattered light is therefore the mean of the
levels of an image pyramid (P. Burt and E. Adelson, "The Laplacian pyramid as a compact image code", IEEE Transactions on
Communications 31(4), 1983, doi:10.1109/TCOM.1983.1095851).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.resampling import block_means, enlarged

#: Columns of the finest level, which sets the size of the glow's core. It keeps the glow the same at every resolution.
_COLUMNS: Final = 256

Floats = NDArray[np.float32]


def veiled(linear: Floats, share: float) -> Floats:
    """Return the image, (H, W, 3), with a share of its light scattered by the lens.

    What lies outside the image shines like the border pixel beside it. A uniform image stays as it is.

    Args:
        linear: (H, W, 3) float32.
        share: scattered share of the light, 0…1.
    """
    height, width = linear.shape[:2]
    cell = max(round(width / _COLUMNS), 1)
    levels = [_smoothed(block_means(linear, cell))]
    while max(levels[-1].shape[:2]) > 2:
        levels.append(_smoothed(block_means(levels[-1], 2)))
    scattered = levels.pop()
    count = len(levels) + 1
    while levels:
        finer = levels.pop()
        scattered = finer + enlarged(scattered, 2, *finer.shape[:2])
    scattered = enlarged(scattered, cell, height, width) / np.float32(count)
    return linear + np.float32(share) * (scattered - linear)


def _smoothed(level: Floats) -> Floats:
    """Return a level after the binomial filter 1, 4, 6, 4, 1 along both axes. Border pixels repeat."""
    for axis in (0, 1):
        padding = [(2, 2) if axis == other else (0, 0) for other in range(3)]
        padded = np.moveaxis(np.pad(level, padding, mode="edge"), axis, 0)
        sums = padded[:-4] + padded[4:] + 4.0 * (padded[1:-3] + padded[3:-1]) + 6.0 * padded[2:-2]
        level = np.moveaxis(sums / np.float32(16.0), 0, axis)
    return np.ascontiguousarray(level)
