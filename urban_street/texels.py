"""Texels of textures: colours, normals, roughness and metallic as bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from valerie.color import linear_to_srgb

#: Rows of a picture that are encoded together: their intermediate results fit in the cache, which halves the time.
_ROWS = 32


def srgb8(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Encode linear reflectance in [0, 1] as sRGB bytes (IEC 61966-2-1)."""
    pixels = np.empty(linear.shape, np.uint8)
    for row in range(0, len(linear), _ROWS):
        rows = slice(row, row + _ROWS)
        pixels[rows] = np.round(linear_to_srgb(np.clip(linear[rows], 0.0, 1.0)) * 255.0)
    return pixels


def normal_map(height: NDArray[np.floating], texel: tuple[float, float]) -> NDArray[np.uint8]:
    """Encode the tangent-space normals, (H, W, 3), of a periodic height field as in glTF: x right, y up the image, z out.

    Args:
        height: (H, W) metres.
        texel: size of a pixel in metres, across and down.
    """
    across = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / (2.0 * texel[0])
    down = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) / (2.0 * texel[1])
    return normals8(across, down, scale=127.0, zero=128.0)


def normals8(
    across: NDArray[np.floating], down: NDArray[np.floating], *, scale: float, zero: float
) -> NDArray[np.uint8]:
    """Encode the normals, (H, W, 3), of a surface that rises by these slopes, (H, W), to the right and down the image.

    Args:
        scale, zero: a byte is ``zero`` + ``scale`` · the component.
    """
    length = np.sqrt(across * across + down * down + 1.0)
    texels = np.empty((*length.shape, 3), np.uint8)
    for channel, component in enumerate((-across, down, 1.0)):
        texels[..., channel] = np.round(component / length * scale + zero)
    return texels


def roughness_map(roughness: NDArray[np.floating], metallic: NDArray[np.floating] | None = None) -> NDArray[np.uint8]:
    """Encode roughness and metallic for `Material.roughness_texture`, in half the resolution of the colour.

    Args:
        roughness: (H, W) in [0, 1].
        metallic: likewise; None for 0.

    Returns:
        (H / 2, W / 2, 3) uint8.
    """
    texels = np.full((roughness.shape[0] // 2, roughness.shape[1] // 2, 3), 255, np.uint8)
    texels[..., 1] = np.round(np.clip(halved(roughness), 0.0, 1.0) * 255.0)
    texels[..., 2] = 0 if metallic is None else np.round(np.clip(halved(metallic), 0.0, 1.0) * 255.0)
    return texels


def halved(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the means over 2 × 2 pixels of an array (H, W) or (H, W, C)."""
    above, below = values[::2], values[1::2]
    return ((above[:, ::2] + above[:, 1::2]) + (below[:, ::2] + below[:, 1::2])) / 4
