"""Meshes of a glTF file: triangles from accessors, with computed normals if the file has none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pygltflib
import trimesh
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.scene.gltf.common import MAX_VERTICES, vectors_from_y_up
from valerie.scene.gltf.container import Container, item
from valerie.scene.gltf.materials import read_material
from valerie.scene.gltf.textures import TextureReader, unique_names
from valerie.scene.graph.model import Material, Mesh

#: Material of primitives that have none.
DEFAULT_MATERIAL = "default"
#: Modes of primitives without a surface.
_LINES_AND_POINTS = (pygltflib.POINTS, pygltflib.LINES, pygltflib.LINE_LOOP, pygltflib.LINE_STRIP)


class MeshReader:
    """The meshes of a glTF file. Each is read once, so that nodes with the same mesh in the file share it in the scene.

    Attributes:
        computed_normals: index of a glTF mesh to the normals that were computed, in words.
    """

    def __init__(self, container: Container, textures: TextureReader, notes: list[str]) -> None:
        self._container, self._document = container, container.document
        self._textures, self._notes = textures, notes
        self._names = unique_names([material.name for material in self._document.materials], "material")
        self._meshes: dict[int, tuple[Mesh, ...]] = {}
        self._arrays: dict[tuple[int, str], NDArray[Any]] = {}
        self._vertices = 0
        self._needs_default = False
        self.computed_normals: dict[int, set[str]] = {}

    def read(self, index: int) -> tuple[Mesh, ...]:
        """Return the primitives of a glTF mesh."""
        if index not in self._meshes:
            field = f"{self._container.name}: meshes.{index}"
            primitives = item(self._document.meshes, index, f"{self._container.name}: meshes").primitives
            meshes = (
                self._primitive(primitive, index, f"{field}.primitives.{k}") for k, primitive in enumerate(primitives)
            )
            self._meshes[index] = tuple(mesh for mesh in meshes if mesh is not None)
        return self._meshes[index]

    def all_materials(self) -> dict[str, Material]:
        """Return every material of the file by name. Call it after reading the meshes."""
        materials = {
            name: read_material(
                material,
                name,
                texture_name=self._textures.name,
                notes=self._notes,
            )
            for name, material in zip(self._names, self._document.materials, strict=True)
        }
        if self._needs_default:
            materials.setdefault(DEFAULT_MATERIAL, Material(DEFAULT_MATERIAL))
        return materials

    def _primitive(self, primitive: pygltflib.Primitive, mesh: int, field: str) -> Mesh | None:
        if primitive.mode in _LINES_AND_POINTS:
            self._notes.append("lines and points are ignored")
            return None
        if primitive.targets:
            self._notes.append("morph targets are ignored")
        attributes = primitive.attributes
        if attributes.COLOR_0 is not None:
            self._notes.append("vertex colours are ignored")
        if attributes.POSITION is None:
            raise InvalidInput("a mesh without positions", field=field)
        positions = self._vectors(attributes.POSITION, finite=True)
        count = len(positions)
        faces = self._faces(primitive.indices, primitive.mode, count, field)
        uvs = self._uvs(attributes.TEXCOORD_0, count, field)
        has_normals = attributes.NORMAL is not None
        normals = self._normals(attributes.NORMAL) if has_normals else np.zeros((count, 3), np.float32)
        if len(normals) != count:
            raise InvalidInput("normals and positions differ in number", field=field, value=len(normals), limit=count)
        material = self._material(primitive.material, field)
        mesh_with_normals = with_face_normals(Mesh(positions, normals, uvs, faces, material))
        if mesh_with_normals.normals is not normals:
            reason = "normals of no length or not finite" if has_normals else "missing normals"
            self.computed_normals.setdefault(mesh, set()).add(reason)
        return mesh_with_normals

    def _material(self, index: int | None, field: str) -> str:
        if index is None:
            self._needs_default = True
            return DEFAULT_MATERIAL
        return item(self._names, index, f"{field}: materials")

    def _vectors(self, accessor: int, *, finite: bool) -> NDArray[np.float32]:
        """Return positions or normals: (V, 3) float32, z up."""
        key = (accessor, "vectors")
        if key not in self._arrays:
            raw = self._container.array(accessor, kind="VEC3")
            if raw.dtype != np.float32:
                raise InvalidInput("not 32-bit floats", field=f"{self._container.name}: accessors.{accessor}")
            self._vertices += len(raw)
            if self._vertices > 2 * MAX_VERTICES:
                raise InvalidInput("too many vertices", field=self._container.name, limit=MAX_VERTICES)
            self._arrays[key] = vectors_from_y_up(raw.astype(np.float32, copy=False))
        if finite and not np.isfinite(self._arrays[key]).all():
            raise InvalidInput("not finite 32-bit floats", field=f"{self._container.name}: accessors.{accessor}")
        return self._arrays[key]

    def _normals(self, accessor: int) -> NDArray[np.float32]:
        """Return normals: (V, 3) float32, z up, of length 1; zero for those of the file without length or not finite."""
        key = (accessor, "normals")
        if key not in self._arrays:
            normals = self._vectors(accessor, finite=False)
            lengths = np.linalg.norm(normals.astype(np.float64), axis=1)
            if not np.all(np.abs(lengths - 1.0) <= 1e-3):
                usable = np.isfinite(lengths) & (lengths > 1e-9)
                scale = np.where(usable, lengths, 1.0)[:, None]
                normals = np.where(usable[:, None], normals / scale, 0.0).astype(np.float32)
            self._arrays[key] = normals
        return self._arrays[key]

    def _uvs(self, accessor: int | None, count: int, field: str) -> NDArray[np.float32]:
        if accessor is None:
            return np.zeros((count, 2), np.float32)
        key = (accessor, "uvs")
        if key not in self._arrays:
            raw = self._container.array(accessor, kind="VEC2")
            if raw.dtype.kind == "u":
                raw = raw / float(np.iinfo(raw.dtype).max)
            self._arrays[key] = raw.astype(np.float32, copy=False)
        if len(self._arrays[key]) != count:
            raise InvalidInput("texture coordinates and positions differ in number", field=field, limit=count)
        return self._arrays[key]

    def _faces(self, accessor: int | None, mode: int | None, count: int, field: str) -> NDArray[np.uint32]:
        if accessor is None:
            indices: NDArray[Any] = np.arange(count, dtype=np.uint32)
        else:
            key = (accessor, "faces")
            if key not in self._arrays:
                self._arrays[key] = self._container.array(accessor, kind="SCALAR").astype(np.uint32)
            indices = self._arrays[key]
        if len(indices) and int(indices.max()) >= count:
            raise InvalidInput(
                "an index beyond the last vertex", field=field, value=int(indices.max()), limit=count - 1
            )
        if mode in (pygltflib.TRIANGLE_STRIP, pygltflib.TRIANGLE_FAN):
            return unrolled(indices, fan=mode == pygltflib.TRIANGLE_FAN)
        if len(indices) % 3:
            raise InvalidInput(
                "not a whole number of triangles", field=field, value=f"{len(indices)} indices", limit="3 each"
            )
        return indices.reshape(-1, 3)


def unrolled(indices: NDArray[np.uint32], *, fan: bool) -> NDArray[np.uint32]:
    """Return the (F, 3) triangles of a strip or fan of F + 2 vertices, with one orientation (glTF 2.0, section 3.7.2.1)."""
    number = max(len(indices) - 2, 0)
    steps = np.arange(number)
    if fan:
        corners = np.stack([steps + 1, steps + 2, np.zeros_like(steps)], axis=1)
    else:
        odd = steps % 2
        corners = np.stack([steps, steps + 1 + odd, steps + 2 - odd], axis=1)
    return indices[corners].astype(np.uint32)


def with_face_normals(mesh: Mesh) -> Mesh:
    """Return the mesh with face normals at all corners whose normal is 0; the mesh itself if there are none.

    Triangles with such a corner no longer share their vertices.
    """
    lacking: NDArray[np.bool_] = np.logical_not(mesh.normals.any(axis=1))
    faces = lacking[mesh.faces].any(axis=1)
    if not faces.any():
        return mesh
    corners = mesh.faces[faces].reshape(-1)
    flat = flat_normals(mesh.positions[corners])
    own = np.where(lacking[corners, None], flat, mesh.normals[corners])
    offset = 0 if faces.all() else len(mesh.positions)
    indices = mesh.faces.copy()
    indices[faces] = offset + np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)

    def joined(before: NDArray[np.float32], after: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.concatenate([before[:offset], after])

    return Mesh(
        joined(mesh.positions, mesh.positions[corners]),
        joined(mesh.normals, own),
        joined(mesh.uvs, mesh.uvs[corners]),
        indices,
        mesh.material,
    )


def flat_normals(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the face normal at each corner, (3·F, 3), of triangles with (3·F, 3) corners; degenerate triangles point up."""
    triangles = corners.reshape(-1, 3, 3).astype(np.float64)
    normals, valid = trimesh.triangles.normals(triangles)  # type: ignore[no-untyped-call]
    result = np.tile(np.array([0.0, 0.0, 1.0]), (len(valid), 1))
    result[valid] = normals
    return np.repeat(result, 3, axis=0).astype(np.float32)
