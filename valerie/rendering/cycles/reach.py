"""The rectangle of an image that a path tracer renders again when movables stand in it.

The light that a movable reflects or blocks reaches everywhere, ever weaker with distance. So this bound is not exact, as the
raster engine's is, but follows a measured criterion: beyond `REACH` times its height from a movable, its effect on indirect
light is smaller than the noise of an image of the default quality (measured in docs/benchmarks.md). The bounds of its own
pixels and its shadow are exact. They include its reflection in a wet road, but not reflections in distant smooth surfaces.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Rectangle, View
from valerie.rendering.lamps import lit_lamps
from valerie.rendering.projection import box_corners
from valerie.rendering.raster.bounds import Reach, changed_rectangle, covered_rectangle, grown, union
from valerie.rendering.raster.lamp_reach import FrameLamps, with_lamps
from valerie.rendering.scene_reading import DrawItem, camera_of, draw_items
from valerie.rendering.sky import sky_of
from valerie.scene.graph.model import Scene
from valerie.scene.light.weather import wetness

#: Heights of a movable beyond which its indirect light is lost in the noise.
REACH: Final = 0.5
#: Pixels around the rectangle that the denoiser is shown at least.
_MARGIN: Final = 16
#: Pixels per side of what the denoiser's network (Open Image Denoise's U-Net, which halves a picture four times) takes together,
#: counted from the corner where Blender's pictures begin, the lower left.
_POOLED: Final = 16
#: Pixels: the reconstruction filter (1.5 wide), and rounding.
_FILTER: Final = 3


def reached_rectangle(scene: Scene, view: View) -> Rectangle:
    """Return the rectangle of a scene's movables; empty where they reach nothing of the image.

    Raises:
        UnknownName: the scene has no such camera.
    """
    camera = camera_of(scene, view)
    boxes = [bounds for item in draw_items(scene, movable=True) if (bounds := _bounds(item)) is not None]
    lamps = _frame_lamps(scene, view)
    if lamps.moving:
        return Rectangle(0, 0, view.width, view.height)
    if not boxes:
        return Rectangle(0, 0, 0, 0)
    statics = [bounds for item in draw_items(scene, movable=False) if (bounds := _bounds(item)) is not None]
    lowest = min(float(low[2]) for low, _ in statics or boxes)
    corners = [box_corners(low, high) for low, high in boxes]
    toward_sun = scene.sun_direction()
    highest = max(float(high[2]) for _, high in boxes)
    # Half of the sun's disc, over the longest way from a movable to where its shadow falls.
    penumbra = math.tan(scene.sun.angular_diameter / 2) * (highest - lowest) / max(float(toward_sun[2]), 1e-2)
    exact = changed_rectangle(corners, camera, view, toward_sun, lowest, Reach(0.0, _FILTER, penumbra, _FILTER))
    exact = with_lamps(exact, corners, camera, view, lowest, lamps)
    near, wet = [], wetness(scene.environment.rain) > 0.0
    for low, high in boxes:
        height = float(high[2] - low[2])
        more = REACH * height
        # A mirror image hangs upside down below the road.
        near.append(box_corners(low - [more, more, more + height * wet], high + more))
    return union(exact, covered_rectangle(near, camera, view))


def denoised_window(rectangle: Rectangle, view: View) -> Rectangle:
    """Return the part of the image that is rendered for the denoiser where only a rectangle is wanted.

    It begins and ends where the pixels that the denoiser's network takes together do in the whole image: else the network would
    see other blocks of pixels than there, and differ more than a margin of any width makes good (docs/benchmarks.md).
    """
    around = grown(rectangle, _MARGIN, view)

    def whole_blocks(first: int, last: int) -> tuple[int, int]:
        return first // _POOLED * _POOLED, -(-last // _POOLED) * _POOLED

    left, right = whole_blocks(around.x, around.x + around.width)
    bottom, top = whole_blocks(view.height - around.y - around.height, view.height - around.y)
    return Rectangle(left, view.height - top, right - left, top - bottom).clipped(view.width, view.height)


def _frame_lamps(scene: Scene, view: View) -> FrameLamps:
    """Return the lamps that shine, and of those that stand still the ones whose shadows are looked for: the raster engine's."""
    return FrameLamps.seen_by(lit_lamps(scene, sky_of(scene)), camera_of(scene, view), view)


def _bounds(item: DrawItem) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Lowest and highest corner of a node's meshes in the world."""
    points = [
        box_corners(mesh.positions.min(axis=0), mesh.positions.max(axis=0)) @ item.world[:3, :3].T + item.world[:3, 3]
        for mesh in item.meshes
        if mesh.faces.size
    ]
    if not points:
        return None
    together = np.concatenate(points)
    return together.min(axis=0), together.max(axis=0)
