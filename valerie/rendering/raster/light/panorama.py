"""What smooth surfaces mirror: a map of the statics and the sky around a spot; `valerie.rendering.raster.spots` takes it."""

from __future__ import annotations

from typing import Final

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points

#: Texels per side of the map without its border, which continues it by one texel on each side.
SIDE: Final = 160
#: Distance of the sky in the map, metres. Surfaces are much nearer.
SKY_DISTANCE: Final = 1000
#: Standard deviation of the blur of the second layer, texels: about 4°.
_BLUR: Final = 3.0


class Panorama:
    """The surroundings of a spot under one light.

    Attributes:
        spot: (3,) metres, world.
        texture: two layers of an octahedral map, sharp and blurred: radiance, and inverse distance in 1/m, of the sky at most
            1 / `SKY_DISTANCE`. Gaps between leaves hardly change its mean.
        known: False as long as the map is empty.
    """

    def __init__(self, gl: moderngl.Context, spot: Points) -> None:
        self.spot = spot
        self.known = False
        side = SIDE + 2
        self.texture = gl.texture_array((side, side, 2), 4, dtype="f2")
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False

    def fill(self, sharp: NDArray[np.float32]) -> None:
        """Set the map, (side, side, 4): radiance and inverse distance."""
        blurred = cv2.GaussianBlur(sharp, (0, 0), _BLUR, borderType=cv2.BORDER_REPLICATE)
        self.texture.write(np.stack([sharp, blurred]).astype(np.float16).tobytes())
        self.known = True

    def release(self) -> None:
        """Free the texture."""
        self.texture.release()
