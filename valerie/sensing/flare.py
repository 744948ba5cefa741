"""Lens flare: ghosts, which are images of the aperture, and a star.

A little light is reflected by one surface of the lens and again by another. Such a pair shows the scene once more, at another
magnification about the centre (negative: upside down) and out of focus, so that a small source becomes the shape of the aperture.
To first order, both follow from the lens alone: S. Lee and E. Eisemann, "Practical real-time lens-flare rendering", Computer
Graphics Forum 32(4), 2013, doi:10.1111/cgf.12145. Coatings give each ghost a colour. Straight blades of the aperture diffract
light across their edges; its density along the rays falls with the square of the distance (Fraunhofer diffraction: M. Born and
E. Wolf, Principles of Optics, 7th edition, 1999, section 8.5).

All light of the image takes part in proportion: the sun as far as nothing hides it, and lamps at night. Light from outside of the
image is missing.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.resampling import bilinear, block_means, enlarged

Floats = NDArray[np.float32]


class Ghost(NamedTuple):
    """The reflection by one pair of surfaces.

    Attributes:
        magnification: distance of the ghost from the centre in that of its source.
        radius: of the aperture's image, as a share of the image's width.
        color: share of the flare per channel.
    """

    magnification: float
    radius: float
    color: tuple[float, float, float]


#: Shares add up to 1 with `STAR`, in each channel.
GHOSTS: Final = (
    Ghost(0.45, 0.020, (0.10, 0.16, 0.14)),
    Ghost(-0.25, 0.014, (0.10, 0.14, 0.18)),
    Ghost(-0.55, 0.032, (0.22, 0.14, 0.10)),
    Ghost(-0.85, 0.055, (0.14, 0.16, 0.22)),
    Ghost(-1.30, 0.090, (0.24, 0.20, 0.16)),
)
STAR: Final = 0.20
#: Blades of the aperture. An even number gives as many rays.
_BLADES: Final = 6
#: Angle of the first ray below the horizontal, radians.
_TURNED: Final = np.deg2rad(15.0)
#: Columns of the image in which the flare is computed; they set the width of the star's rays and the softness of ghosts.
_COLUMNS: Final = 256


def flared(linear: Floats, share: float) -> Floats:
    """Return the image, (H, W, 3), with a share of its light in ghosts and stars.

    Args:
        linear: (H, W, 3) float32.
        share: 0…1.
    """
    from scipy import fft

    height, width = linear.shape[:2]
    cell = max(round(width / _COLUMNS), 1)
    light = np.moveaxis(block_means(linear, cell), 2, 0)
    rows, columns = light.shape[1:]
    kernels = _kernels(rows, columns)
    spectrum = fft.rfft2(light, s=kernels.shape)
    star, *ghosts = (fft.irfft2(spectrum * kernel, s=kernels.shape) for kernel in kernels.spectra)
    # The middle of the image is `middle` from its first cell's centre, and the image is that of the cells, even a cut off one.
    middle_x, middle_y = 0.5 * (width / cell - 1), 0.5 * (height / cell - 1)
    x, y = np.arange(columns)[None, :] - middle_x, np.arange(rows)[:, None] - middle_y
    flare = STAR * np.moveaxis(star[:, :rows, :columns], 0, 2)
    reach = kernels.reach
    for ghost, spread in zip(GHOSTS, ghosts, strict=True):
        around = np.roll(spread, (reach, reach), axis=(1, 2))[:, : rows + 2 * reach, : columns + 2 * reach]
        source_x, source_y = middle_x + x / ghost.magnification, middle_y + y / ghost.magnification
        shown = bilinear(np.ascontiguousarray(np.moveaxis(around, 0, 2)), source_x + reach, source_y + reach)
        flare += np.array(ghost.color, np.float32) / np.float32(ghost.magnification**2) * shown
    # Rounding in the transform leaves values a little below 0.
    scattered = enlarged(np.maximum(flare, np.float32(0.0)), cell, height, width)
    return linear + np.float32(share) * (scattered - linear)


class _Kernels(NamedTuple):
    """The light around a point source, of the star and of each ghost before its magnification, in cells.

    Attributes:
        spectra: (1 + ghosts, rows, columns / 2 + 1) complex64, of kernels that add up to 1.
        shape: of the transformed arrays, so large that nothing meets its own repetition.
        reach: cells by which ghosts extend beyond the image.
    """

    spectra: NDArray[np.complex64]
    shape: tuple[int, int]
    reach: int


@lru_cache(maxsize=2)
def _kernels(rows: int, columns: int) -> _Kernels:
    from scipy import fft

    radii = [ghost.radius / abs(ghost.magnification) * columns for ghost in GHOSTS]
    reach = int(np.ceil(max(radii))) + 2
    high, wide = (fft.next_fast_len(side + max(side, 2 * reach), real=True) for side in (rows, columns))
    y, x = (np.fft.fftfreq(side, 1.0 / side).astype(np.float64) for side in (high, wide))
    kernels = np.stack([_star(x, y[:, None]), *(_aperture(x, y[:, None], radius) for radius in radii)])
    kernels /= kernels.sum(axis=(1, 2), keepdims=True)
    return _Kernels(fft.rfft2(kernels).astype(np.complex64), (high, wide), reach)


def _star(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rays one cell wide, whose density falls with the square of the distance from the source."""
    rays = np.zeros(np.broadcast_shapes(x.shape, y.shape))
    for angle in _TURNED + np.pi * np.arange(_BLADES // 2) / (_BLADES // 2):
        rays += np.maximum(1.0 - np.abs(x * np.sin(angle) - y * np.cos(angle)), 0.0)
    return rays / np.maximum(x**2 + y**2, 1.0)


def _aperture(x: NDArray[np.float64], y: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return a polygon whose corners are ``radius`` away from its centre, with soft edges a cell wide."""
    normals = _TURNED + 2 * np.pi * np.arange(_BLADES) / _BLADES
    apothem = max(radius, 1.0) * np.cos(np.pi / _BLADES)
    sides = np.max([x * np.cos(angle) + y * np.sin(angle) for angle in normals], axis=0)
    inside: NDArray[np.float64] = np.clip(apothem - sides + 0.5, 0.0, 1.0)
    return inside
