"""Cards of foliage: four flat sprays of leaves, or of bare twigs, with what lies between them cut out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import ImageDraw
from scipy.ndimage import gaussian_filter

from urban_street.street.plan import Season
from urban_street.street.species import TRANSLUCENCY, Color, Leaf
from urban_street.texels import srgb8

Image = NDArray[np.uint8]
Line = NDArray[np.floating]

#: Cells along each edge of the image, and pixels along each edge of a cell.
CELLS, CELL = 2, 256
#: Texels with less alpha are cut out.
CUTOFF = 0.5
#: Factor of the drawing's resolution.
_FINE = 3
#: Share of leaves by season, and of their full length.
_FULL: dict[Season, tuple[float, float]] = {
    "spring": (0.80, 0.86), "summer": (0.92, 1.0), "autumn": (0.62, 1.0), "winter": (0.0, 1.0),
}  # fmt: skip
_WOOD: Color = (0.060, 0.043, 0.030)


def spray(leaf: Leaf, season: Season, rng: np.random.Generator) -> Image:
    """Return four sprays, (512, 512, 4): sRGB colour and alpha. Twigs enter each cell at the middle of its lower edge."""
    share, size = (1.0, 1.0) if leaf.evergreen else _FULL[season]
    side = CELL * _FINE
    rows = []
    for _ in range(CELLS):
        row = []
        for _ in range(CELLS):
            drawing = _Drawing(side, rng)
            _draw(drawing, leaf, season, share, size * leaf.length)
            row.append(drawing.pixels())
        rows.append(np.concatenate(row, axis=1))
    return _filled(np.concatenate(rows))


class _Drawing:
    """A cell in fine pixels. Coordinates are shares of its side, (right, up), from the middle of its lower edge."""

    def __init__(self, side: int, rng: np.random.Generator) -> None:
        self._side = side
        self._picture = Picture.new("RGBA", (side, side))
        self._draw = ImageDraw.Draw(self._picture)
        self.rng = rng

    def pixels(self) -> NDArray[np.uint8]:
        return np.asarray(self._picture)

    def polygon(self, points: Line, color: Line) -> None:
        # Colours are stored as roots, which keeps dark ones apart in eight bits.
        fill = tuple(round(255.0 * math.sqrt(min(max(float(c), 0.0), 1.0))) for c in color)
        self._draw.polygon(self._at(points), fill=(*fill, 255))

    def twig(self, points: Line, width: float) -> None:
        fill = tuple(round(255.0 * math.sqrt(c * self.rng.uniform(0.7, 1.3))) for c in _WOOD)
        self._draw.line(self._at(points), fill=(*fill, 255), width=max(round(width * self._side), 1), joint="curve")

    def _at(self, points: Line) -> list[tuple[float, float]]:
        return list(map(tuple, ((points * [1.0, -1.0] + [0.5, 1.0]) * self._side).tolist()))


def _draw(drawing: _Drawing, leaf: Leaf, season: Season, share: float, length: float) -> None:
    """Draw one spray: a main twig, side twigs, then leaves from the foot to the tips."""
    rng, color = drawing.rng, np.array(leaf.color(season))
    main = _twig(np.zeros(2), rng.normal(0.0, 0.08), 0.96 - 1.1 * length, rng)
    twigs = [main]
    for pair in range(leaf.twigs):
        for side in (-1.0, 1.0):
            start = main[round((0.12 + 0.66 * (pair + rng.uniform(0.1, 0.9)) / leaf.twigs) * (len(main) - 1))]
            reach = (0.53 - length) * (1.0 - 0.4 * pair / leaf.twigs) * rng.uniform(0.5, 1.15)
            twigs.append(_twig(start, side * rng.uniform(0.65, 1.0), reach, rng))
    for k, twig in enumerate(twigs):
        drawing.twig(twig, 0.016 if k == 0 else 0.009)
        if share == 0.0:  # in winter the finest twigs show
            for at in range(2, len(twig) - 1, 2):
                drawing.twig(_twig(twig[at], rng.uniform(-1.2, 1.2), rng.uniform(0.08, 0.16), rng), 0.0055)
    for twig in sorted(twigs, key=lambda line: line[-1, 1]):
        direction = math.atan2(*(twig[-1] - twig[0]))
        light = rng.uniform(0.72, 1.25)
        places = np.linspace(0.12, 1.0, leaf.along + 1)
        for at in places:
            point = twig[round(at * (len(twig) - 1))]
            for side in (-1.0, 1.0) if at < 1.0 else (0.0,):
                if rng.random() > share:
                    continue
                turn = direction + side * rng.uniform(0.6, 1.25) + rng.normal(0.0, 0.12)
                if leaf.blossoms and season == "spring":
                    _flower(drawing, point, turn, length, color)
                    continue
                # In autumn some leaves are still green.
                green = rng.uniform(0.0, 1.0) ** 3 if season == "autumn" and not leaf.evergreen else 0.0
                tone = (color + green * (np.array(leaf.summer) - color)) / (1.0 - TRANSLUCENCY)
                _leaf(drawing, leaf, point, turn, length * rng.uniform(0.7, 1.12), light * tone)


def _twig(start: Line, turn: float, length: float, rng: np.random.Generator) -> Line:
    """Return a slightly bent line of 17 points; ``turn`` is in radians clockwise from up."""
    steps = np.linspace(0.0, 1.0, 17)
    turns = turn + (rng.normal(0.0, 0.18) - 0.25 * turn) * steps
    moves = np.stack([np.sin(turns), np.cos(turns)], -1)[:-1] * (length / 16.0)
    return np.asarray(start + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)]))


def _leaf(drawing: _Drawing, leaf: Leaf, foot: Line, turn: float, length: float, color: Line) -> None:
    """Draw a leaf, or its leaflets, in two halves of different light, with midrib."""
    rng = drawing.rng
    outline = np.array(leaf.outline)
    tone = rng.uniform(0.68, 1.28) * color * np.exp(rng.normal(0.0, [0.10, 0.05, 0.10]))
    narrow = rng.uniform(0.72, 1.0)  # a leaf turned about its midrib
    stalk = 0.14 * length
    for k in range(leaf.leaflets):
        spread = (k - 0.5 * (leaf.leaflets - 1)) * (0.62 if leaf.leaflets > 3 else 0.30)
        across, along = _axes(turn + spread)
        base = foot + _axes(turn)[1] * stalk
        for side, light in ((1.0, 1.08), (-1.0, 0.86)):
            half = base + length * (outline[:, :1] * side * narrow * across + outline[:, 1:] * along)
            drawing.polygon(np.concatenate([half, base[None]]), tone * light)
        if outline[:, 0].max() > 0.1:
            rib = base + length * np.array([[0.0], [0.92]]) * along
            wide = 0.014 * length * across
            drawing.polygon(np.stack([rib[0] - wide, rib[0] + wide, rib[1]]), tone * 1.45)


def _flower(drawing: _Drawing, foot: Line, turn: float, length: float, color: Line) -> None:
    """Draw a bunch of flowers with five petals and dark hearts."""
    rng = drawing.rng
    for _ in range(3):
        centre = foot + _axes(turn + rng.normal(0.0, 0.5))[1] * length * rng.uniform(0.15, 0.7)
        radius = 0.27 * length * rng.uniform(0.8, 1.1)
        first = rng.uniform(0.0, 2.0 * math.pi)
        tone = color * rng.uniform(0.75, 1.1)
        ring = np.linspace(0.0, 2.0 * math.pi, 9)[:-1]
        for petal in range(5):
            middle = centre + 0.62 * radius * _axes(first + petal * 2.0 * math.pi / 5.0)[1]
            disc = 0.52 * radius * np.stack([np.sin(ring), np.cos(ring)], -1)
            drawing.polygon(middle + disc, tone * rng.uniform(0.9, 1.05))
        drawing.polygon(
            centre + 0.16 * radius * np.stack([np.sin(ring), np.cos(ring)], -1), np.array([0.40, 0.10, 0.13])
        )


def _axes(turn: float) -> tuple[Line, Line]:
    """Return the directions across and along a leaf that points ``turn`` radians clockwise from up."""
    return np.array([math.cos(turn), -math.sin(turn)]), np.array([math.sin(turn), math.cos(turn)])


def _filled(fine: NDArray[np.uint8]) -> Image:
    """Return the image in its final resolution. Cut texels get the colour of what is near, which coarse levels mix in."""
    side = fine.shape[0] // _FINE
    # What was not drawn is black, so sums of colours are those of what was drawn.
    squares, drawn = (np.arange(256, dtype=np.float32) / 255.0) ** 2, np.zeros((side, side, 4), np.float32)
    for row in range(_FINE):
        for column in range(_FINE):
            drawn += squares[fine[row::_FINE, column::_FINE]]
    color, alpha = drawn[..., :3] / _FINE**2, drawn[..., 3] / _FINE**2
    seen = color / np.maximum(alpha, 1e-3)[..., None]
    mean = color.sum(axis=(0, 1)) / max(float(alpha.sum()), 1e-3)
    near, weight = gaussian_filter(color, (6.0, 6.0, 0.0)), gaussian_filter(alpha, 6.0)
    around = (near + 0.02 * mean) / (weight + 0.02)[..., None]
    texels = np.where(alpha[..., None] > 0.25, seen, around)
    # No spray reaches the edge of its cell, so no filter mixes two of them.
    cell = np.minimum(np.arange(side) % CELL, CELL - 1 - np.arange(side) % CELL)
    inside = np.minimum(cell[:, None], cell[None]) >= 2
    return np.concatenate([srgb8(texels), np.round(255.0 * alpha * inside)[..., None].astype(np.uint8)], -1)
