"""Dirt and water drops on the front glass.

The glass is a few centimetres in front of a lens that is focused far away. Dirt and drops are therefore out of focus and
appear as soft-edged patches. Dust absorbs light and scatters a little of the whole scene's light. A drop is a strong lens: it
shows the surroundings small, upside down and strongly blurred.

The specimen determines places and sizes. A higher share keeps the patches of a lower one. After M. Roser and A. Geiger,
"Video-based raindrop detection for improved image registration", ICCV Workshops 2009, doi:10.1109/ICCVW.2009.5457650, and
H. Porav et al., "I can see clearly now: image restoration via de-raining", ICRA 2019, doi:10.1109/ICRA.2019.8793486 (drops
as lenses that invert and shrink); J. Gu et al., "Removing image artifacts due to dirty camera lenses and thin occluders", ACM
TOG 28(5), 2009, doi:10.1145/1618452.1618490 (dust: attenuation and scattering).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.resampling import bilinear, block_means

#: Log-normal radius of patches as a share of the image's width: median, and standard deviation of the logarithm.
_DUST: Final = (0.012, 0.6)
_DROPS: Final = (0.022, 0.45)
#: Share of light that passes the middle of a speck of dust, and the colour that it scatters (factors of the mean light).
_DUST_PASSES: Final = 0.35
_DUST_SCATTERS: Final = np.array([0.30, 0.27, 0.22], np.float32)
#: Distance in the image, pixels, that one pixel across a drop covers. It is negative, since a drop inverts the image.
_DROP_SHRINKS: Final = -5.0
#: Share of light that a drop transmits.
_DROP_PASSES: Final = 0.92
#: Side of the squares over which a drop averages the image, as a share of the image's width.
_DROP_BLUR: Final = 0.04
#: Largest number of patches on a glass.
_MOST: Final = 20_000

Floats = NDArray[np.float32]


class Patches(NamedTuple):
    """The patches on the glass, per pixel of the image.

    Attributes:
        opacity: (H, W) float32 in [0, 1]; 1 in the middle of a patch, soft at its edge.
        x, y: (H, W) float32, centre of the most opaque patch at each pixel, pixels.
    """

    opacity: Floats
    x: Floats
    y: Floats


def dirty(linear: Floats, share: float, seed: int) -> Floats:
    """Return the image, (H, W, 3), through dust that covers ``share`` of the glass."""
    height, width = linear.shape[:2]
    opacity = _patches(width, height, share, seed, *_DUST, round_=False).opacity[..., None]
    scattered = linear.mean(axis=(0, 1), dtype=np.float64).astype(np.float32) * _DUST_SCATTERS
    loss = opacity * np.float32(1.0 - _DUST_PASSES)
    result: Floats = linear + loss * (scattered - linear)
    return result


def rained_on(linear: Floats, share: float, seed: int) -> Floats:
    """Return the image, (H, W, 3), through water drops that cover ``share`` of the glass."""
    height, width = linear.shape[:2]
    patches = _patches(width, height, share, seed, *_DROPS, round_=True)
    rows, columns = np.nonzero(patches.opacity)
    center_x, center_y = patches.x[rows, columns], patches.y[rows, columns]
    cell = max(round(_DROP_BLUR * width), 1)
    small = block_means(linear, cell)
    x = center_x + (columns - center_x) * _DROP_SHRINKS
    y = center_y + (rows - center_y) * _DROP_SHRINKS
    refracted = bilinear(small, (x + 0.5) / cell - 0.5, (y + 0.5) / cell - 0.5) * np.float32(_DROP_PASSES)
    result = linear.copy()
    opacity = patches.opacity[rows, columns][:, None]
    result[rows, columns] += opacity * (refracted - result[rows, columns])
    return result


@lru_cache(maxsize=4)
def _patches(
    width: int, height: int, share: float, seed: int, median: float, spread: float, *, round_: bool
) -> Patches:
    generator = np.random.default_rng(seed)
    # All random numbers are drawn before any patch is placed, so that a higher share begins with the patches of a lower one.
    centers = generator.random((_MOST, 2))
    sizes = np.exp(generator.normal(np.log(median * width), spread, _MOST))
    stretch = np.ones(_MOST) if round_ else np.exp(generator.normal(0.0, 0.3, _MOST))
    opacity = np.zeros((height, width), np.float32)
    x, y = np.zeros_like(opacity), np.zeros_like(opacity)
    area, target = 0, share * width * height
    for (u, v), size, ratio in zip(centers, sizes, stretch, strict=True):
        if area >= target:
            break
        area += _put(opacity, x, y, (u * width - 0.5, v * height - 0.5), (size * ratio, size / ratio))
    for array in (opacity, x, y):
        array.setflags(write=False)
    return Patches(opacity, x, y)


def _put(opacity: Floats, x: Floats, y: Floats, center: tuple[float, float], radii: tuple[float, float]) -> int:
    """Add a patch and return the number of pixels whose opacity it raises to at least one half."""
    height, width = opacity.shape
    left, right = max(int(center[0] - radii[0]), 0), min(int(center[0] + radii[0]) + 2, width)
    top, bottom = max(int(center[1] - radii[1]), 0), min(int(center[1] + radii[1]) + 2, height)
    if left >= right or top >= bottom:
        return 0
    box = (slice(top, bottom), slice(left, right))
    across = (np.arange(left, right) - center[0]) / radii[0]
    down = (np.arange(top, bottom) - center[1]) / radii[1]
    distance = np.hypot(across[None, :], down[:, None])
    rim = np.clip((1.0 - distance) / 0.4, 0.0, 1.0)
    soft = (rim * rim * (3.0 - 2.0 * rim)).astype(np.float32)
    before = opacity[box]
    over = soft > before
    gained = int(np.count_nonzero((soft >= 0.5) & (before < 0.5)))
    opacity[box] = np.where(over, soft, before)
    x[box], y[box] = np.where(over, center[0], x[box]), np.where(over, center[1], y[box])
    return gained
