"""JPEG artefacts: the picture goes through a JPEG file (ITU-T T.81) with colour at half resolution, as cameras write it."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def through_jpeg(picture: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB as it reads back from a JPEG file.

    Args:
        picture: (H, W, 3) uint8.
        quality: 1 to 100, on the scale of the Independent JPEG Group.
    """
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=quality, subsampling="4:2:0")
    file.seek(0)
    with Image.open(file) as read:
        return np.array(read, np.uint8)
