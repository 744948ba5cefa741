"""Conservative bounds, in tiles, of the parts of a frame that movables may change."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from valerie.rendering.base import View
from valerie.rendering.projection import Points, view_from_world
from valerie.rendering.raster.canvas import StaticSurfaces
from valerie.rendering.raster.gl.bounds import Reach, contact_hulls, covered_rectangle, mirror_hulls
from valerie.rendering.raster.gl.targets import area_of
from valerie.rendering.raster.gl.tiles import TILE, Mask, widened
from valerie.rendering.raster.light.shadows import LARGEST_PENUMBRA, SHADOW_DISTANCE, ShadowMap
from valerie.scene.graph.model import Camera

#: Largest distance by which a caster may lie behind a receiver along the light and still count, metres: the rise of the
#: receiver's plane, whose slope is at most 6 in both directions, over the widest penumbra.
_STEEPEST = 6 * math.sqrt(2) * LARGEST_PENUMBRA + 0.05


def occluded_tiles(
    body: Mask, bodies: Sequence[Points], surfaces: StaticSurfaces, camera: Camera, view: View, reach: Reach
) -> Mask:
    """Return the tiles whose ambient occlusion, before its blur, may differ from the statics'.

    Occlusion is a sum of non-negative contributions of the taps around a pixel. A tap contributes only within a radius in space.
    A tile therefore does not change if none of its taps reaches a tile with movables, or if it has no occlusion and all movables
    lie more than the radius in front of it or behind it.

    Args:
        body: tiles with visible movables.
        bodies: (8, 3) world corners of the movables' boxes.
        surfaces: the statics seen by the camera.
        camera, view: the camera and the size of its image.
        reach: reach of the engine's filters.
    """
    if not body.any():
        return body
    focal = camera.focal_length_px(view.width)
    with np.errstate(divide="ignore"):
        taps = np.clip(reach.occlusion_radius * focal / surfaces.nearest, 1.5, reach.largest_occlusion) + 1
    near = widened(body)
    for steps in range(2, math.ceil((reach.largest_occlusion + 1) / TILE) + 2):
        near |= widened(body, steps) & (taps >= (steps - 1) * TILE)
    depths = _depths(np.concatenate(list(bodies)), camera)
    radius = reach.occlusion_radius + 0.01
    apart = (surfaces.nearest > depths.max() + radius) | (surfaces.farthest < depths.min() - radius)
    reached: Mask = body | (near & ~(surfaces.open & apart))
    return reached


def touched_tiles(bodies: Sequence[Points], surfaces: StaticSurfaces, camera: Camera, view: View, reach: Reach) -> Mask:
    """Return the tiles in which movables may cast contact shadows.

    Args:
        bodies: (8, 3) world corners of the movables' boxes.
        surfaces: the statics seen by the camera.
        camera, view: the camera and the size of its image.
        reach: reach of the engine's filters.
    """
    touched = surfaces.grid.none()
    for hull in contact_hulls(bodies, reach):
        tiles = surfaces.grid.touching(area_of(covered_rectangle([hull], camera, view), view))
        depths = _depths(hull, camera)
        touched |= tiles & (surfaces.nearest < depths.max() + 0.05) & (surfaces.farthest > depths.min() - 0.05)
    return touched


def mirroring_tiles(
    bodies: Sequence[Points], surfaces: StaticSurfaces, camera: Camera, view: View, lowest: float, reach: Reach
) -> Mask:
    """Return the tiles in which wet level ground may mirror movables.

    Args:
        bodies: (8, 3) world corners of the movables' boxes.
        surfaces: the statics seen by the camera.
        camera, view: the camera and the size of its image.
        lowest: height of the lowest ground, metres.
        reach: reach of the engine's filters.
    """
    mirroring = surfaces.grid.none()
    for hull in mirror_hulls(bodies, lowest, reach):
        mirroring |= surfaces.grid.touching(area_of(covered_rectangle([hull], camera, view), view))
    return mirroring


def shadowed_tiles(
    candidates: Mask, bodies: Sequence[Points], surfaces: StaticSurfaces, camera: Camera, view: View, shadow: ShadowMap
) -> Mask:
    """Return those of the ``candidates`` whose static surfaces may lie in the movables' shadow.

    The visible surfaces of a tile lie in a frustum between two depths. The test compares the frustum's box in the light's axes
    with the boxes of the movables, and then with the occupied texels of their shadow map.

    Args:
        candidates: the tiles to test.
        bodies: (8, 3) world corners of the movables' boxes.
        surfaces: the statics seen by the camera.
        camera, view: the camera and the size of its image.
        shadow: the movables' shadow map.
    """
    shadowed = np.zeros_like(candidates)
    rows, columns = np.nonzero(candidates & (surfaces.nearest < camera.far * 0.999))
    if not len(rows) or not bodies:
        return shadowed
    light = shadow.light
    focal = camera.focal_length_px(view.width)
    # One more pixel on each side, since pixels blend samples of their neighbours.
    x = np.stack([columns * TILE - 1, (columns + 1) * TILE + 1], axis=1) - view.width / 2
    y = np.stack([rows * TILE - 1, (rows + 1) * TILE + 1], axis=1) - view.height / 2
    rays = np.empty((len(rows), 2, 2, 3))
    rays[..., 0] = x[:, :, None] / focal
    rays[..., 1] = y[:, None, :] / focal
    rays[..., 2] = -1
    edges = rays.reshape(len(rows), 4, 3) @ (light.rows @ camera.transform[:3, :3]).T
    eye = light.rows @ camera.position
    near, far = surfaces.nearest[rows, columns], surfaces.farthest[rows, columns]
    spans = np.concatenate([edges * near[:, None, None], edges * far[:, None, None]], axis=1) + eye
    low, high = spans.min(axis=1), spans.max(axis=1)
    beside = 0.012 + 4 * SHADOW_DISTANCE**2 / camera.near * 2**-24  # as in ``sunlit`` of ``lighting.frag``
    border = LARGEST_PENUMBRA + 2 * float(light.extent[:2].max()) / shadow.target.size[0] + 0.02 + beside
    boxes = [corners @ light.rows.T for corners in bodies]
    # Few tiles are near any movable, so few need a test against each of them.
    near_any = np.flatnonzero(_meets(low, high, np.concatenate(boxes), border))
    low, high = low[near_any], high[near_any]
    hit = np.zeros(len(near_any), np.bool_)
    for box in boxes:
        hit |= _meets(low, high, box, border)
    hit[hit] = shadow.holds(low[hit, :2] - border, high[hit, :2] + border)
    tiles = near_any[hit]
    shadowed[rows[tiles], columns[tiles]] = True
    return shadowed


def _depths(points: Points, camera: Camera) -> Points:
    """Return the depths, (N,) metres along the optical axis, of world points."""
    matrix = view_from_world(camera)
    depths: Points = -(points @ matrix[2, :3] + matrix[2, 3])
    return depths


def _meets(low: Points, high: Points, caster: Points, border: float) -> Mask:
    """Return (N,) bool, True if a caster's box may shadow the box ``low`` … ``high``, (N, 3) in the light's axes."""
    first, last = caster.min(axis=0), caster.max(axis=0)
    across = (low[:, 0] < last[0] + border) & (high[:, 0] > first[0] - border)
    across &= (low[:, 1] < last[1] + border) & (high[:, 1] > first[1] - border)
    meets: Mask = across & (high[:, 2] > first[2] - _STEEPEST)
    return meets
