"""Optical flow and image velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.model import freeze


@dataclass(frozen=True, slots=True, eq=False)
class FlowMap:
    """The motion of each pixel's surface point across the image.

    Attributes:
        vectors: (H, W, 2) float32, right and down: pixels until the next frame of the sequence (flow), or pixels per second
            (velocity). NaN where the motion is undefined.
    """

    vectors: NDArray[np.float32]

    def __post_init__(self) -> None:
        freeze(self.vectors)

    @property
    def defined(self) -> NDArray[np.bool_]:
        """Mask of the defined vectors, (H, W) bool."""
        return np.isfinite(self.vectors[..., 0]) & np.isfinite(self.vectors[..., 1])
