"""Optical flow and image velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.model import freeze


@dataclass(frozen=True, slots=True, eq=False)
class FlowMap:
    """The motion across the image of each pixel's surface point.

    Attributes:
        vectors: (H, W, 2) float32, to the right and down: pixels until the next frame of the sequence (flow), or pixels per
            second (velocity). NaN where it is not defined.
    """

    vectors: NDArray[np.float32]

    def __post_init__(self) -> None:
        freeze(self.vectors)

    @property
    def defined(self) -> NDArray[np.bool_]:
        """(H, W) bool; true where the vector is defined."""
        return np.isfinite(self.vectors[..., 0]) & np.isfinite(self.vectors[..., 1])
