"""What large flat panes mirror: one picture for each plane of panes; `valerie.rendering.raster.panes` takes it."""

from __future__ import annotations

from typing import Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points
from valerie.rendering.raster.gl.uniforms import Uniform

#: Largest number of pictures per frame.
PANE_IMAGES: Final = 1
#: Largest number of pixels per side. All textures have this size, for which the driver compiles the shading once.
LARGEST: Final = 264


class PaneImages:
    """Pictures of the statics from the camera's mirror images in some planes, under one light.

    Args:
        gl: the current context.
        planes: (K, 4) unit normal towards the camera, and its product with a point of the plane.
        eyes: (K, 3) metres: the camera's mirror images.
        bases: (K, 3, 3): rows that map a vector from the eye to x and y at the picture's edges times depth, and depth.
        pictures: per plane, (height, width, 4) float16, rows from the bottom: radiance, and depth in metres; 0 where unknown.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        planes: Points,
        eyes: Points,
        bases: NDArray[np.float64],
        pictures: list[NDArray[np.float16]],
    ) -> None:
        sizes = np.ones((PANE_IMAGES, 2))
        sizes[: len(pictures)] = [picture.shape[1::-1] for picture in pictures] or sizes[:0]
        layers = np.zeros((PANE_IMAGES, LARGEST, LARGEST, 4), np.float16)
        for layer, picture in zip(layers, pictures, strict=False):
            layer[: picture.shape[0], : picture.shape[1]] = picture
        self.texture = gl.texture_array((LARGEST, LARGEST, PANE_IMAGES), 4, layers.tobytes(), dtype="f2")
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        self._planes, self._eyes, self._bases = planes, eyes, bases
        self._sizes = sizes

    @property
    def values(self) -> dict[str, Uniform]:
        """The uniforms of ``panes.glsl``."""
        count = len(self._planes)
        fill = PANE_IMAGES - count
        return {
            "pane_count": count,
            "pane_planes": np.concatenate([self._planes, np.zeros((fill, 4))]).reshape(-1),
            "pane_eyes": np.concatenate([self._eyes, np.zeros((fill, 3))]).reshape(-1),
            "pane_rows": np.concatenate([self._bases.reshape(-1, 3), np.zeros((3 * fill, 3))]).reshape(-1),
            "pane_sizes": self._sizes.reshape(-1),
        }

    def release(self) -> None:
        """Free the texture."""
        self.texture.release()
