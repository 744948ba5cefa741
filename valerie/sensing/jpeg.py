"""JPEG artefacts: the image passes through a JPEG file (ITU-T T.81) with 4:2:0 chroma subsampling, as in cameras."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def through_jpeg(picture: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Encode an image as JPEG and return the decoded image, (H, W, 3) uint8 sRGB.

    Args:
        picture: (H, W, 3) uint8 sRGB.
        quality: 1 to 100, on the scale of the Independent JPEG Group.
    """
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=quality, subsampling="4:2:0")
    file.seek(0)
    with Image.open(file) as image:
        return np.array(image, np.uint8)
