"""Bilinear interpolation and reduction of images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def bilinear(image: NDArray[np.float32], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
    """Interpolate an image between its pixel centres. Outside the image, its border pixels repeat.

    Args:
        image: (H, W) or (H, W, C).
        x, y: pixel coordinates, whose shapes broadcast; 0 is the centre of the first pixel.

    Returns:
        An array of the common shape S of x and y, or (*S, C).
    """
    height, width = image.shape[:2]
    x, y = np.clip(x, 0.0, width - 1.0), np.clip(y, 0.0, height - 1.0)
    left = np.minimum(x.astype(np.intp), max(width - 2, 0))
    top = np.minimum(y.astype(np.intp), max(height - 2, 0))
    across, down = (x - left).astype(np.float32), (y - top).astype(np.float32)
    first = top * width + left
    right, below = int(width > 1), width * int(height > 1)
    flat: NDArray[np.float32] = image.reshape(height * width, *image.shape[2:])
    if image.ndim == 3:
        across, down = across[..., None], down[..., None]
    upper: NDArray[np.float32] = np.take(flat, first, axis=0)
    lower: NDArray[np.float32] = np.take(flat, first + below, axis=0)
    upper += (np.take(flat, first + right, axis=0) - upper) * across
    lower += (np.take(flat, first + below + right, axis=0) - lower) * across
    lower -= upper
    lower *= down
    upper += lower
    return upper


def block_means(image: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Return the means over squares of ``side`` × ``side`` pixels. Border pixels repeat to complete the last squares.

    Args:
        image: (H, W, C).
        side: pixels.

    Returns:
        (⌈H / side⌉, ⌈W / side⌉, C).
    """
    height, width, channels = image.shape
    padded = np.pad(image, ((0, -height % side), (0, -width % side), (0, 0)), mode="edge")
    rows, columns = padded.shape[0] // side, padded.shape[1] // side
    means: NDArray[np.float32] = padded.reshape(rows, side, columns, side, channels).mean(axis=(1, 3))
    return means


def enlarged(image: NDArray[np.float32], factor: int, height: int, width: int) -> NDArray[np.float32]:
    """Return an image of squares of ``factor`` × ``factor`` pixels (see `block_means`) at ``height`` × ``width`` pixels."""
    x = (np.arange(width)[None, :] + 0.5) / factor - 0.5
    y = (np.arange(height)[:, None] + 0.5) / factor - 0.5
    return bilinear(image, x, y)
