"""The rectangle of an image that movables can change: a bound that is never too small, by construction.

A movable changes pixels in six ways: by its own pixels, by its shadow (a prism from its box away from the sun down to the lowest
ground), by ambient occlusion (within a screen radius that shrinks with depth), by contact shadows (in a box around its own), by
its reflection in wet level ground (its box, upside down below the ground), and through filters of a few pixels. There is no other
way: paint and glass mirror only statics, and movables reflect no light onto other surfaces.
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
        occlusion_radius: distance beyond which ambient occlusion is exactly zero, metres.
        largest_occlusion: largest screen radius of ambient occlusion, pixels.
        penumbra: widest shadow edge, metres.
        filters: sum of the radii of blurs, antialiasing and neighbour selection, pixels.
        contact_radius: distance across, beyond which contact shadows are exactly zero, metres.
        contact_rise: the same up and down.
        mirrored: distance from a movable of the places whose reflection may show it, metres.
    """

    occlusion_radius: float
    largest_occlusion: float
    penumbra: float
    filters: int
    contact_radius: float = 0.0
    contact_rise: float = 0.0
    mirrored: float = 0.0

    def occlusion_pixels(self, nearest: float, focal: float) -> int:
        """Return the width, in pixels, of the margin that a movable with its nearest point at depth ``nearest`` may occlude.

        Receivers more than the radius in front of the movable are not occluded. A receiver at that depth has the widest kernel.
        """
        depth = nearest - self.occlusion_radius
        widest = self.largest_occlusion
        if depth > 0:
            widest = min(widest, max(self.occlusion_radius * focal / depth, 1.5))
        return math.ceil(widest) + 1


def changed_rectangle(
    boxes: Iterable[Points],
    camera: Camera,
    view: View,
    toward_sun: Points,
    lowest: float,
    reach: Reach,
    *,
    wet: bool = False,
) -> Rectangle:
    """Return a bound of all pixels that movables change.

    Args:
        boxes: (8, 3) world corners of each movable mesh's bounding box, metres.
        camera, view: the camera and the size of its image.
        toward_sun: (3,) unit vector; a sun at or below the horizon casts no shadows.
        lowest: height of the lowest surface that can receive a shadow or mirror, metres.
        reach: reach of the engine's filters.
        wet: True if level ground mirrors movables.

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
    shadows = contact_hulls(hulls, reach)
    if wet:
        shadows += mirror_hulls(hulls, lowest, reach)
    if toward_sun[2] > 0:
        shadows += [_shadow_prism(corners, toward_sun, lowest, reach.penumbra) for corners in hulls]
    for shadow in _seen(shadows, camera, view):
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


def contact_hulls(boxes: Iterable[Points], reach: Reach) -> list[Points]:
    """Return (64, 3) world points that span the places with contact shadows of each box, (8, 3) world corners."""
    around = np.array([reach.contact_radius, reach.contact_radius, reach.contact_rise])
    return [_widened(corners, around) for corners in boxes]


def mirror_hulls(boxes: Iterable[Points], lowest: float, reach: Reach) -> list[Points]:
    """Return (128, 3) world points that span each box, (8, 3) world corners, and its reflections in level ground.

    Args:
        lowest: height of the lowest ground, metres. Ground above a box does not mirror it.
        reach: see `Reach.mirrored`.
    """
    around = [_widened(corners, np.full(3, reach.mirrored)) for corners in boxes]
    return [np.concatenate([box, box * (1, 1, -1) + (0, 0, 2 * lowest)]) for box in around]


def covered_rectangle(boxes: Iterable[Points], camera: Camera, view: View, pad_x: int = 0, pad_y: int = 0) -> Rectangle:
    """Return a bound of the pixels that the objects inside ``boxes`` (world corners, (8, 3) each) cover.

    The image is padded by ``pad_x`` and ``pad_y`` pixels on each side. The rectangle counts from the padded image's top left.
    """
    visible = _seen(list(boxes), camera, view)
    points = np.concatenate(visible)[:, :2] if visible else np.zeros((0, 2))
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
    """Return the smallest rectangle around two rectangles."""
    if first.empty or second.empty:
        return second if first.empty else first
    x, y = min(first.x, second.x), min(first.y, second.y)
    right = max(first.x + first.width, second.x + second.width)
    bottom = max(first.y + first.height, second.y + second.height)
    return Rectangle(x, y, right - x, bottom - y)


def grown(rectangle: Rectangle, pixels: int, view: View) -> Rectangle:
    """Return a rectangle extended by ``pixels`` on each side, as far as the image reaches."""
    more = Rectangle(
        rectangle.x - pixels, rectangle.y - pixels, rectangle.width + 2 * pixels, rectangle.height + 2 * pixels
    )
    return more.clipped(view.width, view.height)


def _seen(hulls: Sequence[Points], camera: Camera, view: View) -> list[Points]:
    """Return for each hull the pixels and depths, (N, 3), that bound its part in front of the near plane."""
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
    """Return (128, 3) points that span a box, extended by the penumbra, and its shadow down to height ``lowest``."""
    top = _widened(corners, np.full(3, penumbra))
    drop = max(float(top[:, 2].max()) - lowest, 0.0) + penumbra
    return np.concatenate([top, top - toward_sun * (drop / max(float(toward_sun[2]), 1e-4))])


def _widened(corners: Points, around: Points) -> Points:
    """Return points that span a box and everything within ``around``, (3,) metres, of it."""
    return (corners[:, None] + box_corners(-around, around)[None]).reshape(-1, 3)
