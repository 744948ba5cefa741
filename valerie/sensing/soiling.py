"""Dust and water drops on the front glass.

The glass is a few centimetres in front of a lens that is focused on the street, so whatever lies on it is far out of focus:
a soft-edged patch. Dust takes light away and scatters a little of the whole scene's light back in. A drop is a strong lens of
its own: through it one sees the surroundings small and upside down, and so blurred that only light and shade are left.

Places and sizes belong to the specimen; a higher share keeps the patches of a lower one. After M. Roser and A. Geiger,
"Video-based raindrop detection for improved image registration", ICCV Workshops 2009, doi:10.1109/ICCVW.2009.5457650, and
H. Porav et al., "I can see clearly now: image restoration via de-raining", ICRA 2019, doi:10.1109/ICRA.2019.8793486 (drops
as lenses that turn and shrink); J. Gu et al., "Removing image artifacts due to dirty camera lenses and thin occluders", ACM
TOG 28(5), 2009, doi:10.1145/1618452.1618490 (dust: attenuation and scattering).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.resampling import bilinear

#: Radius of patches as a share of the image's width: median, and spread of its logarithm.
_DUST: Final = (0.012, 0.6)
_DROPS: Final = (0.022, 0.45)
#: How much light passes the middle of a speck of dust, and what colour it scatters (of the scene's mean light).
_DUST_PASSES: Final = 0.35
_DUST_SCATTERS: Final = np.array([0.30, 0.27, 0.22], np.float32)
#: What is seen in a drop: so many times as large an area, upside down.
_DROP_SHRINKS: Final = -5.0
#: Light that a drop lets through.
_DROP_PASSES: Final = 0.92
#: What is seen through a drop is averaged over squares of this share of the image's width.
_DROP_BLUR: Final = 0.04
#: Most patches on one glass.
_MOST: Final = 20_000

Floats = NDArray[np.float32]


class Patches(NamedTuple):
    """Patches on the glass as far as they cover the picture.

    Attributes:
        opacity: (H, W) float32 in [0, 1]; 1 in the middle of a patch, soft at its edge.
        x, y: (H, W) float32, of the uppermost patch at a pixel: its centre, pixels.
    """

    opacity: Floats
    x: Floats
    y: Floats


def dirty(linear: Floats, share: float, seed: int) -> Floats:
    """(H, W, 3) as seen through dust that covers ``share`` of the glass."""
    height, width = linear.shape[:2]
    opacity = _patches(width, height, share, seed, *_DUST, round_=False).opacity[..., None]
    scattered = linear.mean(axis=(0, 1), dtype=np.float64).astype(np.float32) * _DUST_SCATTERS
    lost = opacity * np.float32(1.0 - _DUST_PASSES)
    seen: Floats = linear + lost * (scattered - linear)
    return seen


def rained_on(linear: Floats, share: float, seed: int) -> Floats:
    """(H, W, 3) as seen through water drops that cover ``share`` of the glass."""
    height, width = linear.shape[:2]
    patches = _patches(width, height, share, seed, *_DROPS, round_=True)
    rows, columns = np.nonzero(patches.opacity)
    center_x, center_y = patches.x[rows, columns], patches.y[rows, columns]
    cell = max(round(_DROP_BLUR * width), 1)
    small = _shrunk(linear, cell)
    x = center_x + (columns - center_x) * _DROP_SHRINKS
    y = center_y + (rows - center_y) * _DROP_SHRINKS
    # Beyond the picture its border goes on.
    through = bilinear(small, (x + 0.5) / cell - 0.5, (y + 0.5) / cell - 0.5) * np.float32(_DROP_PASSES)
    seen = linear.copy()
    opacity = patches.opacity[rows, columns][:, None]
    seen[rows, columns] += opacity * (through - seen[rows, columns])
    return seen


@lru_cache(maxsize=4)
def _patches(
    width: int, height: int, share: float, seed: int, median: float, spread: float, *, round_: bool
) -> Patches:
    generator = np.random.default_rng(seed)
    # All patches are drawn before any is placed, so that a higher share begins with those of a lower one.
    drawn = generator.random((_MOST, 2))
    sizes = np.exp(generator.normal(np.log(median * width), spread, _MOST))
    stretch = np.ones(_MOST) if round_ else np.exp(generator.normal(0.0, 0.3, _MOST))
    opacity = np.zeros((height, width), np.float32)
    x, y = np.zeros_like(opacity), np.zeros_like(opacity)
    covered, wanted = 0, share * width * height
    for (u, v), size, ratio in zip(drawn, sizes, stretch, strict=True):
        if covered >= wanted:
            break
        covered += _put(opacity, x, y, (u * width - 0.5, v * height - 0.5), (size * ratio, size / ratio))
    for array in (opacity, x, y):
        array.setflags(write=False)
    return Patches(opacity, x, y)


def _put(opacity: Floats, x: Floats, y: Floats, center: tuple[float, float], radii: tuple[float, float]) -> int:
    """Lay a patch over the others; returns how many pixels it covers at least half that were covered less before."""
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


def _shrunk(linear: Floats, factor: int) -> Floats:
    """Means over squares of ``factor`` pixels; an incomplete last square repeats the border."""
    height, width = linear.shape[:2]
    padded = np.pad(linear, ((0, -height % factor), (0, -width % factor), (0, 0)), mode="edge")
    rows, columns = padded.shape[0] // factor, padded.shape[1] // factor
    means: Floats = padded.reshape(rows, factor, columns, factor, 3).mean(axis=(1, 3))
    return means
