"""Textures of objects in the street: bark, posters, boards of shops and exits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from urban_street.street.noise import band_noise, hashed, smoothstep, stretched_noise
from urban_street.texels import srgb8

Image = NDArray[np.uint8]

#: Cells along each edge of the sign atlas.


def bark(rng: np.random.Generator) -> Image:
    """Return furrowed grey-brown bark, (256, 256, 3) sRGB, 0.5 m around and 1 m along."""
    furrows = stretched_noise((256, 256), rng, rows=110, columns=18, slope=0.4)
    blotch = band_noise((256, 256), rng, longest=150, shortest=12)
    tone = 0.115 * (1.0 + 0.34 * furrows + 0.15 * blotch)
    lichen = smoothstep(1.0, 2.2, blotch)[..., None]
    return srgb8(tone[..., None] * (np.array([1.0, 0.83, 0.66]) * (1.0 - lichen) + np.array([1.0, 1.1, 0.7]) * lichen))


def bark_of(rng: np.random.Generator, kind: str) -> Image:
    """Return the bark of a kind of tree, (256, 256, 3) sRGB, 0.5 m around and 1 m along.

    ``birch`` is white with dark bands, ``plane`` flakes in patches of olive and cream, ``cherry`` is dark and banded,
    ``pine`` has reddish plates between dark furrows.
    """
    rings = stretched_noise((256, 256), rng, rows=10, columns=90, slope=0.3)
    patches = band_noise((256, 256), rng, longest=110, shortest=14)
    grain = band_noise((256, 256), rng, longest=8, slope=0.3)[..., None]
    if kind == "birch":
        dark = np.maximum(smoothstep(1.1, 1.7, rings), 0.9 * smoothstep(1.5, 2.1, patches))[..., None]
        color = np.array([0.56, 0.53, 0.48]) * (1.0 - dark) + np.array([0.05, 0.045, 0.04]) * dark
    elif kind == "plane":
        fresh = smoothstep(0.25, 0.4, patches)[..., None]
        old = smoothstep(-0.5, -0.65, patches)[..., None]
        color = np.array([0.20, 0.18, 0.12]) * (1.0 - fresh) + np.array([0.42, 0.39, 0.27]) * fresh
        color = color * (1.0 - old) + np.array([0.11, 0.095, 0.075]) * old
    elif kind == "pine":
        furrow = smoothstep(0.25, -0.15, np.abs(patches) + 0.3 * np.abs(rings))[..., None]
        color = np.array([0.20, 0.105, 0.065]) * (1.0 - furrow) + np.array([0.05, 0.035, 0.028]) * furrow
    else:
        band = smoothstep(0.9, 1.5, rings)[..., None]
        color = np.array([0.085, 0.052, 0.042]) * (1.0 - band) + np.array([0.16, 0.11, 0.085]) * band
    return srgb8(color * (1.0 + 0.08 * grain))


def posters(rng: np.random.Generator) -> Image:
    """Return four posters, (256, 256, 3) sRGB, each with a coloured ground, a large shape and dark marks in place of text."""
    picture = np.zeros((256, 256, 3), np.float32)
    y, x = (np.mgrid[0:128, 0:128] + 0.5) / 128.0
    grounds = ((0.50, 0.48, 0.43), (0.05, 0.08, 0.14), (0.24, 0.07, 0.05), (0.34, 0.36, 0.33))
    for k, paper in enumerate(grounds):
        sheet = np.broadcast_to(np.array(paper), (128, 128, 3)) * (1.1 - 0.3 * y[..., None])
        middle = rng.uniform(0.3, 0.7, 2)
        shape = smoothstep(0.02, -0.02, np.hypot(x - middle[0], 1.2 * (y - 0.4)) - rng.uniform(0.14, 0.26))[..., None]
        sheet = sheet * (1.0 - shape) + np.array(grounds[(k + 1) % 4]) * shape
        ink = np.array([0.02, 0.02, 0.02]) if k % 3 == 0 else np.array([0.7, 0.68, 0.62])
        for line in np.arange(0.68, 0.94, 0.06):
            row = (np.abs(y - line) < 0.016) & (x > 0.12) & (x < rng.uniform(0.5, 0.9))
            marks = row & (hashed((x * 40).astype(np.int64), int(rng.integers(2**31))) < 0.75)
            sheet = np.where(marks[..., None], ink, sheet)
        edge = np.minimum(np.minimum(x, 1.0 - x), np.minimum(y, 1.0 - y)) < 0.015
        row0, column0 = divmod(k, 2)
        picture[row0 * 128 : row0 * 128 + 128, column0 * 128 : column0 * 128 + 128] = np.where(
            edge[..., None], 0.5, sheet
        )
    return srgb8(picture)


def shop_boards() -> Image:
    """Return eight boards of shops in two rows, with marks in place of letters, (256, 512, 3) sRGB."""
    side = 128
    y, x = (np.mgrid[0:side, 0:side] + 0.5) / (side / 2) - 1.0
    grounds = ((0.02, 0.10, 0.06), (0.30, 0.03, 0.03), (0.03, 0.05, 0.14), (0.45, 0.33, 0.08))
    cream = np.array([0.8, 0.76, 0.62])
    rng = np.random.default_rng(19)

    def box(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.floating]:
        inside = np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y))
        return smoothstep(-0.02, 0.02, inside)[..., None]

    boards = []
    for k in range(8):
        board = np.broadcast_to(np.array(grounds[k % 4]), (side, side, 3))
        left = -0.75
        while left < 0.7:
            wide = rng.uniform(0.05, 0.13)
            if rng.random() < 0.8:
                stem = box(left, -0.32 if rng.random() < 0.3 else -0.12, left + 0.4 * wide, 0.3)
                bar = 0.9 * box(left, rng.choice([-0.12, 0.08, 0.2]), left + wide, 0.3)
                for mark in (stem, bar):
                    board = board * (1.0 - mark) + cream * mark
            left += wide + 0.05
        boards.append(board)
    picture = np.concatenate([np.concatenate(boards[row : row + 4], axis=1) for row in (0, 4)])
    return srgb8(gaussian_filter(picture, (0.6, 0.6, 0.0)))


#: Letters of the boards, 5 × 7.
_LETTERS = {
    "A": "01110 10001 10001 11111 10001 10001 10001", "F": "11111 10000 10000 11110 10000 10000 10000",
    "H": "10001 10001 10001 11111 10001 10001 10001", "R": "11110 10001 10001 11110 10100 10010 10001",
    "S": "01111 10000 10000 01110 00001 00001 11110", "T": "11111 00100 00100 00100 00100 00100 00100",
    "U": "10001 10001 10001 10001 10001 10001 01110",
}  # fmt: skip


def _written(text: str, height: int) -> NDArray[np.floating]:
    """Return capitals as a mask in 0…1, about ``height`` pixels high."""
    rows = [[[float(bit) for bit in row] for row in _LETTERS[letter].split()] for letter in text]
    dots = np.concatenate([np.pad(np.array(letter), ((1, 1), (0, 1))) for letter in rows], axis=1)
    scale = height // 7
    solid = np.kron(np.pad(dots, ((0, 0), (1, 0))), np.ones((scale, scale)))
    return smoothstep(0.20, 0.36, gaussian_filter(solid, 0.42 * scale))


def exit_boards() -> Image:
    """Return the board at an exit above the one before it, blue with white letters and arrow, (512, 512, 3) sRGB."""
    y, x = (np.mgrid[0:256, 0:512] + 0.5) / 128.0
    picture = []
    for words in (("AUSFAHRT",), ("STRAUFURT", "TRAUSTATT")):
        edge = np.minimum(np.minimum(x, 4.0 - x), np.minimum(y, 2.0 - y))
        white = smoothstep(0.05, 0.065, edge) * smoothstep(0.115, 0.10, edge)
        for k, word in enumerate(words):
            mask = _written(word, 42)
            top, left = 128 + round(64 * (k - 0.5 * len(words))), 30
            white[top : top + mask.shape[0], left : left + mask.shape[1]] += mask
        # an arrow to the upper right
        u, v = 0.7071 * (x - 3.45), 0.7071 * (y - 1.0)
        along, aside = u - v, np.abs(u + v)
        shaft = smoothstep(0.09, 0.07, aside) * smoothstep(-0.42, -0.40, along) * smoothstep(0.22, 0.20, along)
        head = smoothstep(-0.01, 0.01, 0.46 - along - 1.1 * aside) * smoothstep(0.12, 0.14, along)
        white = np.clip(np.maximum(white, np.maximum(shaft, head)), 0.0, 1.0)[..., None]
        picture.append(np.array([0.012, 0.075, 0.36]) * (1.0 - white) + 0.78 * white)
    return srgb8(np.concatenate(picture))


def hedge(rng: np.random.Generator) -> Image:
    """Return clipped foliage with dark gaps, (256, 256, 3) sRGB, 1 m."""
    noise = band_noise((256, 256), rng, longest=14, shortest=3, slope=0.3)
    tone = 0.10 * np.clip(1.0 + 0.55 * noise, 0.12, 2.2)
    return srgb8(tone[..., None] * np.array([0.62, 1.0, 0.28]))
