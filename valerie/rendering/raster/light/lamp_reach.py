"""The choice of lamps with shadow maps, and bounds of the pixels that movables change by lamplight. Uses no GPU.

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
from valerie.rendering.raster.gl.bounds import covered_rectangle, grown, union
from valerie.rendering.raster.gl.tiles import Area, Mask, TileGrid
from valerie.scene.graph.model import Camera, Matrix

#: Largest number of static lamps with shadow maps, and of lamps on movables.
LAMP_TILES: Final = 8
MOVING_TILES: Final = 4
#: Texels per side of a lamp's shadow map.
LAMP_MAP: Final = 1024
#: Reach of a shadow map's filter and of the offset along the normal, texels.
FILTER_TEXELS: Final = 4.0
#: Widest outer angle of a lamp with a shadow, radians. A wider cone has no useful projection.
_WIDEST: Final = math.radians(80.0)
#: Near plane of a lamp's shadow map, metres. It leaves out the lamp's own housing.
_NEAR: Final = 0.25
#: Reach of the filters that blend neighbouring samples, pixels.
_FILTERS: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class LampView:
    """The projection of one lamp's shadow map.

    Attributes:
        lamp: the lamp.
        clip_from_world: (4, 4), world to clip space.
        texel: size of a texel at a distance of one metre along the axis, metres.
    """

    lamp: Lamp
    clip_from_world: Matrix
    texel: float

    @classmethod
    def of(cls, lamp: Lamp) -> LampView:
        """Return the projection of a lamp's map, a square around its cone."""
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
        lit: all lamps that are on, in the scene's order.
        shadowed: the static lamps with shadow maps.
        moving_shadowed: the lamps on movables with shadow maps.
    """

    lit: tuple[Lamp, ...]
    shadowed: tuple[LampView, ...]
    moving_shadowed: tuple[LampView, ...]

    @classmethod
    def seen_by(cls, lit: tuple[Lamp, ...], camera: Camera, view: View) -> FrameLamps:
        """Return the lamps of a frame. The choice of lamps with maps depends only on the lamps, the camera and the view."""
        return cls(lit, with_shadows(lit, camera), moving_with_shadows(lit, camera, view))

    @property
    def moving(self) -> bool:
        """True if a movable carries a lamp that is on."""
        return any(lamp.movable for lamp in self.lit)

    @property
    def still(self) -> tuple[Lamp, ...]:
        """The static lamps, which light an image without movables."""
        return tuple(lamp for lamp in self.lit if not lamp.movable)


def with_shadows(lamps: Sequence[Lamp], camera: Camera) -> tuple[LampView, ...]:
    """Return the views of the static lamps with shadows: those nearest to the camera, nearest first."""
    candidates = [lamp for lamp in lamps if not lamp.movable and lamp.outer <= _WIDEST]
    candidates.sort(key=lambda lamp: _distance(lamp, camera))
    return tuple(LampView.of(lamp) for lamp in candidates[:LAMP_TILES])


def moving_with_shadows(lamps: Sequence[Lamp], camera: Camera, view: View) -> tuple[LampView, ...]:
    """Return the views of the lamps on movables with shadows, strongest first.

    Among the lamps whose light may reach the image, they are those that would light the camera most if they faced it. A head lamp
    thus precedes a tail lamp, and a near lamp a far one.
    """
    candidates = [lamp for lamp in lamps if lamp.movable and lamp.outer <= _WIDEST]
    candidates.sort(key=lambda lamp: -sum(lamp.strength) / max(_distance(lamp, camera), 1.0) ** 2)
    visible = (lamp for lamp in candidates if not covered_rectangle([light_hull(lamp)], camera, view).empty)
    return tuple(LampView.of(lamp) for lamp in islice(visible, MOVING_TILES))


def light_hull(lamp: Lamp) -> Points:
    """Return (5, 3) points that span the space that a lamp with a cone of at most 80° may light: its position and a square."""
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
    """Return the rectangle that movables change, including their changes by lamplight.

    Args:
        rectangle: the rectangle that they change without lamps.
        boxes: (8, 3) world corners of the movables' boxes.
        camera, view: the camera and the size of its image.
        lowest: height of the lowest surface that receives light, metres.
        lamps: the lamps of the frame.
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
    """Return the tiles in which movables may change lamplight. The arguments are those of `with_lamps`."""
    tiles = grid.none()
    if lamps.moving:
        return ~tiles
    for box in boxes:
        for lamp in lamps.shadowed:
            shadow = _shadow(box, camera, view, lamp, lowest)
            bottom = view.height - shadow.y - shadow.height
            tiles |= grid.touching(Area(shadow.x, bottom, shadow.width, shadow.height))
    return tiles


def _shadow(box: Points, camera: Camera, view: View, lamp: LampView, lowest: float) -> Rectangle:
    hull = shadow_hull(box, lamp, lowest)
    if hull is None:
        return Rectangle(0, 0, view.width, view.height)
    rectangle = covered_rectangle([hull], camera, view) if len(hull) else Rectangle(0, 0, 0, 0)
    return rectangle if rectangle.empty else grown(rectangle, _FILTERS, view)


def shadow_hull(corners: Points, view: LampView, lowest: float) -> Points | None:
    """Return points that span the space that a box shadows from a lamp.

    Args:
        corners: (8, 3) corners of the box, metres.
        view: the lamp's shadow map.
        lowest: height of the lowest surface that receives light, metres.

    Returns:
        (N, 3); (0, 3) if the box is out of the lamp's reach; None if it is so near that its shadow may fall anywhere.
    """
    if not within_reach(corners, view.lamp):
        return np.zeros((0, 3))
    lamp = np.array(view.lamp.position)
    middle = corners.mean(axis=0)
    size = float(np.linalg.norm(corners - middle, axis=1).max())
    distance = float(np.linalg.norm(middle - lamp))
    # The reach of the filter and of the offset along the normal at the box.
    margin = 0.1 + FILTER_TEXELS * view.texel * (distance + size)
    if distance < 2.0 * (size + margin):
        return None
    outward = np.sign(corners - middle)
    near = corners + outward * margin
    rays = near - lamp
    length = np.linalg.norm(rays, axis=1)
    # Twice the reach, since chords between the ends of rays lie nearer than the ends.
    farthest = 2.0 * view.lamp.reach / length
    with np.errstate(divide="ignore"):
        down = np.where(rays[:, 2] < -1e-6, (lowest - margin - lamp[2]) / np.minimum(rays[:, 2], -1e-6), np.inf)
    far = lamp + rays * np.maximum(np.minimum(farthest, down), 1.0)[:, None]
    return np.concatenate([near, far])


def within_reach(corners: Points, lamp: Lamp) -> bool:
    """Return True if a lamp's light may reach a box."""
    middle = corners.mean(axis=0)
    size = float(np.linalg.norm(corners - middle, axis=1).max())
    return float(np.linalg.norm(middle - np.array(lamp.position))) < lamp.reach + size
