"""What moves: one set of buffers per mesh, drawn with a world matrix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from valerie.rendering.raster.camera_math import Points, box_corners
from valerie.rendering.raster.materials import SurfaceKind
from valerie.rendering.raster.static_geometry import ATTRIBUTES
from valerie.rendering.raster.uniforms import set_uniforms
from valerie.rendering.scene_reading import DrawItem, normal_matrix
from valerie.scene.model import Mesh


class MeshBuffers:
    """One mesh on the graphics card, in its own coordinates.

    Attributes:
        mesh: kept alive, since the cache that holds these buffers goes by its identity.
        corners: (8, 3) corners of the mesh's own bounding box.
    """

    def __init__(self, gl: moderngl.Context, mesh: Mesh) -> None:
        self.mesh = mesh
        self._gl = gl
        self.corners: Points = box_corners(
            mesh.positions.min(axis=0).astype(np.float64), mesh.positions.max(axis=0).astype(np.float64)
        )
        self._buffers = {
            name: gl.buffer(np.ascontiguousarray(array).tobytes())
            for name, array in (("in_position", mesh.positions), ("in_normal", mesh.normals), ("in_uv", mesh.uvs))
        }
        self._indices = gl.buffer(np.ascontiguousarray(mesh.faces).tobytes())
        self._arrays: dict[int, moderngl.VertexArray] = {}

    def array(self, program: moderngl.Program, elsewhere: MeshBuffers | None = None) -> moderngl.VertexArray:
        """The vertex array of a program, with those attributes that it reads.

        Args:
            program: the program.
            elsewhere: the same mesh at another moment, whose positions it reads too; the caller releases the array.
        """
        if elsewhere is not None:
            found = [(buffer, ATTRIBUTES[name], name) for name, buffer in self._buffers.items() if name in program]
            found.append((elsewhere._buffers["in_position"], ATTRIBUTES["in_position"], "in_elsewhere"))  # noqa: SLF001
            return self._gl.vertex_array(program, found, index_buffer=self._indices, index_element_size=4)
        return self._own_array(program)

    def _own_array(self, program: moderngl.Program) -> moderngl.VertexArray:
        found = self._arrays.get(program.glo)
        if found is None:
            content = [(buffer, ATTRIBUTES[name], name) for name, buffer in self._buffers.items() if name in program]
            found = self._gl.vertex_array(program, content, index_buffer=self._indices, index_element_size=4)
            self._arrays[program.glo] = found
        return found

    def release(self) -> None:
        """Free the buffers."""
        for array in self._arrays.values():
            array.release()
        for buffer in (*self._buffers.values(), self._indices):
            buffer.release()


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMesh:
    """A mesh at its place in the world.

    Attributes:
        row: of its material in the material table.
        corners: (8, 3) metres, corners of its (turned) bounding box in the world.
        mirrored: its world matrix turns right into left.
        values: uniforms of its own.
    """

    buffers: MeshBuffers
    item: DrawItem
    kind: SurfaceKind
    row: int
    corners: Points
    mirrored: bool
    values: Mapping[str, Any]

    @classmethod
    def place(cls, buffers: MeshBuffers, item: DrawItem, kind: SurfaceKind, row: int) -> PlacedMesh:
        corners = buffers.corners @ item.world[:3, :3].T + item.world[:3, 3]
        values = {
            "world": item.world,
            "normal_matrix": normal_matrix(item.world),
            "ids": (row, item.node.label_id, item.node.instance_id),
        }
        return cls(buffers, item, kind, row, corners, bool(np.linalg.det(item.world[:3, :3]) < 0), values)

    def draw(self, program: moderngl.Program, elsewhere: MeshBuffers | None = None) -> None:
        """Draw with ``program``, whose other uniforms are set; see `MeshBuffers.array`."""
        set_uniforms(program, self.values)
        gl = program.ctx
        gl.front_face = "cw" if self.mirrored else "ccw"
        array = self.buffers.array(program, elsewhere)
        array.render()
        if elsewhere is not None:
            array.release()
        gl.front_face = "ccw"
