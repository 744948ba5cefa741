"""Procedural textures of cloth, skin, hair, eyes and shoes: seeded numpy, colour in sRGB, normals in glTF's convention.

Cloth textures have the layout of `unwrap`: u runs once around trunk or limb, v from the top down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from urban_street.texels import normals8

Image = NDArray[np.uint8]
Field = NDArray[np.float64]
Colour = tuple[int, int, int]

SIZE: Final = 512
#: Share of the height of a top's texture that shows the trunk; the sleeves are below it.
TRUNK_SHARE: Final = 0.6
SLEEVE_START: Final = 0.62


@dataclass(slots=True, eq=False)
class TextureCanvas:
    """A texture under construction.

    Attributes:
        colour: (H, W, 3) sRGB 0…255.
        height: (H, W) relief in texels.
    """

    colour: Field
    height: Field

    @classmethod
    def plain(cls, colour: Colour, size: int = SIZE) -> TextureCanvas:
        """Return a flat canvas of one colour."""
        return cls(np.tile(np.array(colour, np.float64), (size, size, 1)), np.zeros((size, size)))

    def shade(self, factor: Field) -> None:
        """Multiply the colour by a field, (H, W)."""
        self.colour *= factor[..., None]

    def paint(self, colour: Colour, cover: NDArray[np.floating[Any]]) -> None:
        """Blend towards a colour by a cover, (H, W) in 0…1."""
        share = np.clip(cover, 0.0, 1.0)[..., None]
        self.colour += share * (np.array(colour, np.float64) - self.colour)

    def images(self) -> tuple[Image, Image]:
        """Return colour and normals as textures."""
        return self.image(), self.normals()

    def image(self) -> Image:
        """Return the colour as (H, W, 3) uint8 sRGB."""
        return np.clip(np.rint(self.colour), 0, 255).astype(np.uint8)

    def normals(self) -> Image:
        """Return the tangent-space normals, (H, W, 3) uint8: x along u, y against v, z out."""
        across = 0.5 * (np.roll(self.height, -1, axis=1) - np.roll(self.height, 1, axis=1))
        down = np.gradient(self.height, axis=0)
        return normals8(across, down, scale=127.5, zero=127.5)


def grid(size: int = SIZE) -> tuple[Field, Field]:
    """Return the coordinates u and v of every texel's centre, each (size, size)."""
    line = (np.arange(size) + 0.5) / size
    return np.tile(line, (size, 1)), np.tile(line[:, None], (1, size))


def trunk_grid() -> tuple[Field, Field, NDArray[np.bool_], Field]:
    """Return u and v of a garment's texels, where its trunk is, and the share of the trunk's height, from the neck down."""
    u, v = grid()
    return u, v, v < TRUNK_SHARE, v / TRUNK_SHARE


def noise(random: np.random.Generator, sigma: tuple[float, float], size: int = SIZE) -> Field:
    """Return smooth periodic noise of unit variance; ``sigma`` in texels down and across."""
    field = ndimage.gaussian_filter(random.normal(size=(size, size)), sigma, mode="wrap")
    return np.asarray(field / max(float(field.std()), 1e-9))


def line(distance: Field, width: float) -> Field:
    """Return a soft line of ``width``: 1 at ``distance`` 0 (both in texture units)."""
    return np.asarray(np.exp(-((distance / width) ** 2)))


def weave(canvas: TextureCanvas, random: np.random.Generator, *, contrast: float, relief: float) -> None:
    canvas.shade(1.0 + contrast * (0.6 * noise(random, (0.5, 0.5)) + 0.35 * noise(random, (6.0, 6.0))))
    canvas.height += relief * noise(random, (0.7, 0.7))
    # creases that are too small for the mesh, mostly across the limb
    canvas.height += 5.0 * relief * noise(random, (6.0, 15.0))


def seam(
    canvas: TextureCanvas,
    distance: Field,
    where: Field | NDArray[np.bool_] | bool = True,
    *,
    dark: float = 0.3,
    width: float = 0.004,
) -> None:
    groove = line(distance, width) * np.asarray(where, np.float64)
    canvas.shade(1.0 - dark * groove)
    canvas.height -= 1.6 * groove


def jacket(colour: Colour, metal: Colour, seed: int) -> TextureCanvas:
    """Paint a zipped jacket with hem band, cuffs, yoke and slanted pockets."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.06, relief=0.16)
    u, v, trunk, height = trunk_grid()
    front = np.abs(u - 0.5)
    canvas.height += 2.5 * (line(front - 0.016, 0.010)) * trunk  # the flaps beside the zip
    canvas.paint((12, 12, 13), 0.8 * line(front, 0.004) * trunk)
    teeth = (np.sin(v * SIZE * 2.0) > 0.0) & (front < 0.003)
    canvas.paint(metal, 0.7 * (teeth & trunk))
    for place in (0.25, 0.75):
        seam(canvas, u - place, trunk)
    seam(canvas, height - 0.20, trunk & (front > 0.18))
    band = trunk & (height > 0.915)
    seam(canvas, height - 0.915, trunk)
    canvas.height += 0.5 * np.sin(u * 2.0 * np.pi * 110.0) * band
    slant = np.abs(front - 0.10 - 0.16 * (height - 0.62))
    pocket = trunk & (height > 0.60) & (height < 0.83)
    canvas.paint((8, 8, 9), 0.85 * line(slant, 0.005) * pocket)
    canvas.height += 1.5 * line(slant - 0.012, 0.006) * pocket
    arm = (v - SLEEVE_START) / (1.0 - SLEEVE_START)
    seam(canvas, arm - 0.90, v > SLEEVE_START, width=0.008)
    seam(canvas, u - 0.02, v > SLEEVE_START)
    return canvas


def shirt(colour: Colour, button: Colour, seed: int) -> TextureCanvas:
    """Paint a buttoned shirt with placket, breast pocket, seams and cuffs."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.035, relief=0.10)
    u, v, trunk, height = trunk_grid()
    front = np.abs(u - 0.5)
    canvas.height += 0.9 * (front < 0.017) * trunk
    seam(canvas, front - 0.017, trunk, dark=0.22, width=0.0025)
    for place in np.arange(0.14, 0.95, 0.125):
        distance = np.hypot((u - 0.5) * 1.0, (v - place * TRUNK_SHARE) * 0.75)
        canvas.paint(button, 1.0 * (distance < 0.0058))
        canvas.height += 1.2 * (distance < 0.0058)
    for place in (0.25, 0.75):
        seam(canvas, u - place, trunk, dark=0.18)
    seam(canvas, height - 0.17, trunk & (front > 0.2), dark=0.15)
    seam(canvas, height - 0.965, trunk, dark=0.2, width=0.003)
    box = np.maximum(np.abs(u - 0.41) / 0.045, np.abs(height - 0.43) / 0.085)
    seam(canvas, box - 1.0, trunk, dark=0.25, width=0.06)
    arm = (v - SLEEVE_START) / (1.0 - SLEEVE_START)
    seam(canvas, arm - 0.87, v > SLEEVE_START, dark=0.22, width=0.008)
    seam(canvas, u - 0.02, v > SLEEVE_START, dark=0.15)
    return canvas


def jeans(colour: Colour, thread: Colour, seed: int) -> TextureCanvas:
    """Paint denim: twill, washed out on thighs, knees and seat, with double seams and pockets."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.07, relief=0.12)
    u, v = grid()
    canvas.shade(1.0 + 0.05 * np.sin((u + v) * 2.0 * np.pi * 128.0))
    around = np.abs((u - 0.75 + 0.5) % 1.0 - 0.5)  # distance from the front
    behind = np.abs((u - 0.25 + 0.5) % 1.0 - 0.5)
    fading = 0.9 * line(around, 0.13) * line(v - 0.38, 0.20) + 0.5 * line(around, 0.12) * line(v - 0.62, 0.08)
    fading += 0.6 * line(behind, 0.13) * line(v - 0.22, 0.10)
    canvas.shade(1.0 + 0.42 * fading * (1.0 + 0.15 * noise(random, (3.0, 3.0))))
    whiskers = np.sin((v - 0.35 * around) * 190.0) * line(around, 0.15) * line(v - 0.24, 0.06)
    canvas.shade(1.0 + 0.09 * whiskers)
    _trouser_seams(canvas, u, v, thread)
    return canvas


def trousers(colour: Colour, seed: int) -> TextureCanvas:
    """Paint plain cloth trousers with side seams and pockets."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.05, relief=0.13)
    u, v = grid()
    _trouser_seams(canvas, u, v, None)
    canvas.height += 1.4 * line(u - 0.75, 0.008)  # the ironed crease
    return canvas


def _trouser_seams(canvas: TextureCanvas, u: Field, v: Field, thread: Colour | None) -> None:
    inner = np.minimum(u, 1.0 - u)
    seam(canvas, u - 0.5, dark=0.35)
    seam(canvas, inner, dark=0.3)
    seam(canvas, v - 0.045, dark=0.3, width=0.003)
    seam(canvas, v - 0.985, dark=0.3, width=0.003)
    curve = v - 0.05 - 0.10 * np.sqrt(np.clip((u - 0.52) / 0.17, 0.0, 1.0))
    front_pocket = (u > 0.52) & (u < 0.70) & (v < 0.16)
    seam(canvas, np.where(front_pocket, curve, 1.0), dark=0.4, width=0.004)
    box = np.maximum(np.abs(u - 0.30) / 0.10, np.abs(v - 0.17) / 0.062)
    seam(canvas, box - 1.0, dark=0.3, width=0.05)
    if thread is not None:
        stitch = 0.55 * (np.sin((u + v) * SIZE * 1.3) > -0.2)
        canvas.paint(thread, stitch * (line(u - 0.508, 0.0022) + line(v - 0.977, 0.0018) + line(v - 0.05, 0.0018)))
        canvas.paint(thread, stitch * np.where(front_pocket, line(curve - 0.008, 0.0025), 0.0))
        canvas.paint(thread, stitch * line(box - 0.94, 0.02))


def leather(colour: Colour, accent: Colour, seed: int, *, laces: bool) -> TextureCanvas:
    """Paint a shoe's upper; u runs across (0.5 on top), v from heel to toe."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour, 256)
    canvas.shade(1.0 + 0.04 * noise(random, (2.0, 2.0), 256))
    canvas.height += 0.15 * noise(random, (1.0, 1.0), 256)
    u, v = grid(256)
    top = np.abs(u - 0.5)
    for place in (0.36, 0.76):
        seam(canvas, v - place - 0.5 * top**2, dark=0.25, width=0.008)
    if laces:
        eyelets = (v > 0.42) & (v < 0.74) & (top < 0.10)
        canvas.paint(accent, 0.9 * eyelets * (np.sin(v * 2.0 * np.pi * 16.0) > 0.35))
        canvas.height += 1.2 * eyelets * np.sin(v * 2.0 * np.pi * 16.0)
        stripe = line(np.abs(u - 0.5) - 0.30 + 0.35 * (v - 0.5), 0.03) * (v > 0.30) * (v < 0.62)
        canvas.paint(accent, 0.8 * stripe)
    return canvas


def strands(colour: Colour, seed: int) -> TextureCanvas:
    """Paint hair: streaks along v, darker between the locks."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    fine, locks = noise(random, (60.0, 0.7)), noise(random, (40.0, 5.0))
    canvas.shade(np.clip(1.0 + 0.22 * fine + 0.16 * locks, 0.35, 1.8))
    canvas.height += 0.9 * fine + 3.0 * locks
    return canvas


def eye(iris: Colour, seed: int) -> TextureCanvas:
    """Paint the front of an eyeball; the texture's width is its diameter."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain((226, 219, 213), 64)
    u, v = grid(64)
    radius = np.hypot(u - 0.5, v - 0.5)
    canvas.paint((196, 150, 140), 0.5 * np.clip((radius - 0.30) / 0.15, 0.0, 1.0))
    canvas.paint(iris, np.clip((0.245 - radius) / 0.02, 0.0, 1.0))
    canvas.shade(1.0 - 0.5 * line(radius - 0.235, 0.02) + 0.06 * noise(random, (1.0, 1.0), 64) * (radius < 0.23))
    canvas.paint((8, 7, 7), np.clip((0.10 - radius) / 0.02, 0.0, 1.0))
    return canvas


def skin(colour: Colour, seed: int, size: int = SIZE) -> TextureCanvas:
    """Paint slightly blotchy bare skin."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour, size)
    blotch = noise(random, (9.0, 9.0), size)
    canvas.shade(1.0 + 0.02 * noise(random, (1.2, 1.2), size))
    canvas.colour *= 1.0 + blotch[..., None] * np.array([0.012, 0.026, 0.026])
    canvas.height += 0.10 * noise(random, (0.8, 0.8), size)
    return canvas
