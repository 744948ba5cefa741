"""The grey levels of a picture, which reveal a picture that shows nothing."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.measures import Measures

#: Largest sum of the three channels of a pixel.
_WHITE: Final = 3 * 255


def picture_levels(picture: NDArray[np.uint8]) -> Measures:
    """Measure a picture: the values of `valerie.measures.Source.PICTURE`.

    Args:
        picture: (H, W, 3) uint8 sRGB.
    """
    pixels = np.bincount(picture.sum(axis=2, dtype=np.uint16).ravel(), minlength=_WHITE + 1) / picture[..., 0].size
    grey = np.arange(_WHITE + 1) / 3
    mean = float(pixels @ grey)
    return {
        "picture_mean": mean,
        "picture_deviation": float(np.sqrt(pixels @ (grey - mean) ** 2)),
        "black_share": float(pixels[0]),
        "white_share": float(pixels[_WHITE]),
    }
