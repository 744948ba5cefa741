"""Matrices of the pinhole camera and of orthographic light views, in float64. Numpy only.

Clip space is OpenGL's (−w ≤ x, y, z ≤ w). The origin of pixel coordinates is the image's top left corner, so the centre of the
first pixel is (0.5, 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import View
from valerie.scene.graph.model import Camera, Matrix, freeze

Points = NDArray[np.float64]


def view_from_world(camera: Camera) -> Matrix:
    """Return the (4, 4) matrix from world to camera space, read-only. The camera looks along −z."""
    return _inverse(np.ascontiguousarray(camera.transform, np.float64).tobytes())


@lru_cache(maxsize=64)
def _inverse(matrix: bytes) -> Matrix:
    """Return the inverse of a (4, 4) float64 matrix. Cached, since a frame uses its camera's inverse dozens of times."""
    return freeze(np.asarray(np.linalg.inv(np.frombuffer(matrix).reshape(4, 4)), np.float64))


def clip_from_view(camera: Camera, width: int, height: int, pad_x: int = 0, pad_y: int = 0) -> Matrix:
    """Return the (4, 4) matrix from camera to clip space, with square pixels and a centred principal point.

    ``pad_x`` and ``pad_y`` extend the pixel grid on each side: a point at (u, v) in the image is at (u + pad_x, v + pad_y) on the
    canvas.
    """
    focal = camera.focal_length_px(width)
    near, far = camera.near, camera.far
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 2 * focal / (width + 2 * pad_x)
    matrix[1, 1] = 2 * focal / (height + 2 * pad_y)
    matrix[2, 2] = -(far + near) / (far - near)
    matrix[2, 3] = -2 * far * near / (far - near)
    matrix[3, 2] = -1
    return matrix


def drawing_matrices(camera: Camera, view: View) -> dict[str, Matrix]:
    """Return the uniforms of vertex shaders: ``clip_from_world``, (4, 4), and ``depth_row``, (4,), world to depth in metres.

    ``eye``, (3,) metres, is the optical centre.
    """
    matrix = view_from_world(camera)
    clip_from_world = clip_from_view(camera, view.width, view.height) @ matrix
    return {"clip_from_world": clip_from_world, "depth_row": -matrix[2], "eye": camera.position}


def project(points: Points, camera: Camera, width: int, height: int) -> Points:
    """Project (N, 3) world points in front of the camera to (N, 3): pixel x, pixel y, depth in metres along the optical axis."""
    matrix = view_from_world(camera)
    local = points @ matrix[:3, :3].T + matrix[:3, 3]
    focal = camera.focal_length_px(width)
    depth = -local[:, 2]
    return np.stack([width / 2 + focal * local[:, 0] / depth, height / 2 - focal * local[:, 1] / depth, depth], axis=1)


def box_corners(low: Points, high: Points) -> Points:
    """Return the (8, 3) corners of an axis-aligned box."""
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def touches_clip_volume(boxes: Points, clip_from_world: Matrix) -> NDArray[np.bool_]:
    """Return (N,) bool, False only if all corners of a box, (N, 8, 3), lie beyond one side of a clip volume.

    The volume is taken a little larger than it is, since a driver rounds otherwise than this function.
    """
    corners = boxes @ clip_from_world[:, :3].T + clip_from_world[:, 3]
    reach = 1.001 * corners[..., 3:] + 0.01
    sides = np.concatenate([corners[..., :3] > reach, corners[..., :3] < -reach], axis=2)
    beyond: NDArray[np.bool_] = np.asarray(sides.all(axis=1))
    touches: NDArray[np.bool_] = ~np.asarray(beyond.any(axis=1))
    return touches


def clip_hull(points: Points, normal: Points, offset: float) -> Points:
    """Return points that span the convex hull of ``points`` clipped by the half space normal·p ≥ offset; (0, 3) if empty.

    Every edge of a hull joins two of its points, so the points inside the half space and the crossings of all pairs with the
    plane span the clipped hull. They span no more, since the segment between any pair lies inside the hull.
    """
    height = points @ normal - offset
    inside, outside = height >= 0, height < 0
    inner, outer = points[inside], points[outside]
    share = height[inside][:, None] / (height[inside][:, None] - height[outside][None, :])
    crossings = inner[:, None] + (outer[None] - inner[:, None]) * share[..., None]
    return np.concatenate([inner, crossings.reshape(-1, 3)])


def seen_points(camera: Camera, view: View, low: Points, high: Points, farthest: float) -> Points:
    """Return (N, 3) world points that span the part of a box that a camera sees up to a depth; (0, 3) if it sees none.

    They are the points at which a grid of 17 × 17 rays, the image's corners included, enters and leaves the box.
    """
    edge = np.linspace(-0.5, 0.5, 17)
    focal = camera.focal_length_px(view.width)
    x, y = (part.ravel() for part in np.meshgrid(edge * view.width / focal, edge * view.height / focal))
    rays = np.stack([x, y, np.full_like(x, -1.0)], axis=1) @ camera.transform[:3, :3].T
    rays[rays == 0] = 1e-12
    first, second = (low - camera.position) / rays, (high - camera.position) / rays
    enter = np.maximum(np.minimum(first, second).max(axis=1), camera.near)
    leave = np.minimum(np.maximum(first, second).min(axis=1), farthest)
    hits = enter < leave
    spans = np.concatenate([enter[hits], leave[hits]])[:, None]
    points: Points = camera.position + np.concatenate([rays[hits], rays[hits]]) * spans
    return points


@dataclass(frozen=True, slots=True, eq=False)
class LightView:
    """The orthographic view volume of a light: a box around receivers and casters.

    Attributes:
        rows: (3, 3) orthonormal; its rows are the box's first, second and depth axis in the world. Depth grows away from the
            light.
        origin: (3,) metres, the box's low corner in those axes.
        extent: (3,) metres, the box's size along those axes.
    """

    rows: Matrix
    origin: Points
    extent: Points

    @property
    def clip_from_world(self) -> Matrix:
        """The (4, 4) matrix from world to clip space."""
        matrix = np.eye(4)
        scale = 2 / self.extent
        matrix[:3, :3] = self.rows * scale[:, None]
        matrix[:3, 3] = -self.origin * scale - 1
        return matrix

    @property
    def key(self) -> bytes:
        """A cache key, equal for equal views."""
        return self.rows.tobytes() + self.origin.tobytes() + self.extent.tobytes()

    def release(self) -> None:
        """Do nothing: a view holds only memory. Caches call it."""


def light_axes(toward_light: Points) -> Matrix:
    """Return the (3, 3) rows of a frame whose third axis points away from the light.

    The second axis is close to the world's y, or to x if the light comes almost along y.
    """
    depth = -toward_light / np.linalg.norm(toward_light)
    reference = np.array([0.0, 1.0, 0.0]) if abs(depth[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    first = np.cross(reference, depth)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(depth, first), depth])


def turned_to_fit(rows: Matrix, points: Points) -> Matrix:
    """Return the frame turned about its depth axis, in steps of 3°, so that the points' bounding rectangle is smallest."""
    flat = points @ rows[:2].T
    best, best_area = 0.0, np.inf
    for angle in np.deg2rad(np.arange(0, 90, 3)):
        cosine, sine = np.cos(angle), np.sin(angle)
        spread = np.ptp(flat @ np.array([[cosine, -sine], [sine, cosine]]), axis=0)
        area = float(spread[0] * spread[1])
        if area < best_area - 1e-9:
            best, best_area = float(angle), area
    cosine, sine = np.cos(best), np.sin(best)
    frame = rows.copy()
    frame[0] = cosine * rows[0] + sine * rows[1]
    frame[1] = -sine * rows[0] + cosine * rows[1]
    return frame


def fit_light_view(rows: Matrix, receivers: Points, casters: Points, resolution: int, border: float) -> LightView:
    """Return the box that bounds ``receivers`` across the light, and receivers and casters along it.

    Args:
        rows: frame of `light_axes`, as it is or turned.
        receivers: (N, 3) world points that must be inside.
        casters: (M, 3) world points whose depth must be inside.
        resolution: texels per side. The origin snaps to whole texels, so that neighbouring views share the texel grid.
        border: margin on each side, metres.
    """
    receiver_points, caster_points = receivers @ rows.T, casters @ rows.T
    low, high = receiver_points.min(axis=0) - border, receiver_points.max(axis=0) + border
    low[2] = min(low[2], float(caster_points[:, 2].min()) - border)
    high[2] = max(high[2], float(caster_points[:, 2].max()) + border)
    texel = (high[:2] - low[:2]) / (resolution - 2)
    low[:2] = np.floor(low[:2] / texel) * texel
    return LightView(rows, low, np.array([*(texel * resolution), high[2] - low[2]]))
