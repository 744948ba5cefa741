"""The rectangle of an image that a path tracer must render again for the movables.

The light that a movable reflects or blocks reaches everywhere, ever weaker with distance. This bound is therefore not exact,
unlike the raster engine's. It follows a measurement (docs/benchmarks.md): farther from a movable than `REACH` times its height,
its effect on indirect light is below the noise of an image of default quality. The bounds of a movable's own pixels and of its
shadow are exact. They include its reflection in a wet road, but not its reflections in distant smooth surfaces.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Rectangle, View
from valerie.rendering.lamps import lit_lamps
from valerie.rendering.projection import box_corners
from valerie.rendering.raster.gl.bounds import Reach, changed_rectangle, covered_rectangle, grown, union
from valerie.rendering.raster.light.lamp_reach import FrameLamps, with_lamps
from valerie.rendering.scene_reading import DrawItem, camera_of, draw_items
from valerie.rendering.sky import sky_of
from valerie.scene.graph.model import Scene
from valerie.scene.light.weather import wetness

#: Distance from a movable, in its heights, beyond which its indirect light is lost in the noise.
REACH: Final = 0.5
#: Smallest margin around the rectangle for the denoiser, pixels.
_MARGIN: Final = 16
#: Side of the blocks that the denoiser's network pools, pixels: Open Image Denoise's U-Net halves an image four times. Blocks
#: count from the lower left, where Blender's images begin.
_POOLED: Final = 16
#: Radius of the reconstruction filter (1.5 pixels wide) with rounding, pixels.
_FILTER: Final = 3


def reached_rectangle(scene: Scene, view: View) -> Rectangle:
    """Return the rectangle that a scene's movables change; it is empty if they change nothing in the image.

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
    # Half of the sun's angular diameter over the longest distance between a movable and its shadow.
    penumbra = math.tan(scene.sun.angular_diameter / 2) * (highest - lowest) / max(float(toward_sun[2]), 1e-2)
    exact = changed_rectangle(corners, camera, view, toward_sun, lowest, Reach(0.0, _FILTER, penumbra, _FILTER))
    exact = with_lamps(exact, corners, camera, view, lowest, lamps)
    near, wet = [], wetness(scene.environment.rain) > 0.0
    for low, high in boxes:
        height = float(high[2] - low[2])
        more = REACH * height
        # Its mirror image hangs upside down below the road.
        near.append(box_corners(low - [more, more, more + height * wet], high + more))
    return union(exact, covered_rectangle(near, camera, view))


def denoised_window(rectangle: Rectangle, view: View) -> Rectangle:
    """Return the part of the image to render so that the denoiser gives a rectangle the values of the whole image.

    Its edges lie on the block edges of the denoiser's network in the whole image. With other blocks, the network's result
    would differ by more than a margin of any width could make up for (docs/benchmarks.md).
    """
    around = grown(rectangle, _MARGIN, view)

    def whole_blocks(first: int, last: int) -> tuple[int, int]:
        return first // _POOLED * _POOLED, -(-last // _POOLED) * _POOLED

    left, right = whole_blocks(around.x, around.x + around.width)
    bottom, top = whole_blocks(view.height - around.y - around.height, view.height - around.y)
    return Rectangle(left, view.height - top, right - left, top - bottom).clipped(view.width, view.height)


def _frame_lamps(scene: Scene, view: View) -> FrameLamps:
    """Return the lamps that are on, and those that cast shadows, as the raster engine selects them."""
    return FrameLamps.seen_by(lit_lamps(scene, sky_of(scene)), camera_of(scene, view), view)


def _bounds(item: DrawItem) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the lowest and the highest corner of a node's meshes in the world, or None without a mesh."""
    points = [
        box_corners(mesh.positions.min(axis=0), mesh.positions.max(axis=0)) @ item.world[:3, :3].T + item.world[:3, 3]
        for mesh in item.meshes
        if mesh.faces.size
    ]
    if not points:
        return None
    together = np.concatenate(points)
    return together.min(axis=0), together.max(axis=0)
