"""Takes a picture of what large flat panes mirror: the statics, seen from the camera's mirror image behind the pane.

Rays from a camera that a plane reflects go on as if they came from the camera's mirror image, so one picture from there has all
that the panes of a plane show, at its place. The plane whose panes fill most of the image gets one; all else that is smooth
mirrors the panorama (`valerie.rendering.raster.spots`). Movables are not mirrored, so they never change a pixel this way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import View
from valerie.rendering.projection import Points, drawing_matrices
from valerie.rendering.raster.canvas import Canvas
from valerie.rendering.raster.gl.tiles import Area, Mask
from valerie.rendering.raster.light.lighting import LitFrame, Viewpoint
from valerie.rendering.raster.light.pane_image import LARGEST, NEAR_PLANE, PaneImage
from valerie.rendering.raster.light.panorama import SKY_DISTANCE
from valerie.rendering.raster.upload.drawing import SurfaceDrawer
from valerie.rendering.raster.upload.scenes import Statics
from valerie.scene.graph.model import Camera

#: Largest roughness of a pane, and least area of one of its triangles, square metres.
_SMOOTH: Final = 0.15
_LARGE: Final = 0.05
#: Least shares of the image that all panes of a plane, and a triangle of a pane, fill.
_LEAST: Final = 0.01
_LEAST_PANE: Final = 0.001
#: Pixels of the picture per pixel of the image.
_SCALE: Final = 0.4
#: Margin around panes in the picture, radians: they are slightly bent.
_MARGIN: Final = 0.012
#: Least size of a mesh in the picture, pixels.
_DETAIL: Final = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Panes:
    """The flat smooth triangles of the statics.

    Attributes:
        corners: (N, 3, 3) metres.
        normals: (N, 3) unit vectors.
        areas: (N,) square metres.
    """

    corners: Points
    normals: Points
    areas: NDArray[np.float64]

    @classmethod
    def of(cls, statics: Statics) -> Panes:
        """Find the panes of the statics."""
        corners = [np.zeros((0, 3, 3))]
        smooth = [m.roughness <= _SMOOTH and m.roughness_texture is None for m in statics.materials]
        for item, rows in statics.geometry.meshes:
            for mesh, row in zip(item.meshes, rows, strict=True):
                if smooth[row] and len(mesh.faces):
                    points = mesh.positions.astype(np.float64) @ item.world[:3, :3].T + item.world[:3, 3]
                    faces = mesh.faces if np.linalg.det(item.world[:3, :3]) > 0 else mesh.faces[:, ::-1]
                    corners.append(points[faces])
        triangles = np.concatenate(corners)
        across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        double = np.linalg.norm(across, axis=1)
        large = double > 2 * _LARGE
        return cls(triangles[large], across[large] / double[large, None], double[large] / 2)

    def release(self) -> None:
        """Do nothing: panes hold only memory. Caches call it."""


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """A plane with panes, and the camera that takes its picture."""

    plane: Points
    camera: Camera
    view: View
    canvas: Canvas
    tiles: Mask

    def photograph(self, gl: moderngl.Context, bind: Callable[[Canvas, Viewpoint], LitFrame]) -> PaneImage:
        """Light the statics and return their picture. ``bind`` returns the lighting passes of a canvas."""
        canvas, viewpoint = self.canvas, Viewpoint(self.camera, self.view)
        canvas.skylit, canvas.shaded = canvas.grid.none(), canvas.grid.none()
        frame = bind(canvas, viewpoint)
        canvas.light(frame, self.tiles)
        frame.release()
        everything = Area(0, 0, self.view.width, self.view.height)
        depth = canvas.read_depth(self.camera.near, self.camera.far)
        depth[~canvas.grid.pixels(self.tiles, everything)] = 0.0
        picture = np.concatenate([canvas.read_pixels(everything), depth.astype(np.float16)[..., None]], axis=2)
        basis = np.asarray(np.linalg.inv(viewpoint.ray_basis), np.float64)
        return PaneImage(gl, self.plane, self.camera.position, basis, picture)


class PaneView:
    """The statics seen from the camera's mirror image in the largest plane of panes.

    Args:
        gl: the current context.
        drawer: draws the G-buffer of surfaces.
        statics: the statics.
        table: their material table.
        viewpoint: the camera and the size of its image.
        panes: the panes of the statics.

    Attributes:
        mirror: the plane, which takes the pictures; None without a large pane.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        drawer: SurfaceDrawer,
        statics: Statics,
        table: moderngl.Texture,
        viewpoint: Viewpoint,
        panes: Panes,
    ) -> None:
        found = _largest_plane(panes, viewpoint)
        self.mirror = mirror = None if found is None else _mirror(gl, viewpoint, *found)
        if mirror is not None:
            target = mirror.canvas.targets.surfaces
            target.use()
            target.clear()
            # Nothing behind the pane hides what it mirrors.
            beyond = np.array([*mirror.plane[:3], -mirror.plane[3] - 0.005])
            values = {**drawing_matrices(mirror.camera, mirror.view), "beyond": beyond}
            drawer.statics(statics, table, values, least=_DETAIL / mirror.camera.focal_length_px(mirror.view.width))

    def release(self) -> None:
        """Free the targets."""
        if self.mirror is not None:
            self.mirror.canvas.release()


def _largest_plane(panes: Panes, viewpoint: Viewpoint) -> tuple[Points, Points] | None:
    """Return the plane whose panes fill most of the image, and their triangles in the image; None without a large pane.

    Corners, (N, 3, 2), are −1 … 1 across the image; those outside are moved to its edge.
    """
    camera = viewpoint.camera
    offsets = (panes.corners[:, 0] * panes.normals).sum(axis=1)
    local = (panes.corners - camera.position) @ np.linalg.inv(viewpoint.ray_basis).T
    # A corner behind the camera is moved before it, to where its direction leaves the image.
    depth = np.maximum(local[..., 2:], camera.near)
    places = np.clip(local[..., :2] / depth, -1, 1)
    (x, y), (u, v) = (np.moveaxis(places[:, k] - places[:, 0], 1, 0) for k in (1, 2))
    shares = np.abs(x * v - y * u) / 8
    shares[(panes.normals @ camera.position <= offsets + camera.near) | (local[..., 2].max(axis=1) < camera.near)] = 0
    seen = np.flatnonzero(shares > _LEAST_PANE)
    if not len(seen):
        return None
    apart = np.abs(offsets[seen] - offsets[seen][:, None])
    alike = (panes.normals[seen] @ panes.normals[seen].T > 0.9995) & (apart < NEAR_PLANE)
    # The picture is taken in the plane that most panes lie in.
    best = int(((alike + (alike & (apart < 0.01))) @ shares[seen]).argmax())
    members = seen[alike[best]]
    if shares[members].sum() < _LEAST:
        return None
    return np.array([*panes.normals[seen[best]], offsets[seen[best]]]), places[members]


def _mirror(gl: moderngl.Context, viewpoint: Viewpoint, plane: Points, triangles: Points) -> Mirror:
    """Return the camera behind a plane that sees these triangles of the image in it, with its targets."""
    normal, seen_by = plane[:3], viewpoint.camera
    across = np.eye(3) - 2 * np.outer(normal, normal)
    eye = seen_by.position - 2 * (seen_by.position @ normal - plane[3]) * normal
    rays = np.concatenate([triangles, np.ones((*triangles.shape[:2], 1))], axis=2) @ viewpoint.ray_basis.T @ across
    units = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
    ahead = units.min(axis=0) + units.max(axis=0)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0) if abs(ahead[2]) < 0.9 else (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    transform = np.eye(4)
    transform[:3] = np.stack([right, np.cross(right, ahead), -ahead, eye], axis=1)
    local = rays @ transform[:3, :3]
    flat = local[..., :2] / -local[..., 2:]
    focal = seen_by.focal_length_px(viewpoint.view.width) * _SCALE
    half = np.abs(flat).reshape(-1, 2).max(axis=0) + _MARGIN
    focal *= min(1.0, (LARGEST - 24) / (2 * focal * half.max()))
    # Multiples of 24: llvmpipe compiles the shading anew for targets with a power of two texels per side.
    width, height = (24 * int(np.ceil(side * focal / 12)) for side in half)
    camera = Camera("pane", transform, focal_length_mm=36.0 * focal / width, near=0.2, far=float(SKY_DISTANCE))
    view = View("pane", width, height)
    canvas, mask = Canvas(gl, view), np.zeros((height, width), np.uint8)
    for corners in flat * focal + (width / 2, height / 2):
        cv2.fillConvexPoly(mask, np.round(corners * 16).astype(np.int32), 1, shift=4)
    wide = cv2.dilate(mask, np.ones((2 * int(np.ceil(_MARGIN * focal)) + 1,) * 2, np.uint8))
    return Mirror(plane, camera, view, canvas, canvas.grid.holding(wide > 0, 0, 0))
