"""Movable geometry: a set of buffers per mesh, drawn with a world matrix."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from valerie.rendering.projection import Points, box_corners
from valerie.rendering.raster.gl.buffers import Buffers
from valerie.rendering.raster.gl.uniforms import Uniforms, set_uniforms
from valerie.rendering.raster.upload.materials import SurfaceKind
from valerie.rendering.scene_reading import DrawItem, normal_matrix
from valerie.scene.graph.model import Mesh


class MeshBuffers:
    """A mesh on the GPU, in its own coordinates.

    Attributes:
        mesh: the mesh. The reference keeps its ``id``, a cache key, from being reused.
        corners: (8, 3) corners of the mesh's own bounding box.
    """

    def __init__(self, gl: moderngl.Context, mesh: Mesh) -> None:
        self.mesh = mesh
        self.corners: Points = box_corners(
            mesh.positions.min(axis=0).astype(np.float64), mesh.positions.max(axis=0).astype(np.float64)
        )
        attributes = {"in_position": mesh.positions, "in_normal": mesh.normals, "in_uv": mesh.uvs}
        self._buffers = Buffers(gl, attributes, mesh.faces)

    def array(self, program: moderngl.Program, elsewhere: MeshBuffers | None = None) -> moderngl.VertexArray:
        """Return the vertex array of a program.

        Args:
            elsewhere: the same mesh at another moment, if the program also reads its positions then; the caller releases the
                array.
        """
        if elsewhere is None:
            return self._buffers.array(program)
        return self._buffers.array_with(program, elsewhere._buffers)  # noqa: SLF001

    def release(self) -> None:
        """Free the buffers."""
        self._buffers.release()


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMesh:
    """A mesh at its place in the world.

    Attributes:
        row: row of its material in the material table.
        corners: (8, 3) corners of its oriented bounding box in the world, metres.
        mirrored: True if its world matrix is a reflection.
        values: its own uniforms.
    """

    buffers: MeshBuffers
    item: DrawItem
    kind: SurfaceKind
    row: int
    corners: Points
    mirrored: bool
    values: Uniforms

    @classmethod
    def place(cls, buffers: MeshBuffers, item: DrawItem, kind: SurfaceKind, row: int) -> PlacedMesh:
        corners = buffers.corners @ item.world[:3, :3].T + item.world[:3, 3]
        values: Uniforms = {
            "world": item.world,
            "normal_matrix": normal_matrix(item.world),
            "ids": (row, item.node.label_id, item.node.instance_id),
        }
        return cls(buffers, item, kind, row, corners, bool(np.linalg.det(item.world[:3, :3]) < 0), values)

    def draw(self, program: moderngl.Program, elsewhere: MeshBuffers | None = None) -> None:
        """Draw with ``program``, whose other uniforms are already set. See `MeshBuffers.array` for ``elsewhere``."""
        set_uniforms(program, self.values)
        gl = program.ctx
        gl.front_face = "cw" if self.mirrored else "ccw"
        array = self.buffers.array(program, elsewhere)
        array.render()
        if elsewhere is not None:
            array.release()
        gl.front_face = "ccw"
