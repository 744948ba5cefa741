"""Optical flow: where what is seen at a pixel is seen at another moment, exact from geometry.

For the surface point X under a pixel centre p, and the camera's projection π, the flow to another moment is π'(X') − p, where X'
is the same point of the same object then and π' the camera then. Whether something else hides the point then does not matter.

Everything that stands still follows from the depth of the ground truth and the two cameras. What moves is drawn with the same
vertex shader as the truth, with the place of every vertex at the other moment as a further attribute: rigid movements and
bodies that change their pose alike. The sky is infinitely far away: it moves as the camera turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import GroundTruth, Rectangle, View
from valerie.rendering.projection import clip_from_view, view_from_world
from valerie.rendering.raster.bounds import covered_rectangle
from valerie.rendering.raster.cache import LeastRecentlyUsed
from valerie.rendering.raster.context import GraphicsContext, process_context
from valerie.rendering.raster.drawing import SurfaceDrawer, table_texture
from valerie.rendering.raster.movable_geometry import MeshBuffers, PlacedMesh
from valerie.rendering.raster.scenes import Prepared
from valerie.rendering.raster.targets import Target, gl_rectangle
from valerie.rendering.scene_reading import camera_of
from valerie.scene.graph.model import Camera, Scene

#: A movable is what the truth shows where its depth is the truth's up to this share (another program may round it otherwise).
_SAME_DEPTH: Final = 1e-5

Flow = NDArray[np.float32]


class FlowPass:
    """Draws flow. One per process; shares the uploaded scenes with engine and truth pass.

    Args:
        context: the process's context if not given.
    """

    def __init__(self, context: GraphicsContext | None = None) -> None:
        self._context = context if context is not None else process_context()
        self._drawer = SurfaceDrawer(self._context, "flow.frag", elsewhere=True)
        self._target: LeastRecentlyUsed[Target] = LeastRecentlyUsed(1)

    def flow(self, now: Scene, then: Scene, view: View, truth: GroundTruth, *, deforming: bool = True) -> Flow:
        """The flow from one moment to another.

        Args:
            now, then: the same asset at two moments.
            view: camera and size, the same at both.
            truth: of ``now`` in this view.
            deforming: False leaves every mesh in the shape that it has now, and moves it as a whole.

        Returns:
            (H, W, 2) float32, pixels to the right and down; NaN where an object is not there then, has another mesh, or
            the point lies behind the camera then.

        Raises:
            UnknownName: the scenes have no such camera.
        """
        camera, other = camera_of(now, view), camera_of(then, view)
        found = still_flow(truth.depth, camera, other)
        with self._context.current() as gl:
            before = self._context.scenes.prepare(now)
            rectangle = covered_rectangle([mesh.corners for mesh in before.placed], camera, view)
            if rectangle.empty:
                return found
            after = self._context.scenes.prepare(then)
            table = table_texture(gl, before.table())
            try:
                drawn = self._draw(before, after, camera, other, view, rectangle, table, deforming)
            finally:
                table.release()
        _put_in(found, drawn, truth, rectangle)
        return found

    def velocity(self, now: Scene, after: Scene, view: View, truth: GroundTruth, seconds: float) -> Flow:
        """The velocity of what is seen at each pixel, from where it is shortly after.

        Not before: what begins to move at this very moment moves.

        Bodies move as a whole: a walk is drawn at a few instants of its cycle, and jumps between them are no velocity.

        Args:
            now, after: the same asset at two moments.
            view, truth: as for `flow`.
            seconds: from the one to the other.

        Returns:
            (H, W, 2) float32, pixels per second to the right and down; 0 where `flow` is undefined.
        """
        flow = self.flow(now, after, view, truth, deforming=False)
        velocity: Flow = np.nan_to_num(flow / np.float32(seconds), copy=False, nan=0.0)
        return velocity

    def close(self) -> None:
        """Free what this pass holds; the context stays with who made it."""
        if not self._context.closed:
            with self._context.current():
                self._target.clear()

    def _draw(
        self,
        before: Prepared,
        after: Prepared,
        camera: Camera,
        other: Camera,
        view: View,
        rectangle: Rectangle,
        table: Any,
        deforming: bool,
    ) -> NDArray[np.float32]:
        """(h, w, 4) of the rectangle, as the shader says; 0 where nothing is drawn."""
        size = (view.width, view.height)
        target = self._target.get(size, lambda: Target(self._context.gl, size, ((4, "f4"),), depth=True))
        area = gl_rectangle(rectangle, view)
        target.use(area)
        target.clear()
        matrix = view_from_world(camera)
        clip_then = clip_from_view(other, view.width, view.height) @ view_from_world(other)
        values = {
            "clip_from_world": clip_from_view(camera, view.width, view.height) @ matrix,
            "depth_row": -matrix[2],
            "image_size": (float(view.width), float(view.height)),
        }
        pairs = []
        for mesh, counterpart in _counterparts(before, after):
            known = counterpart is not None and (not deforming or _same_mesh(mesh.buffers, counterpart.buffers))
            shape = counterpart.buffers if counterpart is not None and known and deforming else mesh.buffers
            world = counterpart.item.world if counterpart is not None else mesh.item.world
            pairs.append((mesh, shape, {"clip_from_elsewhere": clip_then @ world, "is_elsewhere": known}))
        self._drawer.moved(pairs, before.statics.textures, table, values)
        data = target.framebuffer.read(viewport=area, components=4, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(rectangle.height, rectangle.width, 4)[::-1]


def still_flow(depth: NDArray[np.float32], camera: Camera, other: Camera) -> Flow:
    """The flow of everything that does not move, from its depth.

    Args:
        depth: (H, W) float32, metres along the optical axis of ``camera``, inf for what is infinitely far away.
        camera, other: now and at the other moment.

    Returns:
        (H, W, 2) float32, pixels to the right and down; NaN where a point lies behind the other camera.
    """
    height, width = depth.shape
    if np.array_equal(camera.transform, other.transform) and camera.focal_length_px(width) == other.focal_length_px(
        width
    ):
        return np.zeros((height, width, 2), np.float32)
    focal, focal_then = camera.focal_length_px(width), other.focal_length_px(width)
    x, y = np.arange(width) + 0.5, (np.arange(height) + 0.5)[:, None]
    rays = np.empty((height, width, 3))  # of depth 1, in the camera's axes
    rays[..., 0], rays[..., 1], rays[..., 2] = (x - 0.5 * width) / focal, (0.5 * height - y) / focal, -1.0
    relative = np.linalg.inv(other.transform) @ camera.transform
    # The point divided by its depth, so that what is infinitely far away is a direction.
    seen = rays @ relative[:3, :3].T + relative[:3, 3] / depth[..., None].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(seen[..., 2] < 0.0, -focal_then / seen[..., 2], np.nan)
    found = np.empty((height, width, 2), np.float32)
    found[..., 0] = 0.5 * width + scale * seen[..., 0] - x
    found[..., 1] = 0.5 * height - scale * seen[..., 1] - y
    return found


def _counterparts(before: Prepared, after: Prepared) -> Iterator[tuple[PlacedMesh, PlacedMesh | None]]:
    """Each placed mesh with the same one of the same node at the other moment, if it is there."""
    then: dict[str, list[PlacedMesh]] = {}
    for mesh in after.placed:
        then.setdefault(mesh.item.node.path, []).append(mesh)
    met: dict[str, int] = {}
    for mesh in before.placed:
        path = mesh.item.node.path
        index = met[path] = met.get(path, -1) + 1
        others = then.get(path, [])
        yield mesh, others[index] if index < len(others) else None


def _same_mesh(one: MeshBuffers, other: MeshBuffers) -> bool:
    """Whether vertices correspond to each other."""
    return one is other or (
        len(one.mesh.positions) == len(other.mesh.positions) and np.array_equal(one.mesh.faces, other.mesh.faces)
    )


def _put_in(found: Flow, drawn: NDArray[np.float32], truth: GroundTruth, rectangle: Rectangle) -> None:
    """Put the flow of movables where the truth shows them."""
    part = rectangle.slices
    ids = np.abs(drawn[..., 3]).astype(np.int64)
    depth = truth.depth[part]
    with np.errstate(invalid="ignore"):
        shown = np.abs(drawn[..., 2] - depth) <= _SAME_DEPTH * depth
    shown &= (ids // 65536 == truth.class_map[part]) & (ids % 65536 == truth.instance_map[part]) & (ids > 0)
    rows, columns = np.nonzero(shown)
    there = drawn[rows, columns]
    centres = np.stack([columns + rectangle.x + 0.5, rows + rectangle.y + 0.5], axis=1)
    moved = (there[:, :2] - centres).astype(np.float32)
    moved[there[:, 3] < 0.0] = np.nan
    found[part][rows, columns] = moved
