"""Textures of houses: brick, render, stone, tiles, and the rooms behind the glass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urban_street.street.noise import band_noise, hashed, smoothstep, stretched_noise
from urban_street.texels import halved, normal_map, roughness_map, srgb8

Image = NDArray[np.uint8]

#: Sizes of the textures, metres.
BRICK_TILE, RENDER_TILE, STONE_TILE, ROOF_TILE = 4.0, 4.0, 2.0, 2.0
#: Cells along each edge of the interior atlas.
ATLAS_CELLS = 4


def brick(rng: np.random.Generator) -> tuple[Image, Image, Image, Image]:
    """Return red (1024²) and buff colour (512²), normals (1024²), roughness (512²) of a stretcher bond, `BRICK_TILE` metres."""
    size = 1024
    height, joint, tone = _bond(rng, size, courses=48, stretchers=16)
    grain = band_noise((size, size), rng, longest=6, slope=0.3)
    soot = stretched_noise((size, size), rng, rows=900, columns=160)
    mortar = np.array([0.36, 0.33, 0.29]) * (1.0 + 0.06 * grain[..., None])
    clay = np.array([0.27, 0.085, 0.05]) * (0.55 + 0.75 * tone[..., None]) + np.array([0.05, 0.02, 0.01]) * (
        hashed((tone * 2**20).astype(np.int64), 5)[..., None] - 0.3
    )
    clay = clay * (1.0 + 0.13 * grain[..., None])
    red = np.where(joint[..., None] > 0.5, mortar, clay) * (1.0 + 0.05 * soot[..., None])
    sand = np.array([0.46, 0.345, 0.19]) * (0.68 + 0.5 * tone[..., None]) * (1.0 + 0.1 * grain[..., None])
    buff = np.where(joint[..., None] > 0.5, np.array([0.42, 0.39, 0.34]), sand)
    buff = halved(buff)
    # Harder-fired bricks are darker and smoother. Mortar is the roughest.
    rough = (0.78 + 0.14 * tone + 0.02 * grain) * (1.0 - joint) + 0.97 * joint
    normals = normal_map(height, (BRICK_TILE / size, BRICK_TILE / size))
    return srgb8(red), srgb8(buff), normals, roughness_map(rough)


def _bond(
    rng: np.random.Generator, size: int, courses: int, stretchers: int
) -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
    """Return height in metres, joint (0…1) and tone per brick (0…1), each (size, size)."""
    centre = (np.arange(size, dtype=np.float32) + 0.5) / size
    v = centre[:, None] * courses
    course = np.floor(v).astype(np.int64)
    u = centre[None] * stretchers + 0.5 * (course % 2)
    number = np.floor(u).astype(np.int64) % stretchers + course * 131
    length, rise = BRICK_TILE / stretchers, BRICK_TILE / courses
    edge = np.minimum((0.5 - np.abs(u - np.floor(u) - 0.5)) * length, (0.5 - np.abs(v - course - 0.5)) * rise)
    tone = hashed(number, int(rng.integers(2**31)))
    inside = smoothstep(0.003, 0.009, edge)
    height = 0.006 * inside + 0.002 * tone * inside + 0.0004 * band_noise((size, size), rng, longest=8, slope=0.5)
    return height, 1.0 - inside, tone


def render(rng: np.random.Generator) -> tuple[Image, Image, Image]:
    """Return nearly white colour, normals (512²) and roughness (256²) of lime render with runs, `RENDER_TILE` metres."""
    shape = (512, 512)
    runs = stretched_noise(shape, rng, rows=420, columns=14)
    cloud = band_noise(shape, rng, longest=500, shortest=30)
    grain = band_noise(shape, rng, longest=4, slope=0.0)
    tone = 0.9 * (1.0 + 0.035 * cloud - 0.055 * np.maximum(runs, 0.0) + 0.025 * grain)
    tint = np.array([1.0, 0.99, 0.97])
    height = 0.0012 * band_noise(shape, rng, longest=14, shortest=3, slope=0.6) + 0.002 * band_noise(
        shape, rng, longest=90, shortest=30
    )
    normals = normal_map(height, (RENDER_TILE / 512, RENDER_TILE / 512))
    # Rain washes the runs smooth.
    return srgb8(tone[..., None] * tint), normals, roughness_map(0.93 - 0.07 * np.maximum(runs, 0.0) + 0.02 * cloud)


def ashlar(rng: np.random.Generator) -> tuple[Image, Image]:
    """Return nearly white colour and normals (512²) of dressed sandstone, courses of 0.5 m, `STONE_TILE` metres."""
    size = 512
    centre = (np.arange(size, dtype=np.float32) + 0.5) / size * STONE_TILE
    v = centre[:, None] / 0.5
    course = np.floor(v).astype(np.int64)
    u = centre[None] / 1.0 + 0.5 * (course % 2)
    edge = np.minimum((0.5 - np.abs(u - np.floor(u) - 0.5)) * 1.0, (0.5 - np.abs(v - course - 0.5)) * 0.5)
    inside = smoothstep(0.004, 0.022, edge)
    number = np.floor(u).astype(np.int64) % 2 + course * 7
    grain = band_noise((size, size), rng, longest=9, slope=0.4)
    cloud = band_noise((size, size), rng, longest=300, shortest=30)
    tone = (0.76 + 0.16 * hashed(number, int(rng.integers(2**31)))) * (1.0 + 0.05 * grain + 0.05 * cloud)
    tone = tone * (0.6 + 0.4 * inside)
    height = 0.012 * inside + 0.0008 * grain
    return srgb8(tone[..., None] * np.array([1.0, 0.975, 0.94])), normal_map(
        height, (STONE_TILE / size, STONE_TILE / size)
    )


def roof_tiles(rng: np.random.Generator) -> tuple[Image, Image]:
    """Return colour and normals (512²) of interlocking clay tiles, `ROOF_TILE` metres; v grows down the slope."""
    size = 512
    centre = (np.arange(size, dtype=np.float32) + 0.5) / size * ROOF_TILE
    v, u = centre[:, None] / 0.333333, centre[None] / 0.2
    course, column = np.floor(v).astype(np.int64) % 6, np.floor(u).astype(np.int64) % 10
    tone = hashed(course * 17 + column, int(rng.integers(2**31)))
    wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * u)
    lap = v - np.floor(v)
    shade = 0.55 + 0.45 * smoothstep(0.0, 0.18, lap) * (0.7 + 0.3 * wave)
    moss = smoothstep(0.9, 2.0, band_noise((size, size), rng, longest=120, shortest=10))[..., None]
    base = (0.62 + 0.5 * tone) * shade * (1.0 + 0.06 * band_noise((size, size), rng, longest=5, slope=0.2))
    color = base[..., None] * np.array([0.8, 0.8, 0.8]) * (1.0 - 0.35 * moss)
    height = 0.03 * wave + 0.02 * (1.0 - lap)
    return srgb8(color), normal_map(height, (ROOF_TILE / size, ROOF_TILE / size))


def interiors(rng: np.random.Generator) -> Image:
    """Return sixteen dim rooms seen through windows, (512, 512, 3) sRGB, with curtains, blinds, a plant or a lit lamp."""
    cell = 512 // ATLAS_CELLS
    picture = np.zeros((512, 512, 3), np.float32)
    y, x = np.mgrid[0:cell, 0:cell] / cell
    for k in range(ATLAS_CELLS**2):
        room = np.array([0.030, 0.029, 0.028]) * rng.uniform(0.5, 1.5) * (1.3 - 0.6 * y[..., None])
        room = (
            room + 0.02 * rng.uniform(0.0, 1.0) * smoothstep(0.15, 0.0, np.abs(y - rng.uniform(0.05, 0.3)))[..., None]
        )
        kind = k % 5
        folds = 0.72 + 0.28 * np.sin(x * rng.uniform(60.0, 110.0) + 1.5 * np.sin(x * 23.0 + k))
        cloth = np.array([0.42, 0.40, 0.36]) * rng.uniform(0.5, 1.1) * folds[..., None]
        if kind in (0, 1):  # drawn to both sides
            opening = rng.uniform(0.16, 0.34)
            side = (np.minimum(x, 1.0 - x) < opening * (1.0 - 0.25 * np.sin(np.pi * y)))[..., None]
            room = np.where(side, cloth * 0.75, room)
        elif kind == 2:  # net curtain
            room = room * 0.4 + cloth * 0.5 * (0.7 + 0.3 * smoothstep(0.95, 0.4, y)[..., None])
        elif kind == 3:  # roller blind, partly down
            down = rng.uniform(0.25, 0.7)
            room = np.where((y < down)[..., None], np.array([0.40, 0.36, 0.29]) * (1.0 - 0.15 * x[..., None]), room)
        else:  # plants on the sill
            for _ in range(3):
                px, pr = rng.uniform(0.15, 0.85), rng.uniform(0.06, 0.13)
                leaf = np.hypot(x - px, (y - 0.86) * 0.8) + 0.02 * np.sin(x * 90.0) * np.sin(y * 70.0) < pr
                room = np.where(leaf[..., None], np.array([0.03, 0.07, 0.02]), room)
        row, column = divmod(k, ATLAS_CELLS)
        picture[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell] = room
    return srgb8(picture)


def boards(rng: np.random.Generator) -> Image:
    """Return nearly white painted timber for doors and shop fronts, (256, 256, 3) sRGB, with grain along v."""
    grain = stretched_noise((256, 256), rng, rows=200, columns=5)
    return srgb8(np.repeat((0.85 * (1.0 + 0.06 * grain))[..., None], 3, axis=2))


def granite(rng: np.random.Generator) -> Image:
    """Return speckled, nearly white stone for tinting, (256, 256, 3) sRGB, 2 m."""
    speckle = band_noise((256, 256), rng, longest=4, slope=0.0)
    cloud = band_noise((256, 256), rng, longest=200, shortest=16)
    return srgb8(np.repeat((0.84 * (1.0 + 0.08 * speckle + 0.06 * cloud))[..., None], 3, axis=2))
