"""Stored surface normals: the octahedral map in two 16-bit numbers per pixel.

The map projects the unit sphere onto the octahedron |x| + |y| + |z| = 1 and unfolds it to a square (Cigolle et al. 2014, "A
survey of efficient representations for independent unit vectors", JCGT 3(2)). Rounding to 16 bits per side changes a vector by
at most 0.004°.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.model import freeze

#: Both numbers of a pixel without a surface.
NOTHING: Final = -32768
_SCALE: Final = 32767.0


@dataclass(frozen=True, slots=True, eq=False)
class Normals:
    """The world-space surface normals of an image, for the surfaces of the class map.

    A normal is the interpolated vertex normal at the pixel's centre, on the visible side. Normal maps and wetness do not affect
    it.

    Attributes:
        octahedral: (H, W, 2) int16, the octahedral map scaled to ±32767; `NOTHING` twice where there is no surface (sky).
    """

    octahedral: NDArray[np.int16]

    def __post_init__(self) -> None:
        freeze(self.octahedral)

    @property
    def defined(self) -> NDArray[np.bool_]:
        """Mask of the pixels with a surface, (H, W) bool."""
        surface: NDArray[np.bool_] = self.octahedral[..., 0] != NOTHING
        return surface

    def vectors(self) -> NDArray[np.float32]:
        """Return (H, W, 3) float32 unit vectors in the world (x to the right, y ahead, z up); zero on the sky."""
        plane = self.octahedral.astype(np.float32) / np.float32(_SCALE)
        upright = 1.0 - np.abs(plane).sum(axis=-1)
        folded = (1.0 - np.abs(plane[..., ::-1])) * np.where(plane >= 0, 1.0, -1.0)
        plane = np.where((upright < 0)[..., None], folded, plane)
        vectors = np.concatenate([plane, upright[..., None]], axis=-1).astype(np.float32)
        vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
        vectors[~self.defined] = 0.0
        return vectors

    @classmethod
    def of(cls, vectors: NDArray[np.floating]) -> Normals:
        """Encode (H, W, 3) unit vectors; a zero vector means no surface."""
        size = np.abs(vectors).sum(axis=-1)
        surface = size > 0
        scaled = vectors / np.where(surface, size, 1.0)[..., None]
        plane = scaled[..., :2]
        folded = (1.0 - np.abs(plane[..., ::-1])) * np.where(plane >= 0, 1.0, -1.0)
        plane = np.where((scaled[..., 2] < 0)[..., None], folded, plane)
        octahedral = np.rint(plane * _SCALE).astype(np.int16)
        octahedral[~surface] = NOTHING
        return cls(octahedral)
