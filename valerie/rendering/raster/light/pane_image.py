"""What large flat panes mirror: a picture for the plane of most of them; `valerie.rendering.raster.panes` takes it."""

from __future__ import annotations

from typing import Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points
from valerie.rendering.raster.gl.uniforms import Uniform

#: Largest number of pixels per side. All textures have this size, for which the driver compiles the shading once.
LARGEST: Final = 264
#: Panes within this distance of the plane show its picture, metres.
NEAR_PLANE: Final = 0.6


class PaneImage:
    """A picture of the statics from the camera's mirror image in a plane, under one light.

    Args:
        gl: the current context.
        plane: (4,) unit normal towards the camera, and its product with a point of the plane.
        eye: (3,) metres: the camera's mirror image.
        basis: (3, 3): maps a vector from the eye to x and y at the picture's edges times depth, and depth.
        picture: (height, width, 4) float16, rows from the bottom: radiance, and depth in metres; 0 where unknown.

    Attributes:
        texture: the picture, at the lower left of `LARGEST` texels per side.
        values: the uniforms of ``panes.glsl``.
    """

    def __init__(
        self, gl: moderngl.Context, plane: Points, eye: Points, basis: NDArray[np.float64], picture: NDArray[np.float16]
    ) -> None:
        height, width = picture.shape[:2]
        texels = np.zeros((LARGEST, LARGEST, 4), np.float16)
        texels[:height, :width] = picture
        self.texture = gl.texture((LARGEST, LARGEST), 4, texels.tobytes(), dtype="f2")
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        self.values: dict[str, Uniform] = {
            "pane_plane": plane,
            "pane_near": NEAR_PLANE,
            "pane_eye": eye,
            "pane_basis": basis,
            "pane_size": (width, height),
        }

    def release(self) -> None:
        """Free the texture."""
        self.texture.release()
