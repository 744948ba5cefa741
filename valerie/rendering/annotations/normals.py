"""Surface normals as they are kept: the octahedral map in two 16-bit numbers per pixel.

The unit sphere is projected onto the octahedron |x| + |y| + |z| = 1 and unfolded to a square (Cigolle et al. 2014, "A survey of
efficient representations for independent unit vectors", JCGT 3(2)). Rounded to 16 bits a side, a vector comes back within
0.004° of itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.model import freeze

#: Both numbers of a pixel in which there is no surface.
NOTHING: Final = -32768
_SCALE: Final = 32767.0


@dataclass(frozen=True, slots=True, eq=False)
class Normals:
    """Which way the surface in each pixel faces, in the world; in step with the class map.

    The interpolated vertex normal of the surface at the pixel's centre, turned to the side that is seen; normal maps and
    wetness do not change it.

    Attributes:
        octahedral: (H, W, 2) int16, the octahedral map scaled to ±32767; `NOTHING` twice where there is no surface (sky).
    """

    octahedral: NDArray[np.int16]

    def __post_init__(self) -> None:
        freeze(self.octahedral)

    @property
    def defined(self) -> NDArray[np.bool_]:
        """(H, W) bool: where there is a surface."""
        there: NDArray[np.bool_] = self.octahedral[..., 0] != NOTHING
        return there

    def vectors(self) -> NDArray[np.float32]:
        """(H, W, 3) float32 unit vectors in the world (x across the street, y along it, z up); zero where there is no surface."""
        plane = self.octahedral.astype(np.float32) / np.float32(_SCALE)
        upright = 1.0 - np.abs(plane).sum(axis=-1)
        folded = (1.0 - np.abs(plane[..., ::-1])) * np.where(plane >= 0, 1.0, -1.0)
        plane = np.where((upright < 0)[..., None], folded, plane)
        found = np.concatenate([plane, upright[..., None]], axis=-1).astype(np.float32)
        found /= np.linalg.norm(found, axis=-1, keepdims=True)
        found[~self.defined] = 0.0
        return found

    @classmethod
    def of(cls, vectors: NDArray[np.floating]) -> Normals:
        """Normals from (H, W, 3) unit vectors; zero vectors stand for no surface."""
        size = np.abs(vectors).sum(axis=-1)
        there = size > 0
        scaled = vectors / np.where(there, size, 1.0)[..., None]
        plane = scaled[..., :2]
        folded = (1.0 - np.abs(plane[..., ::-1])) * np.where(plane >= 0, 1.0, -1.0)
        plane = np.where((scaled[..., 2] < 0)[..., None], folded, plane)
        octahedral = np.rint(plane * _SCALE).astype(np.int16)
        octahedral[~there] = NOTHING
        return cls(octahedral)
