"""Boxes of instances in world, camera and image coordinates, computed from scene and ground truth without a GPU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import GroundTruth, View, bounds
from valerie.rendering.projection import clip_hull, project, view_from_world
from valerie.rendering.scene_reading import DrawItem, camera_of, draw_items, instance_roots
from valerie.scene.graph.model import Camera, Mesh, Node, Scene, freeze

#: Corners of a unit box around the origin that faces +y.
_CORNERS: Final = np.array(
    [[x, y, z] for z in (-0.5, 0.5) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
)
#: Edges as pairs of corners; the last four bound the front.
EDGES: Final = (
    (0, 1), (3, 0), (1, 2), (4, 5), (7, 4), (5, 6), (0, 4), (1, 5),
    (2, 3), (6, 7), (2, 6), (3, 7),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """One upright box per drawn instance, whether the camera sees it or not, by ascending instance id.

    The sides of a box are parallel to the world's z and to the heading of the instance's topmost node. Among such boxes it is the
    smallest around all vertices of the instance. The heading comes from the node alone: if a model's front does not face its
    node's +y, the box is turned with the node.

    Attributes:
        instances: (N,) int64, label id × 1000 + n.
        centres: (N, 3) float32, metres in the world.
        sizes: (N, 3) float32, metres across the heading, along it, and up.
        headings_deg: (N,) float32, 0 … 360, 0 faces +y, counter-clockwise seen from above.
        camera_centres: (N, 3) float32, metres in the camera's frame (x right, y up, the camera looks along −z).
        camera_headings_deg: (N,) float32, 0 … 360, heading minus the camera's yaw: 0 faces the camera's viewing direction.
        pixel_areas: (N,) int64, number of visible pixels.
        visible_boxes: (N, 4) int64, x0, y0, x1, y1 of the visible pixels, end exclusive; zeros without a visible pixel.
        projected_boxes: (N, 4) float32, x0, y0, x1, y1 in pixels around the projection of the whole instance, hidden parts and
            parts beyond the image's border included; NaN if all of it is behind the camera.
        corners: (N, 8, 3) float32, metres in the world: the four bottom corners, then the four above them. In each group of
            four, seen along the heading: rear left, rear right, front right, front left.
        projected_corners: (N, 8, 2) float32, the corners in pixels; NaN for a corner behind the camera.
    """

    instances: NDArray[np.int64]
    centres: NDArray[np.float32]
    sizes: NDArray[np.float32]
    headings_deg: NDArray[np.float32]
    camera_centres: NDArray[np.float32]
    camera_headings_deg: NDArray[np.float32]
    pixel_areas: NDArray[np.int64]
    visible_boxes: NDArray[np.int64]
    projected_boxes: NDArray[np.float32]
    corners: NDArray[np.float32]
    projected_corners: NDArray[np.float32]

    def __post_init__(self) -> None:
        for name in self.__slots__:
            freeze(getattr(self, name))


def measure_boxes(scene: Scene, view: View, truth: GroundTruth) -> Boxes:
    """Return the boxes of all instances that a scene draws.

    Args:
        scene: the source of positions and shapes.
        view: camera and image size.
        truth: ground truth of this scene and view.

    Raises:
        UnknownName: The scene has no such camera.
    """
    camera = camera_of(scene, view)
    parts: dict[int, list[DrawItem]] = {}
    for item in (*draw_items(scene, movable=False), *draw_items(scene, movable=True)):
        if item.node.instance_id:
            parts.setdefault(item.node.instance_id, []).append(item)
    numbers = sorted(parts)
    roots = instance_roots(scene)
    yaw = math.atan2(float(camera.transform[0, 2]), -float(camera.transform[1, 2]))
    to_camera = view_from_world(camera)
    rows = [_box(scene, roots[number], parts[number], camera, view) for number in numbers]
    visible = [_visible(truth, number) for number in numbers]
    centres = np.array([row.centre for row in rows]).reshape(-1, 3)
    headings = np.array([row.heading for row in rows])
    corners = np.array([row.corners() for row in rows]).reshape(-1, 8, 3)
    return Boxes(
        instances=np.array(numbers, np.int64),
        centres=centres.astype(np.float32),
        sizes=np.array([row.size for row in rows], np.float32).reshape(-1, 3),
        headings_deg=_degrees(headings),
        camera_centres=(centres @ to_camera[:3, :3].T + to_camera[:3, 3]).astype(np.float32),
        camera_headings_deg=_degrees(headings - yaw),
        pixel_areas=np.array([area for area, _ in visible], np.int64),
        visible_boxes=np.array([box for _, box in visible], np.int64).reshape(-1, 4),
        projected_boxes=np.array([row.projected for row in rows], np.float32).reshape(-1, 4),
        corners=corners.astype(np.float32),
        projected_corners=_pixels(corners, camera, view),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """The box of one instance; heading in radians."""

    centre: NDArray[np.float64]
    size: NDArray[np.float64]
    heading: float
    projected: tuple[float, float, float, float]

    def corners(self) -> NDArray[np.float64]:
        """Return the (8, 3) corners, metres in the world; see `Boxes`."""
        corners: NDArray[np.float64] = self.centre + (_CORNERS * self.size) @ _upright(self.heading).T
        return corners


def _box(scene: Scene, root: Node, items: Sequence[DrawItem], camera: Camera, view: View) -> _Box:
    forward = scene.world_transform(root.path)[:3, 1]
    heading = math.atan2(-float(forward[0]), float(forward[1]))
    axes = _upright(heading)
    vertices = np.concatenate(
        [_hull(mesh) @ item.world[:3, :3].T + item.world[:3, 3] for item in items for mesh in item.meshes]
    )
    local = vertices @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    return _Box(axes @ ((low + high) / 2), high - low, heading, _projected(vertices, camera, view))


@lru_cache(maxsize=1024)
def _hull(mesh: Mesh) -> NDArray[np.float64]:
    """Return the (K, 3) vertices of a mesh's convex hull. They bound it in every direction and projection."""
    from scipy.spatial import ConvexHull, QhullError

    positions = mesh.positions.astype(np.float64)
    try:
        return positions[ConvexHull(positions).vertices]
    except QhullError:  # the mesh is flat, or a line
        return positions


def _projected(vertices: NDArray[np.float64], camera: Camera, view: View) -> tuple[float, float, float, float]:
    forward = -camera.transform[:3, 2] / np.linalg.norm(camera.transform[:3, 2])
    nearest = float(forward @ camera.position) + camera.near
    in_front = vertices @ forward >= nearest
    if not in_front.any():
        return (math.nan,) * 4
    if not in_front.all():
        # The instance crosses the near plane. Its bounding box, clipped there, bounds the part in front.
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        vertices = clip_hull(corners, forward, nearest)
    pixels = project(vertices, camera, view.width, view.height)[:, :2]
    (x0, y0), (x1, y1) = pixels.min(axis=0), pixels.max(axis=0)
    return float(x0), float(y0), float(x1), float(y1)


def _pixels(corners: NDArray[np.float64], camera: Camera, view: View) -> NDArray[np.float32]:
    """Project (N, 8, 3) world points to (N, 8, 2) pixels; NaN behind the near plane."""
    with np.errstate(divide="ignore", invalid="ignore"):
        projected = project(corners.reshape(-1, 3), camera, view.width, view.height)
    projected[projected[:, 2] < camera.near] = np.nan
    pixels: NDArray[np.float32] = projected[:, :2].astype(np.float32).reshape(-1, 8, 2)
    return pixels


def _visible(truth: GroundTruth, number: int) -> tuple[int, tuple[int, int, int, int]]:
    mask = truth.instance_map == number
    box = bounds(mask)
    return int(np.count_nonzero(mask)), (box.x, box.y, box.x + box.width, box.y + box.height)


def _upright(heading: float) -> NDArray[np.float64]:
    """Return the (3, 3) matrix whose columns point right of the heading, along it, and up."""
    cosine, sine = math.cos(heading), math.sin(heading)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _degrees(radians: NDArray[np.float64]) -> NDArray[np.float32]:
    degrees: NDArray[np.float32] = (np.rad2deg(radians) % 360.0).astype(np.float32)
    degrees[degrees >= 360.0] = 0.0
    return degrees
