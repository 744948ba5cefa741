"""Optical flow, exact from geometry.

The flow at a pixel centre p that shows the surface point X is π'(X') − p. X' is the same point of the same object at the other
moment, and π' is the camera's projection then. The flow is defined even if another object hides X' then.

The flow of statics follows from the depth of the ground truth and the two cameras. Movables are drawn with the vertex shader of
the truth pass, with each vertex's position at the other moment as a further attribute. This covers rigid motion and changes of
pose alike. The sky is infinitely far away and moves only when the camera turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import GroundTruth, Rectangle, View
from valerie.rendering.projection import clip_from_view, view_from_world
from valerie.rendering.raster.gl.bounds import covered_rectangle
from valerie.rendering.raster.gl.cache import LeastRecentlyUsed
from valerie.rendering.raster.gl.targets import RenderTarget, area_of
from valerie.rendering.raster.gl.uniforms import Uniforms
from valerie.rendering.raster.upload.context import GraphicsContext, process_context
from valerie.rendering.raster.upload.drawing import SurfaceDrawer, table_texture
from valerie.rendering.raster.upload.movable_geometry import MeshBuffers, PlacedMesh
from valerie.rendering.raster.upload.scenes import Prepared
from valerie.rendering.scene_reading import camera_of
from valerie.scene.graph.model import Camera, Scene

#: Largest relative difference between the depths of a movable here and in the truth. Different programs may round depths
#: differently.
_SAME_DEPTH: Final = 1e-5

Flow = NDArray[np.float32]


class FlowPass:
    """The pass that draws optical flow. It shares uploaded scenes with the engine and the truth pass.

    Args:
        context: GL context; by default that of the process.
    """

    def __init__(self, context: GraphicsContext | None = None) -> None:
        self._context = context if context is not None else process_context()
        self._drawer = SurfaceDrawer(self._context, "flow.frag")
        self._target: LeastRecentlyUsed[RenderTarget] = LeastRecentlyUsed(1)

    def flow(self, now: Scene, then: Scene, view: View, truth: GroundTruth, *, deforming: bool = True) -> Flow:
        """Return the flow from one moment to another.

        Args:
            now, then: the same asset at two moments.
            view: camera and size, the same at both.
            truth: ground truth of ``now`` in this view.
            deforming: if False, keep the present shape of every mesh and move it rigidly.

        Returns:
            (H, W, 2) float32, pixels to the right and down; NaN where the object is absent then, has another mesh, or the
            point lies behind the camera then.

        Raises:
            UnknownName: the scenes have no such camera.
        """
        camera = camera_of(now, view)
        flow = still_flow(truth.depth, camera, camera_of(then, view))
        with self._context.current():
            before = self._context.scenes.prepare(now)
            rectangle = covered_rectangle([mesh.corners for mesh in before.placed], camera, view)
            if rectangle.empty:
                return flow
            samples = self._draw(before, self._context.scenes.prepare(then), view, rectangle, deforming=deforming)
        _insert_movables(flow, samples, truth, rectangle)
        return flow

    def velocity(self, now: Scene, after: Scene, view: View, truth: GroundTruth, seconds: float) -> Flow:
        """Return the image velocity of each pixel's surface point, from its position shortly after.

        The difference is forward, so that an object that starts at this moment already moves. Bodies move rigidly: a walk has
        only a few poses per cycle, and the jump from one to the next is not a velocity.

        Args:
            now, after: the same asset at two moments.
            view, truth: as for `flow`.
            seconds: time from ``now`` to ``after``.

        Returns:
            (H, W, 2) float32, pixels per second to the right and down; 0 where `flow` is undefined.
        """
        flow = self.flow(now, after, view, truth, deforming=False)
        velocity: Flow = np.nan_to_num(flow / np.float32(seconds), copy=False, nan=0.0)
        return velocity

    def close(self) -> None:
        """Free the resources of this pass. The context stays open, since its creator owns it."""
        if not self._context.closed:
            with self._context.current():
                self._target.clear()

    def _draw(
        self, before: Prepared, after: Prepared, view: View, rectangle: Rectangle, *, deforming: bool
    ) -> NDArray[np.float32]:
        """Draw the movables in a rectangle and return the output of ``flow.frag``, (h, w, 4); 0 where nothing is drawn."""
        camera, other = camera_of(before.scene, view), camera_of(after.scene, view)
        size = (view.width, view.height)
        target = self._target.get(size, lambda: RenderTarget(self._context.gl, size, ((4, "f4"),), depth=True))
        area = area_of(rectangle, view)
        target.use(area)
        target.clear()
        matrix = view_from_world(camera)
        clip_then = clip_from_view(other, view.width, view.height) @ view_from_world(other)
        values: Uniforms = {
            "clip_from_world": clip_from_view(camera, view.width, view.height) @ matrix,
            "depth_row": -matrix[2],
            "image_size": (float(view.width), float(view.height)),
        }
        pairs: list[tuple[PlacedMesh, MeshBuffers, Uniforms]] = []
        for mesh, counterpart in _counterparts(before, after):
            defined = counterpart is not None and (not deforming or _same_mesh(mesh.buffers, counterpart.buffers))
            shape = counterpart.buffers if counterpart is not None and defined and deforming else mesh.buffers
            world = counterpart.item.world if counterpart is not None else mesh.item.world
            pairs.append((mesh, shape, {"clip_from_elsewhere": clip_then @ world, "is_elsewhere": defined}))
        table = table_texture(self._context.gl, before.table())
        try:
            self._drawer.moved(pairs, before.statics.textures, table, values)
        finally:
            table.release()
        data = target.framebuffer.read(viewport=area, components=4, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(rectangle.height, rectangle.width, 4)[::-1]


def still_flow(depth: NDArray[np.float32], camera: Camera, other: Camera) -> Flow:
    """Return the flow of static surfaces from their depth.

    Args:
        depth: (H, W) float32, metres along the optical axis of ``camera``; inf for the sky.
        camera, other: the camera now and at the other moment.

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
    # The point divided by its depth, so that an infinitely distant point is a direction.
    local = rays @ relative[:3, :3].T + relative[:3, 3] / depth[..., None].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(local[..., 2] < 0.0, -focal_then / local[..., 2], np.nan)
    flow = np.empty((height, width, 2), np.float32)
    flow[..., 0] = 0.5 * width + scale * local[..., 0] - x
    flow[..., 1] = 0.5 * height - scale * local[..., 1] - y
    return flow


def _counterparts(before: Prepared, after: Prepared) -> Iterator[tuple[PlacedMesh, PlacedMesh | None]]:
    """Pair each placed mesh with its counterpart of the same node at the other moment, or with None."""
    then: dict[str, list[PlacedMesh]] = {}
    for mesh in after.placed:
        then.setdefault(mesh.item.node.path, []).append(mesh)
    indices: dict[str, int] = {}
    for mesh in before.placed:
        path = mesh.item.node.path
        index = indices[path] = indices.get(path, -1) + 1
        others = then.get(path, [])
        yield mesh, others[index] if index < len(others) else None


def _same_mesh(first: MeshBuffers, second: MeshBuffers) -> bool:
    """Return True if the vertices of two meshes correspond."""
    return first is second or (
        len(first.mesh.positions) == len(second.mesh.positions) and np.array_equal(first.mesh.faces, second.mesh.faces)
    )


def _insert_movables(flow: Flow, samples: NDArray[np.float32], truth: GroundTruth, rectangle: Rectangle) -> None:
    """Write the flow of movables to the pixels at which the truth shows them."""
    part = rectangle.slices
    ids = np.abs(samples[..., 3]).astype(np.int64)
    depth = truth.depth[part]
    with np.errstate(invalid="ignore"):
        visible = np.abs(samples[..., 2] - depth) <= _SAME_DEPTH * depth
    visible &= (ids // 65536 == truth.class_map[part]) & (ids % 65536 == truth.instance_map[part]) & (ids > 0)
    rows, columns = np.nonzero(visible)
    targets = samples[rows, columns]
    centres = np.stack([columns + rectangle.x + 0.5, rows + rectangle.y + 0.5], axis=1)
    vectors = (targets[:, :2] - centres).astype(np.float32)
    vectors[targets[:, 3] < 0.0] = np.nan
    flow[part][rows, columns] = vectors
