"""The rectangle of an image that movables can change: a bound that is never too small, by construction.

Light leaves a movable's trace in four ways: its own pixels, its shadow (a prism from its box away from the sun down to the
lowest ground), near occlusion (a screen radius that shrinks with depth), and filters of a few pixels. The raster engine mirrors
statics alone, and has no bounce from movables, so there is no fifth.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from valerie.rendering.base import Rectangle, View
from valerie.rendering.projection import Points, box_corners, clip_hull, project
from valerie.scene.graph.model import Camera


@dataclass(frozen=True, slots=True)
class Reach:
    """The reach of the engine's filters.

    Attributes:
        occlusion_radius: metres, beyond which near occlusion is exactly nothing.
        largest_occlusion: pixels, largest screen radius of it.
        penumbra: metres, widest shadow edge.
        filters: pixels, sum of all that blurs, antialiases or picks neighbours.
    """

    occlusion_radius: float
    largest_occlusion: float
    penumbra: float
    filters: int

    def occlusion_pixels(self, nearest: float, focal: float) -> int:
        """Pixels around a movable whose nearest point has depth ``nearest`` that may be occluded by it.

        A receiver more than the radius in front of it is not; one at that depth has the widest kernel.
        """
        depth = nearest - self.occlusion_radius
        widest = self.largest_occlusion
        if depth > 0:
            widest = min(widest, max(self.occlusion_radius * focal / depth, 1.5))
        return math.ceil(widest) + 1


def changed_rectangle(
    boxes: Iterable[Points], camera: Camera, view: View, toward_sun: Points, lowest: float, reach: Reach
) -> Rectangle:
    """Bound of all pixels that movables change.

    Args:
        boxes: (8, 3) world corners of each movable mesh's bounding box, metres.
        toward_sun: (3,) unit vector; a sun at or below the horizon casts no shadows.
        lowest: metres, height below which there is nothing to receive a shadow.
        reach: of the engine's filters.

    Returns:
        A rectangle inside the image; empty if nothing can change.
    """
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    hulls, focal = list(boxes), camera.focal_length_px(view.width)
    for body in _seen(hulls, camera, view):
        if len(body):
            around = reach.occlusion_pixels(float(body[:, 2].min()), focal)
            low = np.minimum(low, body[:, :2].min(axis=0) - around)
            high = np.maximum(high, body[:, :2].max(axis=0) + around)
    if toward_sun[2] > 0:
        prisms = [_shadow_prism(corners, toward_sun, lowest, reach.penumbra) for corners in hulls]
        for shadow in _seen(prisms, camera, view):
            if len(shadow):
                low = np.minimum(low, shadow[:, :2].min(axis=0))
                high = np.maximum(high, shadow[:, :2].max(axis=0))
    if not np.isfinite(low).all():
        return Rectangle(0, 0, 0, 0)
    limit = np.array([view.width, view.height])
    first = np.clip(np.floor(low) - reach.filters, 0, limit).astype(int)
    last = np.clip(np.ceil(high) + reach.filters, 0, limit).astype(int)
    size = np.maximum(last - first, 0)
    if not size.all():
        return Rectangle(0, 0, 0, 0)
    return Rectangle(int(first[0]), int(first[1]), int(size[0]), int(size[1]))


def covered_rectangle(boxes: Iterable[Points], camera: Camera, view: View, pad_x: int = 0, pad_y: int = 0) -> Rectangle:
    """Bound of the pixels that things in ``boxes`` (world corners, (8, 3) each) cover themselves.

    The image is widened by ``pad_x`` and ``pad_y`` pixels on each side; the rectangle counts from its top left corner.
    """
    seen = _seen(list(boxes), camera, view)
    points = np.concatenate(seen)[:, :2] if seen else np.zeros((0, 2))
    if not len(points):
        return Rectangle(0, 0, 0, 0)
    limit = np.array([view.width + 2 * pad_x, view.height + 2 * pad_y])
    points = points + np.array([pad_x, pad_y])
    first = np.clip(np.floor(points.min(axis=0)) - 1, 0, limit).astype(int)
    size = np.maximum(np.clip(np.ceil(points.max(axis=0)) + 1, 0, limit).astype(int) - first, 0)
    if not size.all():
        return Rectangle(0, 0, 0, 0)
    return Rectangle(int(first[0]), int(first[1]), int(size[0]), int(size[1]))


def union(first: Rectangle, second: Rectangle) -> Rectangle:
    """Return the smallest rectangle around both."""
    if first.empty or second.empty:
        return second if first.empty else first
    x, y = min(first.x, second.x), min(first.y, second.y)
    right = max(first.x + first.width, second.x + second.width)
    bottom = max(first.y + first.height, second.y + second.height)
    return Rectangle(x, y, right - x, bottom - y)


def grown(rectangle: Rectangle, pixels: int, view: View) -> Rectangle:
    """Return the rectangle with ``pixels`` more on each side, inside the image."""
    more = Rectangle(
        rectangle.x - pixels, rectangle.y - pixels, rectangle.width + 2 * pixels, rectangle.height + 2 * pixels
    )
    return more.clipped(view.width, view.height)


def _seen(hulls: Sequence[Points], camera: Camera, view: View) -> list[Points]:
    """For each hull pixels and depths (N, 3) that bound the part of it in front of the near plane."""
    if not hulls:
        return []
    forward = -camera.transform[:3, 2]
    forward = forward / np.linalg.norm(forward)
    nearest = float(forward @ camera.position) + camera.near
    together = np.concatenate(hulls)
    if not (together @ forward >= nearest).all():
        hulls = [clip_hull(points, forward, nearest) for points in hulls]
        together = np.concatenate(hulls)
    pixels = project(together, camera, view.width, view.height)
    return np.split(pixels, np.cumsum([len(points) for points in hulls])[:-1])


def _shadow_prism(corners: Points, toward_sun: Points, lowest: float, penumbra: float) -> Points:
    """Return (128, 3) points that span a box, grown by the penumbra, and its shadow down to height ``lowest``."""
    cube = box_corners(np.full(3, -penumbra), np.full(3, penumbra))
    top = (corners[:, None] + cube[None]).reshape(-1, 3)
    drop = max(float(top[:, 2].max()) - lowest, 0.0) + penumbra
    return np.concatenate([top, top - toward_sun * (drop / max(float(toward_sun[2]), 1e-4))])
