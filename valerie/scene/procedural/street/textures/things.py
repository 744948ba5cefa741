"""Textures of what stands in the street: bark, leaves, sign faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from valerie.scene.procedural.street.noise import band_noise, hashed, smoothstep, srgb8, stretched_noise

Image = NDArray[np.uint8]

#: The sign atlas has this many cells along each edge.
SIGN_CELLS = 4


def bark(rng: np.random.Generator) -> Image:
    """(256, 256, 3) sRGB: furrowed grey-brown bark, 0.5 m around and 1 m along."""
    furrows = stretched_noise((256, 256), rng, rows=110, columns=18, slope=0.4)
    blotch = band_noise((256, 256), rng, longest=150, shortest=12)
    tone = 0.115 * (1.0 + 0.34 * furrows + 0.15 * blotch)
    lichen = smoothstep(1.0, 2.2, blotch)[..., None]
    return srgb8(tone[..., None] * (np.array([1.0, 0.83, 0.66]) * (1.0 - lichen) + np.array([1.0, 1.1, 0.7]) * lichen))


def leaves(rng: np.random.Generator, hue: tuple[float, float, float]) -> Image:
    """(256, 256, 3) sRGB: a palette of 16 × 16 greens around the linear colour ``hue``, darker rows first."""
    cell = np.arange(256) // 16
    number = cell[:, None] * 16 + cell[None]
    bright = (0.55 + 0.6 * hashed(number, int(rng.integers(2**31)))) * (0.6 + 0.6 * cell[:, None] / 15.0)
    warm = 0.75 + 0.6 * hashed(number, int(rng.integers(2**31)))
    color = np.stack([hue[0] * bright * warm, hue[1] * bright, hue[2] * bright / warm], -1)
    return srgb8(color)


def _disc(x: NDArray[np.floating], y: NDArray[np.floating], radius: float) -> NDArray[np.floating]:
    return smoothstep(radius + 0.02, radius - 0.02, np.hypot(x, y))


def sign_faces() -> Image:
    """(512, 512, 3) sRGB atlas of sign faces, cells row by row, then eight shop boards.

    The faces: no entry, speed limit, no stopping, warning, crossing, parking, one way, yield.
    """
    cell = 512 // SIGN_CELLS
    y, x = (np.mgrid[0:cell, 0:cell] + 0.5) / (cell / 2) - 1.0
    red, white, blue, black = (0.55, 0.015, 0.02), (0.78, 0.78, 0.76), (0.01, 0.08, 0.42), (0.02, 0.02, 0.02)

    def over(
        base: NDArray[np.floating], mask: NDArray[np.floating], color: tuple[float, float, float]
    ) -> NDArray[np.floating]:
        return np.asarray(base * (1.0 - mask[..., None]) + np.array(color) * mask[..., None])

    def plain(color: tuple[float, float, float]) -> NDArray[np.floating]:
        return np.broadcast_to(np.array(color), (cell, cell, 3)).astype(np.float64)

    def box(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.floating]:
        inside = np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y))
        return smoothstep(-0.02, 0.02, inside)

    def triangle(scale: float) -> NDArray[np.floating]:
        edge = np.minimum(
            0.56 * scale - y, np.minimum(0.5 * y + 0.56 * scale - 0.866 * x, 0.5 * y + 0.56 * scale + 0.866 * x)
        )
        return smoothstep(-0.02, 0.02, edge)

    thirty = np.maximum.reduce(
        [
            box(-0.45, -0.35, -0.1, -0.23),
            box(-0.4, -0.06, -0.1, 0.06),
            box(-0.45, 0.23, -0.1, 0.35),
            box(-0.22, -0.35, -0.08, 0.35),
        ]
    )
    zero = np.maximum(box(0.08, -0.35, 0.45, 0.35) - box(0.21, -0.22, 0.32, 0.22), 0.0)
    stripe = smoothstep(0.09, 0.05, np.abs(x - y))
    walker = np.maximum.reduce(
        [
            _disc(x - 0.02, y + 0.42, 0.11),
            box(-0.1, -0.3, 0.12, 0.1),
            box(-0.2, 0.05, -0.05, 0.5),
            box(0.05, 0.05, 0.2, 0.5),
        ]
    )
    letter = np.maximum(
        box(-0.35, -0.6, -0.12, 0.62), _disc(x - 0.05, y + 0.25, 0.36) - _disc(x - 0.05, y + 0.25, 0.15)
    )
    arrow = np.maximum(
        box(-0.14, -0.2, 0.14, 0.7), smoothstep(-0.02, 0.02, np.minimum(-0.15 - y, y + 0.75 - 1.3 * np.abs(x)))
    )
    faces = [
        over(plain(red), box(-0.72, -0.16, 0.72, 0.16), white),
        over(over(plain(red), _disc(x, y, 0.74), white), np.maximum(thirty, zero), black),
        over(over(plain(red), _disc(x, y, 0.78), blue), stripe, red),
        over(over(plain(red), triangle(0.62), white), box(-0.06, -0.25, 0.06, 0.25), black),
        over(over(plain(blue), triangle(1.0), white), walker * triangle(0.9), black),
        over(plain(blue), letter, white),
        over(plain(blue), arrow, white),
        over(plain(red), smoothstep(-0.02, 0.02, np.minimum(y + 0.35, 0.5 - 0.9 * np.abs(x) - 0.5 * y)), white),
    ]
    boards = ((0.02, 0.10, 0.06), (0.30, 0.03, 0.03), (0.03, 0.05, 0.14), (0.45, 0.33, 0.08))
    rng = np.random.default_rng(19)
    for k in range(8):
        face = plain(boards[k % 4])
        left = -0.75
        while left < 0.7:
            wide = rng.uniform(0.05, 0.13)
            if rng.random() < 0.8:
                face = over(
                    face, box(left, -0.32 if rng.random() < 0.3 else -0.12, left + 0.4 * wide, 0.3), (0.8, 0.76, 0.62)
                )
                face = over(face, box(left, rng.choice([-0.12, 0.08, 0.2]), left + wide, 0.3) * 0.9, (0.8, 0.76, 0.62))
            left += wide + 0.05
        faces.append(face)
    picture = np.concatenate([np.concatenate(faces[row * 4 : row * 4 + 4], axis=1) for row in range(4)])
    return srgb8(gaussian_filter(picture, (0.6, 0.6, 0.0)))


def hedge(rng: np.random.Generator) -> Image:
    """(256, 256, 3) sRGB: clipped foliage with dark gaps, 1 m."""
    noise = band_noise((256, 256), rng, longest=14, shortest=3, slope=0.3)
    tone = 0.10 * np.clip(1.0 + 0.55 * noise, 0.12, 2.2)
    return srgb8(tone[..., None] * np.array([0.62, 1.0, 0.28]))
