"""Snowflakes in front of the camera, the same in every engine.

Flakes nearer than 12 m show one by one; farther ones are smaller than a pixel, and part of the extinction of the air. Layers of
cells stand at increasing distances, and a cell holds at most one flake, 3 to 8 mm wide. The raster engine draws them in its
shader (``raster/shaders/flakes.glsl``). `falling` computes the same flakes for other engines. The pattern is fixed in image
coordinates, so that background and layer of a frame agree.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Rectangle
from valerie.rendering.rain import SAMPLES, block_means, random_of, sample_places, smoothstep

Floats = NDArray[np.float32]

#: Radiance of a flake as a share of that of white ground under the same lamps: it shows its lit and its dark side.
FLAKE_VIEW: Final = 0.35
#: Distance of the nearest layer, metres, and the ratio of the distances of two layers. Layers fill the space between them.
_NEAREST, _RATIO, _LAYERS = 0.7, 1.5, 7
#: Edge of a cell at a distance of 1 m, metres. Its volume there is edge² times half a metre.
_EDGE: Final = 0.0632
#: Smallest and largest radius of a flake, half of its fall during the exposure, defocus of a flake at the lens, metres.
_RADIUS: Final = (0.0015, 0.004)
_FALL: Final = 0.0025
_DEFOCUS: Final = (0.001, 12.0)


def chance(flakes: float) -> float:
    """Return the chance that a cell holds a flake, for flakes per cubic metre of air."""
    return flakes * _EDGE**2 * (_RATIO - 1.0)


def snowed_on(
    pixels: Floats, flakes: float, light: NDArray[np.float64], part: Rectangle, image_height: int, focal: float
) -> Floats:
    """Draw falling snow over a part of an image.

    Args:
        pixels: (h, w, 3), linear radiance of the part.
        flakes: flakes per cubic metre of air, 0 without snowfall.
        light: (3,) radiance of a flake.
        part: the rectangle of the pixels in the image.
        image_height: height of the whole image, pixels.
        focal: focal length, pixels.

    Returns:
        (h, w, 3) float32; ``pixels`` itself without snowfall.
    """
    if flakes <= 0.0:
        return pixels
    share = falling(flakes, part, image_height, focal)[..., None]
    return np.asarray(pixels + share * (light.astype(np.float32) - pixels), np.float32)


def falling(flakes: float, part: Rectangle, image_height: int, focal: float) -> Floats:
    """Return the share of each pixel in a part of the image that flakes hide, (h, w) float32 in [0, 1]."""
    place_x, place_y = sample_places(part, image_height)
    samples = np.zeros(place_x.shape, np.float32)
    scale, occupied = np.float32(focal * SAMPLES), np.float32(chance(flakes))
    distance = np.float32(_NEAREST)
    for layer in range(_LAYERS):
        number = np.float32(layer)
        edge = np.float32(_EDGE) / np.sqrt(distance)
        cells_y = place_y / scale * (distance / edge)
        cells_x = place_x / scale * (distance / edge) + cells_y * np.float32(0.35)
        cells_y = cells_y + random_of(np.floor(cells_x), number, np.float32(17.0))
        column, row = np.floor(cells_x), np.floor(cells_y)

        def drawn(salt: float, x: Floats = column, y: Floats = row, z: np.float32 = number) -> Floats:
            return random_of(x + np.float32(salt), y + np.float32(salt), z + np.float32(salt))

        size = drawn(13.0)
        radius = np.float32(_RADIUS[0]) + np.float32(_RADIUS[1] - _RADIUS[0]) * size * size
        soft = np.float32(_DEFOCUS[0]) * (1 - distance / np.float32(_DEFOCUS[1])) + np.float32(0.5) * distance / scale
        off_x = (cells_x - column - np.float32(0.35) - np.float32(0.3) * drawn(5.0)) * edge
        off_y = (cells_y - row - np.float32(0.35) - np.float32(0.3) * drawn(9.0)) * edge
        off_y = off_y - off_y.clip(-_FALL, _FALL)
        reach = radius + soft
        opacity = radius * radius / (reach * reach) * radius / (radius + np.float32(_FALL))
        shape = 1 - smoothstep(np.maximum(radius - soft, 0), reach, np.hypot(off_x, off_y))
        np.maximum(samples, np.where(drawn(0.0) < occupied, opacity * shape, 0), out=samples)
        distance = distance * np.float32(_RATIO)
    return block_means(samples, part)
