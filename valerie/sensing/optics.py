"""Vignetting: the falloff of a lens's light towards the image's corners."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


@lru_cache(maxsize=8)
def vignetting(width: int, height: int, focal_px: float, strength: float) -> NDArray[np.float32]:
    """Return the factors of the cos⁴ law, ``cos⁴(θ) ** strength``, with θ the angle from the optical axis to a pixel's ray.

    Strength 1 is the natural falloff of a thin lens. A higher strength adds the shading of barrels and microlenses.
    Source: M. Born and E. Wolf, Principles of Optics, 7th edition, 1999, section 4.8.1; D. Goldman, "Vignette and exposure
    calibration and compensation", IEEE TPAMI 32(12), 2010, doi:10.1109/TPAMI.2010.55.

    Args:
        width, height: pixels.
        focal_px: focal length in pixels.
        strength: exponent.

    Returns:
        (H, W, 1) float32 factors in (0, 1], read-only.
    """
    x = (np.arange(width) + 0.5 - width / 2) / focal_px
    y = (np.arange(height) + 0.5 - height / 2) / focal_px
    # cos²θ = 1 / (1 + tan²θ)
    cosine_squared = 1.0 / (1.0 + x[None, :] ** 2 + y[:, None] ** 2)
    factors: NDArray[np.float32] = (cosine_squared ** (2.0 * strength)).astype(np.float32)[..., None]
    factors.setflags(write=False)
    return factors
