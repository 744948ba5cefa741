"""The class of every pixel from logits of a coarser grid, without logits at full size.

Bilinear interpolation mixes the four logits around a pixel with non-negative weights. Where one class is the largest in all
four, it is the largest in every mixture, so only pixels between different classes have to be interpolated: one in nine in
pictures of traffic.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.perception.running.adaptation import Size

#: Number of logits that are interpolated at once, so that they stay in the processor's cache.
_AT_ONCE: Final = 1 << 17


def upsampled_ids(logits: NDArray[np.float32], size: Size, *, align_corners: bool = False) -> NDArray[np.uint8]:
    """Return the largest channel at every pixel, after bilinear resampling.

    Args:
        logits: (C, h, w), C at most 255.
        size: size of the result.
        align_corners: True if the outermost pixel centres coincide; otherwise pixel centres are at halves.

    Returns:
        (height, width) uint8; of equal logits the smaller channel wins.
    """
    channels, height, width = logits.shape
    flat = logits.reshape(channels, -1)
    coarse = _largest(flat).reshape(height, width)
    if coarse.shape == tuple(size):
        return coarse
    rows, columns = _Axis(height, size.height, align_corners), _Axis(width, size.width, align_corners)
    ids = coarse.take(rows.first, 0).take(columns.first, 1)
    between = np.flatnonzero(_between_classes(coarse).take(rows.first, 0).take(columns.first, 1))
    pixels, answer = np.ascontiguousarray(flat.T), ids.reshape(-1)
    step = max(1, _AT_ONCE // channels)
    for start in range(0, len(between), step):
        places = between[start : start + step]
        row, column = np.divmod(places, size.width)
        left, right, across = columns.first[column], columns.second[column], columns.weight[column, None]
        above, below, down = rows.first[row] * width, rows.second[row] * width, rows.weight[row, None]
        mixed = _mixed(
            _mixed(pixels.take(above + left, 0), pixels.take(above + right, 0), across),
            _mixed(pixels.take(below + left, 0), pixels.take(below + right, 0), across),
            down,
        )
        answer[places] = mixed.argmax(1)
    return ids


class _Axis:
    """The two samples around each pixel of one axis, and the weight of the second."""

    def __init__(self, samples: int, pixels: int, align_corners: bool) -> None:
        if align_corners:
            places = np.arange(pixels) * ((samples - 1) / max(pixels - 1, 1))
        else:
            places = np.maximum((np.arange(pixels) + 0.5) * (samples / pixels) - 0.5, 0.0)
        self.first = np.minimum(places.astype(np.intp), samples - 1)
        self.second = np.minimum(self.first + 1, samples - 1)
        self.weight = (places - self.first).astype(np.float32)


def _largest(logits: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the first of the largest channels of (C, n) logits; ten times as fast as argmax, since channel by channel."""
    best = logits[0].copy()
    ids = np.zeros(best.shape, np.uint8)
    for channel in range(1, len(logits)):
        np.copyto(ids, channel, where=logits[channel] > best)
        np.maximum(best, logits[channel], out=best)
    return ids


def _between_classes(ids: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return (h, w) bool, True where a sample, the next in its row and the two below are not all of one class."""
    different = np.zeros(ids.shape, np.bool_)
    different[:-1] = ids[:-1] != ids[1:]
    different[:, :-1] |= different[:, 1:] | (ids[:, :-1] != ids[:, 1:])
    return different


def _mixed(first: NDArray[np.float32], second: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mixture of two arrays, in the memory of the first."""
    first *= 1.0 - weight
    second *= weight
    first += second
    return first
