"""The materials and textures that all vehicles share, and paints."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from urban_street.texels import srgb8
from urban_street.vehicles.details import PLATES
from urban_street.vehicles.paints import Color, gloss
from valerie.scene.graph.model import Material, Texture

_COMMON: Final = (
    Material("vehicle-gap", (0.006, 0.006, 0.006), roughness=0.95, specular=0.2),
    Material("vehicle-plastic", (0.020, 0.020, 0.021), roughness=0.62),
    Material("vehicle-black-gloss", (0.008, 0.008, 0.009), roughness=0.12, specular=1.2),
    Material("vehicle-glass", (0.006, 0.008, 0.008), roughness=0.04, specular=2.0, transmission=0.5),
    Material("vehicle-lens", (0.06, 0.06, 0.065), roughness=0.05, specular=2.0, transmission=0.75),
    Material("vehicle-chrome", (0.62, 0.63, 0.64), metallic=1.0, roughness=0.12),
    Material("vehicle-satin", (0.42, 0.43, 0.44), metallic=1.0, roughness=0.35),
    Material("vehicle-mirror", (0.55, 0.57, 0.58), metallic=1.0, roughness=0.03),
    Material("vehicle-lamp-housing", (0.10, 0.10, 0.105), metallic=0.6, roughness=0.3),
    Material("vehicle-lamp-white", (0.72, 0.73, 0.75), roughness=0.18, specular=1.4),
    Material("vehicle-lamp-red", (0.42, 0.008, 0.006), roughness=0.10, specular=1.4, signal=True),
    Material("vehicle-lamp-dark-red", (0.12, 0.004, 0.004), roughness=0.08, specular=1.4),
    Material("vehicle-lamp-clear", (0.50, 0.50, 0.51), roughness=0.12, specular=1.4),
    Material("vehicle-amber", (0.50, 0.16, 0.01), roughness=0.15),
    Material("vehicle-trim", (0.34, 0.33, 0.31), roughness=0.9),
    Material("vehicle-interior", (0.022, 0.022, 0.023), roughness=0.75),
    Material("vehicle-fabric", (0.055, 0.055, 0.060), roughness=0.95),
    Material("vehicle-tyre", (0.019, 0.019, 0.0195), roughness=0.85),
    Material("vehicle-rim", (0.50, 0.51, 0.52), metallic=0.9, roughness=0.28),
    Material("vehicle-rim-dark", (0.035, 0.035, 0.037), metallic=0.5, roughness=0.5),
    Material("vehicle-disc", (0.20, 0.19, 0.18), metallic=0.8, roughness=0.45),
    Material("vehicle-plate", (1.0, 1.0, 1.0), "vehicle-plates", roughness=0.45),
    Material("vehicle-box", (0.68, 0.68, 0.67), roughness=0.45),
    Material("vehicle-seat", (0.03, 0.06, 0.16), roughness=0.9),
    Material("vehicle-handrail", (0.62, 0.40, 0.02), roughness=0.4),
    Material("vehicle-display", (0.25, 0.11, 0.01), roughness=0.6, emissive=(0.85, 0.38, 0.03), signal=True),
    Material("vehicle-helmet", (0.55, 0.55, 0.54), roughness=0.25, specular=1.2),
    Material("vehicle-white", (0.70, 0.70, 0.69), roughness=0.22, specular=1.35),
    Material("vehicle-cream", (0.62, 0.56, 0.42), roughness=0.22, specular=1.35),
    Material("vehicle-blue", (0.008, 0.035, 0.24), roughness=0.30),
    Material("vehicle-yellow", (0.62, 0.50, 0.01), roughness=0.30),
    Material("vehicle-red", (0.46, 0.012, 0.010), roughness=0.30),
    Material("vehicle-beacon", (0.010, 0.035, 0.34), roughness=0.06, specular=1.6),
    Material("vehicle-high-visibility", (0.55, 0.62, 0.02), roughness=0.8),
    Material("vehicle-wood", (0.30, 0.19, 0.10), roughness=0.85),
    Material("vehicle-sheet", (0.035, 0.075, 0.055), roughness=0.6),
    Material("vehicle-steel", (0.16, 0.16, 0.165), metallic=0.6, roughness=0.5),
)

#: Radiance of lamps at full strength, linear RGB.
_GLOW: Final[dict[str, Color]] = {
    "vehicle-lamp-white": (14.0, 13.0, 11.5),
    "vehicle-lamp-red": (3.2, 0.06, 0.03),
}


def common_materials(lights: float) -> dict[str, Material]:
    """Return all shared materials. Lamps glow with the share ``lights`` of their full strength."""
    materials = {material.name: material for material in _COMMON}
    if lights > 0.0:
        for name, (red, green, blue) in _GLOW.items():
            materials[name] = replace(materials[name], emissive=(lights * red, lights * green, lights * blue))
    return materials


def paint(name: str, color: Color, metallic: float) -> Material:
    """Return a lacquered paint."""
    return Material(name, color, metallic=metallic, roughness=gloss(metallic), specular=1.35)


_FONT: Final = {
    "A": "01110100011000111111100011000110001", "B": "11110100011000111110100011000111110",
    "C": "01111100001000010000100001000001111", "D": "11110100011000110001100011000111110",
    "E": "11111100001000011110100001000011111", "F": "11111100001000011110100001000010000",
    "H": "10001100011000111111100011000110001", "K": "10001100101010011000101001001010001",
    "L": "10000100001000010000100001000011111", "M": "10001110111010110101100011000110001",
    "N": "10001110011010110011100011000110001", "P": "11110100011000111110100001000010000",
    "R": "11110100011000111110101001001010001", "T": "11111001000010000100001000010000100",
    "U": "10001100011000110001100011000101110", "X": "10001100010101000100010101000110001",
    "0": "01110100011001110101110011000101110", "1": "00100011000010000100001000010001110",
    "2": "01110100010000100010001000100011111", "3": "11110000010000101110000010000111110",
    "4": "00010001100101010010111110001000010", "5": "11111100001111000001000011000101110",
    "6": "01110100001000011110100011000101110", "7": "11111000010001000100010000100001000",
    "8": "01110100011000101110100011000101110", "9": "01110100011000101111000010000101110",
}  # fmt: skip


@lru_cache(maxsize=1)
def plates() -> Texture:
    """Return number plates above one another, 512 × 64 each, with a blue band, letters and figures."""
    rng = np.random.default_rng(np.random.SeedSequence([4711]))
    picture = np.full((64 * PLATES, 512, 3), 0.74, np.float32)
    letters, figures = [c for c in _FONT if c.isalpha()], [c for c in _FONT if c.isdigit()]
    for k in range(PLATES):
        band = picture[64 * k : 64 * (k + 1)]
        band[:, :44] = (0.008, 0.035, 0.28)
        band[14:26, 16:28] = (0.70, 0.52, 0.02)
        words = ["".join(rng.choice(letters, n)) for n in (int(rng.integers(1, 4)), 2)]
        text = f"{words[0]} {words[1]} {''.join(rng.choice(figures, int(rng.integers(3, 5))))}"
        x = 66
        for sign in text:
            if sign != " ":
                _write(band, x, _FONT[sign])
            x += 42 if sign != " " else 22
        band[:2] = band[-2:] = 0.05
        band[:, :2] = band[:, -2:] = 0.05
    return Texture("vehicle-plates", srgb8(picture))


def _write(band: NDArray[np.float32], x: int, bits: str) -> None:
    glyph = np.array([float(b) for b in bits]).reshape(7, 5)
    block = np.kron(glyph, np.ones((6, 6)))[:, : 512 - x]
    area = band[11:53, x : x + block.shape[1]]
    area[block > 0] = 0.015
