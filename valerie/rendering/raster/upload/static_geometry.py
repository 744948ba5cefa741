"""Static geometry, flattened to world space: one vertex buffer, one index buffer, a few draw calls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from typing import Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points, box_corners, touches_clip_volume
from valerie.rendering.raster.gl.buffers import Buffers
from valerie.rendering.raster.gl.tiles import Mask
from valerie.rendering.raster.upload.materials import SurfaceKind
from valerie.rendering.raster.upload.surroundings import SurfaceSample, sample_surfaces
from valerie.rendering.scene_reading import DrawItem, normal_matrix
from valerie.scene.graph.model import Matrix


@dataclass(frozen=True, slots=True)
class Batch:
    """The consecutive indices of one draw call."""

    kind: SurfaceKind
    first: int
    count: int


#: Largest number of triangles outside the volume that are drawn with those around them, which is cheaper than another call.
_GAP: Final = 256
#: Number of triangles of a mesh beyond which it must be larger to appear in a coarse picture.
_FINE: Final = 64
_SERIALS = count()


class StaticGeometry:
    """The static part of a scene on the GPU.

    Args:
        gl: the current context.
        items: the nodes to draw. The reference keeps the ``id`` of their meshes, cache keys, from being reused.
        rows: per item and mesh, the row of its material in the material table.
        kinds: per item and mesh, its kind of surface.

    Attributes:
        meshes: each node with the rows of its meshes.
        serial: unique number in this process (an ``id`` may be reused).
        low, high: (3,) world bounds of all vertices, metres; a unit box around the origin if there are none.
        core_low, core_high: (3,) bounds without the outermost 0.5 % of the vertices on each side, which leaves out a ground plane
            that reaches to the horizon, metres.
        sample: places on the surfaces that are not clear.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        items: Sequence[DrawItem],
        rows: Sequence[Sequence[int]],
        kinds: Sequence[Sequence[SurfaceKind]],
    ) -> None:
        self.meshes = tuple(zip(items, rows, strict=True))
        self.serial = next(_SERIALS)
        vertices: list[tuple[NDArray[np.float32], ...]] = []
        ids: list[NDArray[np.uint32]] = []
        solid: list[tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.bool_]]] = []
        faces: dict[SurfaceKind, list[NDArray[np.uint32]]] = {}
        boxes: dict[SurfaceKind, list[Points]] = {}
        sizes: dict[SurfaceKind, list[int]] = {}
        start = 0
        for item, item_rows, item_kinds in zip(items, rows, kinds, strict=True):
            mirrored = np.linalg.det(item.world[:3, :3]) < 0
            for mesh, row, kind in zip(item.meshes, item_rows, item_kinds, strict=True):
                count = len(mesh.positions)
                vertices.append((*_in_world(item, mesh.positions, mesh.normals), mesh.uvs))
                ids.append(
                    np.broadcast_to(np.array([row, item.node.label_id, item.node.instance_id], np.uint32), (count, 3))
                )
                corners = (mesh.faces[:, ::-1] if mirrored else mesh.faces) + np.uint32(start)
                faces.setdefault(kind, []).append(corners)
                boxes.setdefault(kind, []).append(_box(vertices[-1][0]))
                sizes.setdefault(kind, []).append(corners.size)
                if not kind.clear:
                    both = np.full(len(corners), kind.double_sided)
                    solid.append((corners, np.full(len(corners), row, np.uint32), both))
                start += count
        self.triangles = 0
        self.batches: list[Batch] = []
        self.low, self.high = np.full(3, -0.5), np.full(3, 0.5)
        self.core_low, self.core_high = self.low, self.high
        self.sample = SurfaceSample.empty(0.0)
        self._buffers: Buffers | None = None
        # Of each mesh, in the order of the indices: its first index, and the corners of its bounding box.
        self._starts, self._boxes = np.zeros(1, np.int64), np.zeros((0, 8, 3))
        if not start:
            return
        positions, normals, uvs = (np.concatenate(part) for part in zip(*vertices, strict=True))
        self.low, self.high = positions.min(axis=0).astype(np.float64), positions.max(axis=0).astype(np.float64)
        self.core_low, self.core_high = np.quantile(positions, (0.005, 0.995), axis=0)
        if solid:
            corners, of_faces, two_sided = (np.concatenate(part) for part in zip(*solid, strict=True))
            self.sample = sample_surfaces(positions, corners, of_faces, two_sided, self.core_low, self.core_high)
        ordered: list[NDArray[np.uint32]] = []
        # Cut surfaces and panes come last, so that all others form one range for passes that need only shapes.
        order = sorted(faces, key=lambda k: (k.cut or k.clear, k))
        for kind in order:
            corners = np.concatenate(faces[kind])
            self.batches.append(Batch(kind, self.triangles * 3, corners.size))
            self.triangles += len(corners)
            ordered.append(corners)
        self._starts = np.cumsum([0, *(size for kind in order for size in sizes[kind])])
        self._boxes = np.array([box for kind in order for box in boxes[kind]])
        attributes = {
            "in_position": positions, "in_normal": normals, "in_uv": uvs, "in_ids": np.concatenate(ids),
        }  # fmt: skip
        self._buffers = Buffers(gl, attributes, np.concatenate(ordered))

    @property
    def whole(self) -> tuple[Batch, ...]:
        """Batches merged for passes that need no colour: single-sided, double-sided (both solid), and the others."""
        merged: list[Batch] = []
        solid = [b for b in self.batches if not (b.kind.cut or b.kind.clear)]
        for sided in (False, True):
            merged += _joined([b for b in solid if b.kind.double_sided == sided])
        return (*merged, *(b for b in self.batches if b.kind.cut or b.kind.clear))

    def within(self, clip_from_world: Matrix) -> Mask:
        """Return (M,) bool per mesh, False if its bounding box lies outside a clip volume."""
        return touches_clip_volume(self._boxes, clip_from_world)

    def beyond(self, plane: Points) -> Mask:
        """Return (M,) bool per mesh, False if its bounding box lies on the negative side of a plane, (4,)."""
        seen: Mask = (self._boxes @ plane[:3] + plane[3]).max(axis=1, initial=-np.inf) > 0
        return seen

    def appearing(self, eye: Points, least: float) -> Mask:
        """Return (M,) bool per mesh, False if it is too small for a coarse picture.

        Args:
            eye: (3,) metres.
            least: least size of a mesh of up to 64 triangles, as a share of its distance. One of more needs as much more area.
        """
        first, last = self._boxes[:, 0], self._boxes[:, -1]
        distance = np.linalg.norm((first + last) / 2 - eye, axis=1)
        triangles = np.diff(self._starts) / 3
        shares = least * np.sqrt(np.maximum(triangles / _FINE, 1.0))
        seen: Mask = np.linalg.norm(last - first, axis=1) >= shares * distance
        return seen

    def parts(self, batch: Batch, drawn: Mask) -> list[Batch]:
        """Return the ranges of a batch that hold the meshes of ``drawn``, (M,) bool from `within`, and few others."""
        first, last = np.searchsorted(self._starts, (batch.first, batch.first + batch.count))
        meshes = first + np.flatnonzero(drawn[first:last])
        if not len(meshes):
            return []
        begins, ends = self._starts[meshes], self._starts[meshes + 1]
        gaps = np.flatnonzero(begins[1:] - ends[:-1] > _GAP * 3)
        ranges = zip(begins[np.append(0, gaps + 1)], ends[np.append(gaps, -1)], strict=True)
        return [Batch(batch.kind, int(begin), int(end - begin)) for begin, end in ranges]

    def array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Return the vertex array of a program. There must be at least one batch."""
        assert self._buffers is not None
        return self._buffers.array(program)

    def release(self) -> None:
        """Free the buffers."""
        if self._buffers is not None:
            self._buffers.release()


def _box(positions: NDArray[np.float32]) -> Points:
    """Return the (8, 3) corners of the box around vertices, (N, 3); those of a point at the origin without any."""
    if not len(positions):
        return np.zeros((8, 3))
    return box_corners(positions.min(axis=0).astype(np.float64), positions.max(axis=0).astype(np.float64))


def _in_world(
    item: DrawItem, positions: NDArray[np.float32], normals: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    world = item.world
    world_positions = (positions.astype(np.float64) @ world[:3, :3].T + world[:3, 3]).astype(np.float32)
    world_normals = normals @ normal_matrix(world).T
    length = np.linalg.norm(world_normals, axis=1, keepdims=True)
    return world_positions, (world_normals / np.maximum(length, 1e-12)).astype(np.float32)


def _joined(batches: Sequence[Batch]) -> list[Batch]:
    """Return batches with adjoining ranges merged."""
    runs: list[Batch] = []
    for batch in batches:
        if runs and runs[-1].first + runs[-1].count == batch.first:
            runs[-1] = Batch(runs[-1].kind, runs[-1].first, runs[-1].count + batch.count)
        else:
            runs.append(batch)
    return runs
