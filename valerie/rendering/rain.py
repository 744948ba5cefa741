"""Rain streaks in an image, the same in every engine.

The raster engine draws them in its shader (``streak`` in ``raster/shaders/lighting.frag.glsl``). `streaks` computes the same
cells and drops for other engines. The pattern is fixed in image coordinates, so that background and layer of a frame agree.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Rectangle

Floats = NDArray[np.float32]

#: Opacity in the middle of a streak.
OPACITY: Final = 0.3
_LAYERS: Final = 4
#: Samples per pixel in each direction, as in the raster engine.
SAMPLES: Final = 2


def rained_on(pixels: Floats, drops: float, light: NDArray[np.float64], part: Rectangle, image_height: int) -> Floats:
    """Draw rain streaks over a part of an image.

    Args:
        pixels: (h, w, 3), linear radiance of the part.
        drops: share of the image that streaks cross, 0 without rain (`valerie.rendering.sky.Sky.drops`).
        light: (3,) radiance of a drop, which refracts a wide field of its surroundings.
        part: the rectangle of the pixels in the image.
        image_height: height of the whole image, pixels.

    Returns:
        (h, w, 3) float32; ``pixels`` itself without rain.
    """
    if drops <= 0.0:
        return pixels
    share = np.float32(OPACITY) * streaks(drops, part, image_height)[..., None]
    return np.asarray(pixels + share * (light.astype(np.float32) - pixels), np.float32)


def streaks(drops: float, part: Rectangle, image_height: int) -> Floats:
    """Return the share of each pixel in a part of the image that streaks cover, (h, w) float32 in [0, 1].

    The pattern consists of layers of cells. A cell has at most one drop, stretched by its fall during the exposure.
    """
    place_x, place_y = sample_places(part, image_height)
    samples = np.zeros(place_x.shape, np.float32)
    at_x, at_y = place_x / np.float32(image_height), place_y / np.float32(image_height)
    for layer in range(_LAYERS):
        finer = np.float32(1.0 + 0.7 * layer)
        cells_y = at_y * 5 * finer
        cells_x = at_x * 30 * finer + cells_y * np.float32(0.12)
        number = np.float32(layer)
        cells_y = cells_y + random_of(np.floor(cells_x), number, np.float32(7.0))
        column, row = np.floor(cells_x), np.floor(cells_y)
        centre = np.float32(0.15) + np.float32(0.7) * random_of(column + 11, row + 11, number + 11)
        thin = 1 - smoothstep(0.0, 0.035, np.abs(cells_x - column - centre))
        inside = cells_y - row
        long_side = smoothstep(0.0, 0.3, inside) * (1 - smoothstep(0.5, 0.9, inside))
        falls = random_of(column, row, number) < np.float32(drops * 1.6)
        np.maximum(samples, np.where(falls, thin * long_side / finer, 0), out=samples)
    return block_means(samples, part)


def sample_places(part: Rectangle, image_height: int) -> tuple[Floats, Floats]:
    """Return x and y of the samples of a part of an image, (h · SAMPLES, w · SAMPLES), counted from the lower left corner."""
    y, x = np.indices((part.height * SAMPLES, part.width * SAMPLES), np.float32)
    return x + np.float32(part.x * SAMPLES + 0.5), np.float32((image_height - part.y) * SAMPLES - 0.5) - y


def block_means(samples: Floats, part: Rectangle) -> Floats:
    """Return the means of the samples of each pixel, (h, w)."""
    blocks = samples.reshape(part.height, SAMPLES, part.width, SAMPLES)
    return np.asarray(blocks.mean(axis=(1, 3)), np.float32)


def random_of(x: Floats | np.float32, y: Floats | np.float32, z: Floats | np.float32) -> Floats:
    """Return a pseudo-random number in [0, 1) of a cell, in the shader's precision, since every bit changes the result."""
    parts = [
        (value * np.float32(factor)) % 1 for value, factor in zip((x, y, z), (0.1031, 0.1030, 0.0973), strict=True)
    ]
    mixed = sum(a * (b + np.float32(33.33)) for a, b in zip(parts, (parts[1], parts[2], parts[0]), strict=True))
    p, q, r = (part + mixed for part in parts)
    return np.asarray((p + q) * r % 1, np.float32)


def smoothstep(low: float | Floats, high: float | Floats, x: Floats) -> Floats:
    """Return GLSL's smooth step from 0 at ``low`` to 1 at ``high``."""
    t = ((x - np.float32(low)) / np.float32(high - low)).clip(0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)
