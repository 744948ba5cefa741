"""The choice of lamps with shadow maps, and bounds of the pixels that movables change by lamplight. Numpy only.

Movables change pixels by their shadows. A movable that carries a lamp may change the whole image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np

from valerie.rendering.base import Rectangle, View
from valerie.rendering.lamps import Lamp
from valerie.rendering.projection import Points, light_axes
from valerie.rendering.raster.bounds import covered_rectangle, grown, union
from valerie.rendering.raster.tiles import Mask, TileGrid
from valerie.scene.graph.model import Camera, Matrix

#: Lamps with shadow maps: of those that stand still, and of those that hang on movables. Texels per side of each.
LAMP_TILES: Final = 8
MOVING_TILES: Final = 4
LAMP_MAP: Final = 1024
#: Texels of a map that its filter, and the offset along the normal, reach.
FILTER_TEXELS: Final = 4.0
#: Radians: a wider cone has no useful projection, so such a lamp throws no shadow.
_WIDEST: Final = math.radians(80.0)
#: Metres from a lamp to the nearest thing in its map: its own housing throws no shadow.
_NEAR: Final = 0.25
#: Pixels that samples of neighbours reach.
_FILTERS: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class LampView:
    """The projection of one lamp's shadow map.

    Attributes:
        lamp: the lamp.
        clip_from_world: (4, 4), world to clip space.
        texel: metres of a texel at a distance of one metre along the axis.
    """

    lamp: Lamp
    clip_from_world: Matrix
    texel: float

    @classmethod
    def of(cls, lamp: Lamp) -> LampView:
        """Return the map's projection: a square around the cone."""
        rows = light_axes(-np.array(lamp.direction))
        view = np.eye(4)
        view[:3, :3] = rows
        view[:3, 3] = -rows @ np.array(lamp.position)
        wide = math.tan(lamp.outer) * 1.02
        clip = np.zeros((4, 4))
        clip[0, 0] = clip[1, 1] = 1.0 / wide
        clip[2, 2] = (lamp.reach + _NEAR) / (lamp.reach - _NEAR)
        clip[2, 3] = -2.0 * lamp.reach * _NEAR / (lamp.reach - _NEAR)
        clip[3, 2] = 1.0
        return cls(lamp, clip @ view, 2.0 * wide / LAMP_MAP)


@dataclass(frozen=True, slots=True, eq=False)
class FrameLamps:
    """The lamps of a frame.

    Attributes:
        lit: all that shine, in the scene's order.
        shadowed: those with shadow maps that stand still.
        moving_shadowed: those with shadow maps that hang on movables.
    """

    lit: tuple[Lamp, ...]
    shadowed: tuple[LampView, ...]
    moving_shadowed: tuple[LampView, ...]

    @classmethod
    def seen_by(cls, lit: tuple[Lamp, ...], camera: Camera, view: View) -> FrameLamps:
        """Return the lamps of a frame; those with maps are picked by camera and view alone."""
        return cls(lit, with_shadows(lit, camera), moving_with_shadows(lit, camera, view))

    @property
    def moving(self) -> bool:
        """True if a movable carries a lamp that shines."""
        return any(lamp.movable for lamp in self.lit)

    @property
    def still(self) -> tuple[Lamp, ...]:
        """The static lamps: those of an image without movables."""
        return tuple(lamp for lamp in self.lit if not lamp.movable)


def with_shadows(lamps: Sequence[Lamp], camera: Camera) -> tuple[LampView, ...]:
    """Views of the lamps that stand still and whose shadows are drawn: the nearest to the camera, by distance."""
    able = [lamp for lamp in lamps if not lamp.movable and lamp.outer <= _WIDEST]
    able.sort(key=lambda lamp: _distance(lamp, camera))
    return tuple(LampView.of(lamp) for lamp in able[:LAMP_TILES])


def moving_with_shadows(lamps: Sequence[Lamp], camera: Camera, view: View) -> tuple[LampView, ...]:
    """Views of the lamps of movables whose shadows are drawn, strongest first: of those whose light may reach the picture, the
    ones that would light the camera most if they faced it. So a head lamp goes before a tail lamp, and near before far.
    """
    able = [lamp for lamp in lamps if lamp.movable and lamp.outer <= _WIDEST]
    able.sort(key=lambda lamp: -sum(lamp.strength) / max(_distance(lamp, camera), 1.0) ** 2)
    seen = (lamp for lamp in able if not covered_rectangle([light_hull(lamp)], camera, view).empty)
    return tuple(LampView.of(lamp) for lamp in islice(seen, MOVING_TILES))


def light_hull(lamp: Lamp) -> Points:
    """Return (5, 3) points that span all that a lamp may light, with a cone of at most 80°: itself, and a square at its reach."""
    rows = light_axes(-np.array(lamp.direction))
    wide = math.tan(lamp.outer) * lamp.reach
    square = np.array([(x, y, lamp.reach) for x in (-wide, wide) for y in (-wide, wide)])
    hull: Points = np.array(lamp.position) + np.concatenate([np.zeros((1, 3)), square @ rows])
    return hull


def _distance(lamp: Lamp, camera: Camera) -> float:
    return float(np.linalg.norm(np.array(lamp.position) - camera.position))


def with_lamps(
    rectangle: Rectangle, boxes: Sequence[Points], camera: Camera, view: View, lowest: float, lamps: FrameLamps
) -> Rectangle:
    """Return the rectangle that movables change, with what they change by lamplight.

    Args:
        rectangle: what they change without lamps.
        boxes: (8, 3) world corners of the movables' boxes.
        lowest: metres, below which nothing receives light.
    """
    if lamps.moving:
        return Rectangle(0, 0, view.width, view.height)
    for box in boxes:
        for lamp in lamps.shadowed:
            rectangle = union(rectangle, _shadow(box, camera, view, lamp, lowest))
    return rectangle


def lamp_shadowed_tiles(
    grid: TileGrid, boxes: Sequence[Points], camera: Camera, view: View, lowest: float, lamps: FrameLamps
) -> Mask:
    """Return the tiles in which movables may change lamplight; arguments as `with_lamps`."""
    tiles = grid.none()
    if lamps.moving:
        return ~tiles
    for box in boxes:
        for lamp in lamps.shadowed:
            shadow = _shadow(box, camera, view, lamp, lowest)
            bottom = view.height - shadow.y - shadow.height
            tiles |= grid.touching((shadow.x, bottom, shadow.width, shadow.height))
    return tiles


def _shadow(box: Points, camera: Camera, view: View, lamp: LampView, lowest: float) -> Rectangle:
    hull = shadow_hull(box, lamp, lowest)
    if hull is None:
        return Rectangle(0, 0, view.width, view.height)
    seen = covered_rectangle([hull], camera, view) if len(hull) else Rectangle(0, 0, 0, 0)
    return seen if seen.empty else grown(seen, _FILTERS, view)


def shadow_hull(corners: Points, view: LampView, lowest: float) -> Points | None:
    """Return (N, 3) points that span all places that a box keeps a lamp's light from; (0, 3) if the box is out of its reach.

    Args:
        corners: (8, 3) of the box, metres.
        lowest: metres, below which nothing receives light.

    Returns:
        None if the box is so near that its shadow goes anywhere.
    """
    if not within_reach(corners, view.lamp):
        return np.zeros((0, 3))
    lamp = np.array(view.lamp.position)
    middle = corners.mean(axis=0)
    size = float(np.linalg.norm(corners - middle, axis=1).max())
    distance = float(np.linalg.norm(middle - lamp))
    # The reach, at the box, of the filter and of the offset along the normal.
    more = 0.1 + FILTER_TEXELS * view.texel * (distance + size)
    if distance < 2.0 * (size + more):
        return None
    outward = np.sign(corners - middle)
    grown = corners + outward * more
    way = grown - lamp
    length = np.linalg.norm(way, axis=1)
    # Twice the reach: chords between the ends of rays lie nearer than the rays' ends.
    farthest = 2.0 * view.lamp.reach / length
    with np.errstate(divide="ignore"):
        down = np.where(way[:, 2] < -1e-6, (lowest - more - lamp[2]) / np.minimum(way[:, 2], -1e-6), np.inf)
    ends = lamp + way * np.maximum(np.minimum(farthest, down), 1.0)[:, None]
    return np.concatenate([grown, ends])


def within_reach(corners: Points, lamp: Lamp) -> bool:
    """Return True if a lamp's light may reach a box."""
    middle = corners.mean(axis=0)
    size = float(np.linalg.norm(corners - middle, axis=1).max())
    return float(np.linalg.norm(middle - np.array(lamp.position))) < lamp.reach + size
