"""Vertices and triangles on the GPU."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import moderngl
import numpy as np
from numpy.typing import NDArray

#: Vertex attributes and their formats in moderngl's notation.
_ATTRIBUTES: Final = {"in_position": "3f4", "in_normal": "3f4", "in_uv": "2f4", "in_ids": "3u4"}


class Buffers:
    """One set of triangles.

    Args:
        gl: the current context.
        vertices: values of each vertex attribute by name, a row per vertex.
        faces: (F, 3) uint32 indices of vertices.
    """

    def __init__(self, gl: moderngl.Context, vertices: Mapping[str, NDArray[Any]], faces: NDArray[np.uint32]) -> None:
        self._gl = gl
        self._vertices = {name: gl.buffer(np.ascontiguousarray(array).tobytes()) for name, array in vertices.items()}
        self._faces = gl.buffer(np.ascontiguousarray(faces).tobytes())
        self._arrays: dict[int, moderngl.VertexArray] = {}

    def array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Return the vertex array of a program, with the attributes that it reads."""
        array = self._arrays.get(program.glo)
        if array is None:
            array = self._arrays[program.glo] = self._gl.vertex_array(
                program, self._read_by(program), index_buffer=self._faces
            )
        return array

    def array_with(self, program: moderngl.Program, elsewhere: Buffers) -> moderngl.VertexArray:
        """Return the vertex array of a program that also reads the positions of ``elsewhere``. The caller releases it."""
        positions = (elsewhere._vertices["in_position"], _ATTRIBUTES["in_position"], "in_elsewhere")
        return self._gl.vertex_array(program, [*self._read_by(program), positions], index_buffer=self._faces)

    def _read_by(self, program: moderngl.Program) -> list[tuple[moderngl.Buffer, str, str]]:
        return [(buffer, _ATTRIBUTES[name], name) for name, buffer in self._vertices.items() if name in program]

    def release(self) -> None:
        """Free the buffers and the vertex arrays."""
        for array in self._arrays.values():
            array.release()
        for buffer in (*self._vertices.values(), self._faces):
            buffer.release()
