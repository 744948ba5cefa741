"""Pictures of the rooms behind windows and of the windows' curtains, laid out as `valerie.scene.graph.model.Rooms` says.

Rooms are boxes full of boxes, from tables. Their pictures are cast ray by ray, by the light of the window or of one lamp.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urban_street.street.noise import hashed, smoothstep
from urban_street.texels import srgb8
from valerie.scene.graph.model import ROOM_CELLS

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]
Color = tuple[float, float, float]

#: Pixels per side of a cell, and the share that a picture fills.
_CELL, _FILLED = 128, 0.96
#: Width, height and depth of flats and of shops, metres. A picture is taken from one depth in front.
FLAT, SHOP = (3.6, 2.65, 4.0), (4.0, 2.8, 2.6)
#: Share of daylight that two passes through double glazing leave.
_GLAZING: Final = 0.65
#: Area of a window, m².
_PANE: Final = 1.9


class _Thing(NamedTuple):
    """A box in a room: from and to, as shares of its width, height and depth from the left, below and the window; its colour.

    ``stripes`` is the number of things in a row in it, such as books, of different colours. They cast no shadow.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    color: Color
    stripes: int = 0


_WOOD, _WHITE, _DARK, _CLOTH = (0.26, 0.14, 0.07), (0.72, 0.70, 0.66), (0.05, 0.045, 0.04), (0.24, 0.22, 0.24)
_SHELF = (
    _Thing((0.05, 0.0, 0.92), (0.45, 0.80, 1.0), _WOOD),
    *(_Thing((0.07, 0.08 + 0.18 * k, 0.90), (0.43, 0.19 + 0.18 * k, 0.95), (0.5, 0.4, 0.32), 17) for k in range(4)),
)
_DOOR = _Thing((0.68, 0.0, 0.985), (0.92, 0.77, 1.0), (0.58, 0.54, 0.48))
_PICTURE = _Thing((0.58, 0.50, 0.985), (0.82, 0.74, 1.0), (0.34, 0.30, 0.25), 3)
_SOFA = (
    _Thing((0.50, 0.0, 0.70), (0.98, 0.17, 0.95), _CLOTH),
    _Thing((0.50, 0.0, 0.90), (0.98, 0.33, 0.98), _CLOTH),
)
_TABLE = (
    _Thing((0.30, 0.26, 0.35), (0.72, 0.29, 0.62), _WOOD),
    _Thing((0.34, 0.0, 0.38), (0.37, 0.26, 0.42), _WOOD),
    _Thing((0.66, 0.0, 0.56), (0.69, 0.26, 0.60), _WOOD),
    _Thing((0.74, 0.0, 0.40), (0.86, 0.36, 0.56), _DARK),
)
_FLATS: Final = (
    (*_SHELF, *_SOFA, _PICTURE),
    (
        _Thing((0.0, 0.0, 0.86), (0.70, 0.34, 1.0), _WHITE),
        _Thing((0.0, 0.55, 0.91), (0.70, 0.84, 1.0), (0.60, 0.56, 0.48), 4),
        _Thing((0.74, 0.0, 0.84), (0.94, 0.70, 1.0), _WHITE),
        *_TABLE,
    ),
    (
        _Thing((0.10, 0.0, 0.45), (0.62, 0.20, 0.98), (0.50, 0.46, 0.42)),
        _Thing((0.08, 0.0, 0.96), (0.64, 0.40, 1.0), _WOOD),
        _Thing((0.84, 0.0, 0.30), (1.0, 0.82, 0.80), (0.42, 0.35, 0.26), 3),
        _PICTURE,
    ),
    (*_SHELF, *_TABLE, _DOOR),
    (
        _Thing((0.0, 0.0, 0.25), (0.15, 0.75, 0.85), _WOOD, 5),
        _Thing((0.30, 0.42, 0.985), (0.56, 0.72, 1.0), _DARK),
        *_SOFA,
        _DOOR,
    ),
)
_SHELVES = tuple(
    thing
    for k in range(4)
    for thing in (
        _Thing((0.03, 0.10 + 0.19 * k, 0.80), (0.97, 0.115 + 0.19 * k, 1.0), _WHITE),
        _Thing(
            (0.05, 0.115 + 0.19 * k, 0.83),
            (0.95, 0.115 + 0.11 + 0.02 * (k % 3) + 0.19 * k, 0.97),
            (0.5, 0.42, 0.36),
            23 - 4 * k,
        ),
    )
)
_SIDES = tuple(
    thing
    for x in (0.0, 0.88)
    for k in range(4)
    for thing in (
        _Thing((x, 0.10 + 0.19 * k, 0.30), (x + 0.12, 0.115 + 0.19 * k, 0.95), _WHITE),
        _Thing((x + 0.01, 0.115 + 0.19 * k, 0.33), (x + 0.11, 0.23 + 0.19 * k, 0.92), (0.5, 0.42, 0.36), 19 - 3 * k),
    )
)
_SHOPS: Final = (
    (
        *_SIDES,
        *_SHELVES,
        _Thing((0.0, 0.0, 0.02), (1.0, 0.12, 0.30), (0.46, 0.40, 0.32)),
        _Thing((0.12, 0.12, 0.08), (0.90, 0.30, 0.24), (0.52, 0.40, 0.34), 7),
    ),
    (
        _Thing((0.10, 0.0, 0.60), (0.90, 0.36, 0.78), _WOOD),
        _Thing((0.14, 0.36, 0.62), (0.86, 0.46, 0.74), (0.52, 0.44, 0.36), 11),
        *_SHELVES[2:],
        *_SIDES[4:],
    ),
    (
        _Thing((0.0, 0.0, 0.02), (1.0, 0.08, 0.40), (0.60, 0.58, 0.54)),
        *_SIDES[8:],
        *(
            part
            for x, color in ((0.20, (0.30, 0.06, 0.05)), (0.48, (0.06, 0.09, 0.16)), (0.76, (0.42, 0.38, 0.30)))
            for part in (
                _Thing((x - 0.055, 0.38, 0.17), (x + 0.055, 0.61, 0.27), color),
                _Thing((x - 0.045, 0.08, 0.19), (x + 0.045, 0.38, 0.25), _DARK),
                _Thing((x - 0.022, 0.64, 0.19), (x + 0.022, 0.73, 0.25), (0.56, 0.46, 0.38)),
            )
        ),
        _Thing((0.05, 0.20, 0.96), (0.95, 0.86, 1.0), (0.36, 0.33, 0.30), 2),
    ),
)  # fmt: skip
_WALLS: Final[tuple[Color, ...]] = (
    (0.66, 0.62, 0.54), (0.70, 0.68, 0.64), (0.58, 0.46, 0.34), (0.48, 0.54, 0.52), (0.62, 0.52, 0.40),
)  # fmt: skip
_FLOORS: Final[tuple[Color, ...]] = ((0.30, 0.18, 0.10), (0.22, 0.17, 0.13), (0.36, 0.30, 0.24))
#: Linear colours of lamps: about 2,400, 2,700, 3,000 and 4,000 K.
_LAMPS: Final[tuple[Color, ...]] = ((1.0, 0.50, 0.17), (1.0, 0.58, 0.25), (1.0, 0.66, 0.35), (1.0, 0.84, 0.66))


class _Place(NamedTuple):
    """Furniture of the kinds of rooms, their size in metres, colours of walls and lamps, and the cells that lamps light."""

    kinds: tuple[tuple[_Thing, ...], ...]
    size: tuple[float, float, float]
    walls: Sequence[Color]
    lamps: Sequence[Color]
    lit: Collection[int]


def flats(rng: np.random.Generator) -> Image:
    """Return the rooms of flats, (1024, 1024, 4) sRGB. Lamps light six of sixteen."""
    return _pictures(rng, _Place(_FLATS, FLAT, _WALLS, _LAMPS, lit=(1, 4, 7, 10, 13, 15)), curtained=True)


def shops(rng: np.random.Generator) -> Image:
    """Return the insides of shops, (1024, 1024, 4) sRGB, alike at neighbouring panes. Lamps light all."""
    return _pictures(rng, _Place(_SHOPS, SHOP, _WALLS[1:2], _LAMPS[2:3], lit=range(ROOM_CELLS**2)), curtained=False)


def _pictures(rng: np.random.Generator, place: _Place, *, curtained: bool) -> Image:
    side = ROOM_CELLS * _CELL
    color = np.zeros((2 * side, 2 * side, 3), np.float32)
    alpha = np.zeros((2 * side, 2 * side), np.float32)
    for k in range(ROOM_CELLS**2):
        y, x = (side_cell * _CELL for side_cell in divmod(k, ROOM_CELLS))
        by_day, by_lamps = _room(rng, place.kinds[k % len(place.kinds)], place)
        hung_by_day, hung_by_lamps, cover = _hung(rng, k, curtained=curtained)
        for below, right, picture, share in (
            (0, 0, by_day, np.float32(1)), (0, side, by_lamps, np.float32(k in place.lit)),
            (side, 0, hung_by_day, cover), (side, side, hung_by_lamps, cover),
        ):  # fmt: skip
            here = np.s_[below + y : below + y + _CELL, right + x : right + x + _CELL]
            color[here], alpha[here] = picture, share
    return np.dstack([srgb8(color), np.round(alpha * 255).astype(np.uint8)])


def _across() -> tuple[Floats, Floats]:
    """Return the places of a cell's pixels: from −1 at the left and at the top of its picture to 1."""
    along = ((np.arange(_CELL) + 0.5) / _CELL * 2 - 1) / _FILLED
    x, y = np.meshgrid(along.clip(-1, 1), along.clip(-1, 1))
    return x.astype(np.float32), y.astype(np.float32)


def _room(rng: np.random.Generator, things: tuple[_Thing, ...], place: _Place) -> tuple[Floats, Floats]:
    """Return a room by day, as the reflectance of the window's plane, and by its lamp, each (cell, cell, 3)."""
    across, down = _across()
    extent = _vector(place.size)
    wall, floor = (_vector(colors[int(rng.integers(len(colors)))]) for colors in (place.walls, _FLOORS))
    lamp_color = _vector(place.lamps[int(rng.integers(len(place.lamps)))])
    mirrored = rng.random() < 0.5
    eye = _vector((0.5, 0.5, -1.0)) * extent
    ray = np.stack([0.5 * across, -0.5 * down, np.ones_like(across)]) * extent
    # The ray leaves the room at a wall, or meets a thing before.
    ends = (np.where(ray > 0, extent, np.float32(0)) - eye) / _not_zero(ray)
    reach, side = ends.min(0), ends.argmin(0)
    albedo = np.where(side == 1, np.where(ray[1] < 0, floor, np.float32(0.74)), wall)
    solid: list[tuple[Floats, Floats]] = []
    for thing in things:
        low, high = _vector(thing.low), _vector(thing.high)
        if mirrored:
            low[0], high[0] = 1 - high[0], 1 - low[0]
        enter, axes = _entered(eye, ray, low * extent, high * extent)
        seen = enter < reach
        tint = _vector(thing.color)
        if thing.stripes:
            row = 0 if high[0] - low[0] > high[2] - low[2] else 2
            along = (eye[row] + np.where(seen, enter, 0) * ray[row]) / extent[row]
            stripe = np.floor((along - low[row]) / (high[row] - low[row]) * thing.stripes).astype(np.int64)
            seed = int(rng.integers(2**20))
            hue = np.stack([hashed(stripe, seed + c) for c in range(3)])
            tint = tint * (0.25 + 1.4 * (0.3 * hue + 0.7 * hue.mean(0)))
        else:
            solid.append((low * extent, high * extent))
        reach, side, albedo = (
            np.where(seen, enter, reach),
            np.where(seen, axes.argmax(0), side),
            np.where(seen, tint, albedo),
        )
    at = eye + reach * ray
    normal = np.where(np.arange(3)[:, None, None] == side, -np.sign(ray), np.float32(0))
    # Contact shadow in the room's edges: the distance of the second nearest wall.
    crevice = 0.55 + 0.45 * smoothstep(0.0, 0.5, np.partition(np.minimum(at, extent - at), 1, axis=0)[1])
    away = _vector((0.5, 0.55, 0.0)) * extent - at
    squared = (away**2).sum(0)
    cosines = np.maximum((normal * away).sum(0), 0) * np.maximum(-away[2], 0) / squared
    day = albedo * _GLAZING * crevice * (cosines * _PANE / (np.pi * squared + _PANE) + 0.018)
    lamp = _vector((rng.uniform(0.35, 0.65), 0.80, rng.uniform(0.35, 0.6))) * extent
    light = (1.1 * _lamp_light(at, normal, lamp, solid) + 0.10) * crevice * np.float32(rng.uniform(0.7, 1.1))
    night = albedo * light * lamp_color
    # The lamp itself, as far as nothing hides it.
    closest = ((lamp - eye) * ray).sum(0) / (ray**2).sum(0)
    miss = np.sqrt(((eye + closest * ray - lamp) ** 2).sum(0))
    night += smoothstep(0.19, 0.15, miss) * (closest < reach) * (1.1 * lamp_color - night)
    return np.moveaxis(day, 0, -1), np.moveaxis(night, 0, -1)


def _vector(values: Sequence[float]) -> Floats:
    """Return a colour or a place, (3, 1, 1)."""
    return np.array(values, np.float32)[:, None, None]


def _not_zero(values: Floats) -> Floats:
    return np.where(np.abs(values) < 1e-6, np.float32(1e-6), values)


def _entered(start: Floats, ray: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return how many times ``ray``, (3, H, W), it is from ``start`` to a box (inf if it misses), and to its faces by axis."""
    step = _not_zero(ray)
    first, second = (low - start) / step, (high - start) / step
    near = np.minimum(first, second)
    enter = near.max(0)
    missed = (enter > np.maximum(first, second).min(0)) | (enter < 0)
    return np.where(missed, np.float32(np.inf), enter), near


def _lamp_light(at: Floats, normal: Floats, lamp: Floats, boxes: list[tuple[Floats, Floats]]) -> Floats:
    """Return the light of a lamp, about 1 at one metre, with shadows of the boxes."""
    away = lamp - at
    squared = (away**2).sum(0)
    hidden = np.zeros(squared.shape, np.bool_)
    for low, high in boxes:
        hidden |= _entered(at + np.float32(0.02) * normal, away, low, high)[0] < 0.98
    light: Floats = np.maximum((normal * away).sum(0), 0) / np.sqrt(squared) * (1 - 0.75 * hidden) / (squared + 0.25)
    return light


def _hung(rng: np.random.Generator, k: int, *, curtained: bool) -> tuple[Floats, Floats, Floats]:
    """Return what hangs at pane ``k``: its colour by day and by lamps, (cell, cell, 3), and its opacity, (cell, cell)."""
    x, y = (0.5 * part + 0.5 for part in _across())
    waves = x * rng.uniform(60.0, 110.0) + 1.5 * np.sin(x * 23.0 + k)
    folds = 0.74 + 0.26 * np.sin(waves)
    tone = np.array([0.56, 0.53, 0.47]) * rng.uniform(0.55, 1.1) * rng.uniform(0.9, 1.1, 3)
    cloth, cover = tone * folds[..., None], np.zeros_like(x)
    warm = np.array(_LAMPS[rng.integers(3)]) * rng.uniform(0.5, 0.8)
    behind = 0.45 + 0.75 * np.exp(-(((x - rng.uniform(0.3, 0.7)) / 0.5) ** 2) - ((y - 0.25) / 0.5) ** 2)
    kind = (k * 5 + 2) % 8 if curtained else 8 + k % 4
    if kind in (0, 1, 5):  # drawn to both sides, or nearly closed
        opening = 0.47 if kind == 5 else rng.uniform(0.14, 0.30)
        cover = (np.minimum(x, 1.0 - x) < opening * (1.0 - 0.18 * np.sin(np.pi * y))).astype(np.float32) * 0.96
    elif kind == 2:  # net curtain
        cover = 0.50 + 0.16 * np.sin(waves)
        cloth = cloth * 1.1
    elif kind == 3:  # roller blind, partly down
        edge = rng.uniform(0.25, 0.75)
        cover = smoothstep(edge + 0.004, edge - 0.004, y) * 0.97
        cloth = tone * (1.0 - 0.15 * x[..., None]) * (1.0 - 0.5 * (np.abs(y - edge + 0.02) < 0.012))[..., None]
    elif kind == 4:  # half curtain on a rod
        cover = (y > 0.52) * (0.72 + 0.14 * np.sin(waves))
    elif kind == 6:  # plants on the sill
        cloth = np.zeros_like(cloth)
        for _ in range(3):
            px, tall = rng.uniform(0.15, 0.85), rng.uniform(0.10, 0.22)
            for turn in rng.uniform(-1.1, 1.1, 14):
                along = np.clip((0.93 - y) / tall, 0.0, 1.0)
                leaf = np.abs(x - px - turn * tall * along**1.4) < 0.016 * (1.1 - along)
                leaf &= (y > 0.93 - tall * (1.15 - 0.5 * abs(turn))) & (y < 0.95)
                cloth = np.where(leaf[..., None], np.array([0.03, 0.085, 0.02]) * rng.uniform(0.6, 1.6), cloth)
                cover = np.where(leaf, 1.0, cover)
            pot = (np.abs(x - px) < 0.045) & (y > 0.92)
            cloth, cover = np.where(pot[..., None], np.array([0.30, 0.12, 0.06]), cloth), np.where(pot, 1.0, cover)
        behind = behind * 0.12
    elif kind == 7:  # venetian blind
        slat = (y * 34.0) % 1.0
        cover = (slat < rng.uniform(0.45, 0.85)) * 0.97
        cloth = tone * (0.6 + 0.5 * slat)[..., None]
    elif kind == 8:  # a poster on the pane
        px, py = rng.uniform(0.25, 0.7), rng.uniform(0.5, 0.65)
        cover = ((np.abs(x - px) < 0.14) & (np.abs(y - py) < 0.11)).astype(np.float32)
        print_ = hashed(np.floor(y * 60.0).astype(np.int64), int(rng.integers(2**20))) * (np.abs(x - px) < 0.11)
        cloth = np.array([0.62, 0.58, 0.50]) * (1.0 - 0.8 * (print_ > 0.62))[..., None]
        behind = behind * 0.3
    by_day = cloth * _GLAZING
    by_lamps = cloth * (behind[..., None] if kind in (6, 8) else behind[..., None] * 1.5) * warm
    return by_day.astype(np.float32), by_lamps.astype(np.float32), np.broadcast_to(cover, x.shape).astype(np.float32)
