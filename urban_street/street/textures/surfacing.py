"""Surfaces of places: seamless asphalt without a street's gutters, markings, concrete slabs, grass, crops, gravel."""

from __future__ import annotations

from typing import Final

import numpy as np

from urban_street.street.noise import Field, band_noise, hashed, smoothstep, stretched_noise, toward
from urban_street.street.textures.ground import Image, aggregate
from urban_street.texels import normal_map, roughness_map, srgb8

#: Size of a material's texture, metres across and along. Lanes have one pair of wheel tracks across.
TILES: Final = {
    "asphalt-lane": (3.5, 14.0),
    "asphalt-open": (9.0, 9.0),
    "road-marking": (2.0, 2.0),
    "slabs": (2.4, 2.4),
    "verge": (3.0, 3.0),
    "crops": (3.0, 6.0),
    "stubble": (3.0, 6.0),
    "gravel": (1.5, 1.5),
    "hatching": (4.0, 4.0),
}
_SIZE: Final = 1024


def asphalt(rng: np.random.Generator, size: tuple[float, float], *, tracks: bool) -> tuple[Image, Image, Image]:
    """Return colour, normals (1024²) and roughness (512²) of asphalt that joins itself on all sides.

    Args:
        rng: source of random numbers.
        size: metres across and along.
        tracks: True if tyres have polished two bands, with oil between them.
    """
    shape = (_SIZE, _SIZE)
    texel = (size[0] / _SIZE, size[1] / _SIZE)
    across = ((np.arange(_SIZE, dtype=np.float32) + 0.5) * texel[0])[None]
    cloud = band_noise(shape, rng, longest=700, shortest=60)
    grain = aggregate(shape, rng, texel)
    stones = smoothstep(1.5, 2.4, band_noise(shape, rng, longest=4, slope=0.0))
    albedo: Field = 0.118 * (1.0 + 0.07 * cloud + 0.45 * stones) * np.exp(0.26 * grain - 0.034)
    roughness: Field = (0.90 + 0.03 * grain).astype(np.float32)
    if tracks:
        streaks = stretched_noise(shape, rng, rows=900, columns=30, slope=0.3)
        for offset in (-0.74, 0.74):
            track = np.exp(-(((across - 0.5 * size[0] - offset) / 0.30) ** 2))
            albedo = albedo * (1.0 - (0.13 + 0.03 * streaks) * track)
            roughness = toward(roughness, 0.76, 0.85 * track)
        oil = np.exp(-(((across - 0.5 * size[0]) / 0.25) ** 2)) * (1.0 + 0.5 * streaks)
        albedo = albedo * (1.0 - 0.10 * oil)
    else:
        drips = smoothstep(1.6, 2.6, band_noise(shape, rng, longest=70, shortest=10))
        albedo = albedo * (1.0 - 0.40 * drips)
        roughness = toward(roughness, 0.68, drips)
    height = 0.0007 * grain + 0.0012 * cloud + 0.0006 * stones
    color = albedo[..., None] * np.array([1.0, 0.985, 0.955])
    return srgb8(color), normal_map(height, texel), roughness_map(roughness)


def marking(rng: np.random.Generator) -> Image:
    """Return worn white thermoplastic, (512, 512, 3) sRGB, 2 m."""
    shape = (512, 512)
    wear = smoothstep(0.7, 1.9, band_noise(shape, rng, longest=120, shortest=3, slope=0.7))[..., None]
    grain = 1.0 + 0.07 * band_noise(shape, rng, longest=5, slope=0.0)[..., None]
    dirt = 1.0 + 0.06 * band_noise(shape, rng, longest=300, shortest=20)[..., None]
    white = np.array([0.62, 0.61, 0.58]) * dirt
    return srgb8((white * (1.0 - wear) + 0.16 * wear) * grain)


def slabs(rng: np.random.Generator) -> tuple[Image, Image, Image]:
    """Return colour, normals and roughness of concrete slabs of 30 cm, laid in bond, 2.4 m."""
    shape = (_SIZE, _SIZE)
    place = (np.arange(_SIZE, dtype=np.float32) + 0.5) / _SIZE * 8.0
    row = np.floor(place)[:, None]
    u = place[None] + 0.5 * (row % 2)
    column = np.floor(u) % 8
    v = np.broadcast_to(place[:, None], shape)
    joint = 0.3 * np.minimum(0.5 - np.abs(u - np.floor(u) - 0.5), 0.5 - np.abs(v - row - 0.5))
    head = smoothstep(0.001, 0.006, joint)
    number = (row * 8 + column).astype(np.int64)
    fine = band_noise(shape, rng, longest=5, slope=0.2)
    cloud = band_noise(shape, rng, longest=500, shortest=30)
    spots = smoothstep(1.9, 2.3, band_noise(shape, rng, longest=24, shortest=8))
    tone = (0.26 + 0.07 * hashed(number, int(rng.integers(2**31)))) * (1.0 + 0.10 * fine + 0.07 * cloud)
    tone = tone * (0.35 + 0.65 * head) * (1.0 - 0.35 * spots)
    height = 0.003 * smoothstep(0.0, 0.006, joint) + 0.0003 * fine
    rough = toward(np.full(shape, 0.95, np.float32), 0.84 + 0.03 * cloud, head)
    return (
        srgb8(tone[..., None] * np.array([1.0, 0.985, 0.95])),
        normal_map(height, (2.4 / _SIZE, 2.4 / _SIZE)),
        roughness_map(rough),
    )


def verge(rng: np.random.Generator, green: tuple[float, float, float]) -> Image:
    """Return rough grass around the linear colour ``green``, with dry blades and soil, (512, 512, 3) sRGB, 3 m."""
    shape = (512, 512)
    blades = stretched_noise(shape, rng, rows=14, columns=4, slope=0.1)
    tufts = band_noise(shape, rng, longest=60, shortest=8, slope=0.5)
    patches = band_noise(shape, rng, longest=400, shortest=60)
    dry = smoothstep(0.3, 2.2, patches + 0.6 * blades)[..., None]
    soil = smoothstep(1.5, 2.3, tufts)[..., None]
    color = np.array(green) * (1.0 - dry) + np.array([0.21, 0.18, 0.085]) * dry
    color = color * (1.0 - soil) + np.array([0.085, 0.062, 0.042]) * soil
    return srgb8(color * np.clip(1.0 + 0.30 * blades + 0.18 * tufts, 0.25, 2.2)[..., None])


def crops(rng: np.random.Generator, color: tuple[float, float, float]) -> Image:
    """Return a field in rows along the road around a linear colour, (512, 512, 3) sRGB, 3 m × 6 m."""
    shape = (512, 512)
    across = ((np.arange(512) + 0.5) / 512 * 3.0)[None]
    wobble = 0.03 * band_noise(shape, rng, longest=200, shortest=20)
    rows = 0.5 + 0.5 * np.cos((across + wobble) * 2.0 * np.pi / 0.25)
    blades = stretched_noise(shape, rng, rows=9, columns=5, slope=0.1)
    cloud = band_noise(shape, rng, longest=500, shortest=60)
    cover = smoothstep(0.1, 0.6, rows + 0.35 * blades)[..., None]
    soil = np.array([0.11, 0.078, 0.052])
    return srgb8((soil * (1.0 - cover) + np.array(color) * cover) * (1.0 + 0.25 * blades + 0.10 * cloud)[..., None])


def gravel(rng: np.random.Generator) -> Image:
    """Return crushed stone with dust, (512, 512, 3) sRGB, 1.5 m."""
    shape = (512, 512)
    stones = band_noise(shape, rng, longest=12, shortest=4, slope=0.1)
    cloud = band_noise(shape, rng, longest=300, shortest=30)
    tone = 0.24 * np.clip(1.0 + 0.36 * stones + 0.12 * cloud, 0.15, 2.0)
    return srgb8(tone[..., None] * np.array([1.0, 0.94, 0.84]))


def hatching(rng: np.random.Generator) -> Image:
    """Return asphalt with slanted white bars, (512, 512, 3) sRGB, 4 m: the ground between a road and its exit."""
    shape = (512, 512)
    place = (np.arange(512, dtype=np.float32) + 0.5) / 512
    phase = (place[None] + place[:, None]) % 1.0
    wear = smoothstep(0.8, 1.9, band_noise(shape, rng, longest=60, shortest=3, slope=0.7))
    cover = (smoothstep(0.008, -0.008, np.abs(phase - 0.5) - 0.125) * (1.0 - 0.8 * wear))[..., None]
    grain = np.exp(0.26 * aggregate(shape, rng, (4.0 / 512, 4.0 / 512)) - 0.034)[..., None]
    return srgb8((np.array([0.118, 0.116, 0.113]) * (1.0 - cover) + np.array([0.60, 0.59, 0.56]) * cover) * grain)
