"""A scene's textures on the GPU: square 2D arrays with mip levels, one per size.

A scene may have many textures that nothing visible uses, such as those of unchosen characters. A texture is therefore uploaded
when a drawn surface first needs it. Its array is then created again with one more layer.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from typing import Final

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.color import srgb_to_linear
from valerie.scene.graph.model import Material, Texture

#: Sides of the arrays. An image goes into the smallest array that holds it, resampled unless it has exactly that size.
SIDES: Final = (64, 128, 256, 512, 1024, 2048)
#: Linear value of each sRGB byte (IEC 61966-2-1).
_LINEAR: Final = srgb_to_linear(np.arange(256) / 255)


_SERIALS = count()


@dataclass(frozen=True, slots=True)
class Slot:
    """The location of a texture: the side of its array, and its layer."""

    side: int
    layer: int


class TextureSet:
    """The textures of an asset that drawn surfaces have needed so far.

    Args:
        gl: the GL context; it must be current in every call.
        textures: textures by name, as in `Scene.textures`. The reference keeps their ``id`` from being reused.

    Attributes:
        serial: unique number in this process.
        slots: location of each uploaded texture; it never changes.
        arrays: texture arrays by side.
    """

    def __init__(self, gl: moderngl.Context, textures: Mapping[str, Texture]) -> None:
        self._gl = gl
        self._textures = dict(textures)
        self._means: dict[tuple[str, float | None], tuple[NDArray[np.float64], float]] = {}
        self._metallic: dict[str, float] = {}
        self._layers: dict[int, list[NDArray[np.uint8]]] = {}
        self.serial = next(_SERIALS)
        self.slots: dict[str, Slot] = {}
        self.arrays: dict[int, moderngl.TextureArray] = {}

    def require(self, materials: Iterable[Material]) -> None:
        """Upload the missing textures of these materials."""
        missing = {
            name: place
            for material in materials
            for place, name in enumerate(material.textures)
            if name not in self.slots
        }
        if not missing:
            return
        # Images that are computed when first read are computed in two threads: colours first, since others may follow from them.
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda name: self._textures[name].image, sorted(missing, key=missing.__getitem__)))
        sides: set[int] = set()
        for name in missing:
            image = self._textures[name].image
            side = _side_for(image.shape[0], image.shape[1])
            layers = self._layers.setdefault(side, [])
            self.slots[name] = Slot(side, len(layers))
            layers.append(_as_layer(image, side))
            sides.add(side)
        for side in sorted(sides):
            if side in self.arrays:
                self.arrays.pop(side).release()
            layers = self._layers[side]
            array = self._gl.texture_array((side, side, len(layers)), 4, np.stack(layers))
            array.build_mipmaps()
            array.anisotropy = 8.0
            array.repeat_x = array.repeat_y = True
            self.arrays[side] = array

    def side(self, name: str | None) -> int:
        """Return the side of the array that holds a texture; 0 for no texture."""
        return self.slots[name].side if name is not None else 0

    def mean(self, name: str, cutoff: float | None) -> tuple[NDArray[np.float64], float]:
        """Return the mean linear colour, (3,), of the texels whose alpha is not below the cutoff, and their share."""
        if (name, cutoff) not in self._means:
            texels = self._some_texels(name)
            opaque = texels if cutoff is None or texels.shape[1] < 4 else texels[texels[:, 3] >= 255 * cutoff]
            color = _LINEAR[opaque[:, :3]].mean(axis=0) if len(opaque) else np.zeros(3)
            self._means[name, cutoff] = color, len(opaque) / len(texels)
        return self._means[name, cutoff]

    def mean_metallic(self, name: str) -> float:
        """Return the mean metallic factor of a roughness texture: its blue channel, which is linear."""
        if name not in self._metallic:
            self._metallic[name] = float(self._some_texels(name)[:, 2].mean()) / 255
        return self._metallic[name]

    def _some_texels(self, name: str) -> NDArray[np.uint8]:
        """Return one texel in 35, (N, channels), in steps that match no repeating pattern."""
        image = self._textures[name].image
        return image[::5, ::7].reshape(-1, image.shape[2])

    def release(self) -> None:
        """Free the arrays."""
        for array in self.arrays.values():
            array.release()


def _side_for(height: int, width: int) -> int:
    longest = max(height, width)
    return next((side for side in SIDES if side >= longest), SIDES[-1])


def _as_layer(image: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """Resample an image to (side, side, 4) uint8; it is opaque if it has no alpha."""
    if image.shape[:2] != (side, side):
        shrink = max(image.shape[:2]) > side
        image = np.asarray(
            cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA if shrink else cv2.INTER_LINEAR), np.uint8
        )
    if image.shape[2] == 4:
        return image
    layer = np.full((side, side, 4), 255, np.uint8)
    layer[..., :3] = image
    return layer
