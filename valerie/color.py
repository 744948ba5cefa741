"""Colour in linear Rec. 709, and its encoding as sRGB."""

from __future__ import annotations

from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Float = TypeVar("Float", bound=np.floating[Any])
#: Share of red, green and blue in the luminance of a linear colour (ITU-R BT.709).
LUMINANCE: Final = np.array([0.2126, 0.7152, 0.0722])


def luminance_of(linear: NDArray[Float]) -> NDArray[Float]:
    """Return the luminance of linear colours, (…, 3), in their type."""
    luminance: NDArray[Float] = linear @ LUMINANCE.astype(linear.dtype)
    return luminance


def linear_to_srgb(linear: NDArray[Float]) -> NDArray[Float]:
    """Encode linear values in [0, 1] as sRGB (IEC 61966-2-1:1999, 5.3)."""
    encoded: NDArray[Float] = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1.0 / 2.4) - 0.055)
    return encoded


def srgb_to_linear(encoded: NDArray[Float]) -> NDArray[Float]:
    """Decode sRGB values in [0, 1] (IEC 61966-2-1:1999, 5.2)."""
    linear: NDArray[Float] = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear
