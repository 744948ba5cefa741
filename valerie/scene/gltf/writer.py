"""Write a scene as one self-contained .glb."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.scene.gltf.common import (
    EMISSIVE_STRENGTH,
    EXTRAS_KEY,
    LIGHTS,
    SPECULAR,
    transform_to_y_up,
    vectors_to_y_up,
    view_to_y_up,
)
from valerie.scene.gltf.images import encode_png
from valerie.scene.gltf.lights import write_light
from valerie.scene.gltf.materials import write_material
from valerie.scene.graph.model import Camera, Light, Matrix, Mesh, Scene
from valerie.scene.graph.naming import ROOT, SUN_PATH

#: Aspect ratio for glTF's vertical angle of view. This project's reader uses the focal length instead.
_ASPECT_RATIO = 16 / 9


def save_gltf(scene: Scene, path: Path) -> None:
    """Write a scene as binary glTF 2.0 with everything embedded. `load_gltf` returns the same scene.

    Raises:
        InvalidInput: the file's name does not end in .glb.
    """
    if path.suffix.lower() != ".glb":
        raise InvalidInput("scenes are written as .glb", field="path", value=path.name)
    path.write_bytes(_Writer(scene).to_bytes())


class _Writer:
    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._document = pygltflib.GLTF2(asset=pygltflib.Asset(version="2.0", generator="VALERIE"))
        self._binary = bytearray()
        self._arrays: dict[tuple[int, str], int] = {}
        self._meshes: dict[tuple[int, ...], int] = {}
        self._lights: list[Light] = []
        self._textures = {name: index for index, name in enumerate(scene.textures)}
        self._materials = {name: index for index, name in enumerate(scene.materials)}

    def to_bytes(self) -> bytes:
        document = self._document
        self._write_textures()
        for material in self._scene.materials.values():
            document.materials.append(write_material(material, self._textures.__getitem__))
        roots = [*self._write_nodes(), *self._write_cameras(), self._write_sun()]
        extras = {"environment": asdict(self._scene.environment)}
        document.scenes = [pygltflib.Scene(name=ROOT, nodes=roots, extras={EXTRAS_KEY: extras})]
        document.scene = 0
        document.extensionsUsed = [LIGHTS, SPECULAR]
        if any(EMISSIVE_STRENGTH in material.extensions for material in document.materials):
            document.extensionsUsed.append(EMISSIVE_STRENGTH)
        document.buffers = [pygltflib.Buffer(byteLength=len(self._binary))]
        document.set_binary_blob(bytes(self._binary))
        return b"".join(bytes(part) for part in document.save_to_bytes())

    def _view(self, data: bytes, target: int | None = None) -> int:
        self._binary.extend(b"\0" * (-len(self._binary) % 4))
        self._document.bufferViews.append(
            pygltflib.BufferView(buffer=0, byteOffset=len(self._binary), byteLength=len(data), target=target)
        )
        self._binary.extend(data)
        return len(self._document.bufferViews) - 1

    def _write_textures(self) -> None:
        for name, texture in self._scene.textures.items():
            view = self._view(encode_png(texture.image))
            self._document.images.append(pygltflib.Image(name=name, bufferView=view, mimeType="image/png"))
            self._document.textures.append(pygltflib.Texture(name=name, source=len(self._document.images) - 1))

    def _write_nodes(self) -> list[int]:
        roots: list[int] = []
        indices: dict[str, int] = {}
        for path, node in self._scene.nodes.items():
            marks = {"movable": True} if node.movable else {}
            if not node.visible:
                marks["visible"] = False
            indices[path] = self._node(
                pygltflib.Node(
                    name=node.name,
                    mesh=self._mesh(node.meshes),
                    matrix=_columns(transform_to_y_up(node.transform)),
                    extras={EXTRAS_KEY: marks} if marks else {},
                    extensions={} if node.light is None else {LIGHTS: {"light": self._light(node.light)}},
                )
            )
            if node.parent in indices:
                self._document.nodes[indices[node.parent]].children.append(indices[path])
            else:
                roots.append(indices[path])
        return roots

    def _light(self, light: Light) -> int:
        """Return the index of a lamp in the file's list of lights. Equal lamps share an entry."""
        if light not in self._lights:
            self._lights.append(light)
        return self._lights.index(light) + 1  # the sun comes first

    def _node(self, node: pygltflib.Node) -> int:
        self._document.nodes.append(node)
        return len(self._document.nodes) - 1

    def _mesh(self, meshes: tuple[Mesh, ...]) -> int | None:
        if not meshes:
            return None
        key = tuple(id(mesh) for mesh in meshes)
        if key not in self._meshes:
            self._document.meshes.append(pygltflib.Mesh(primitives=[self._primitive(mesh) for mesh in meshes]))
            self._meshes[key] = len(self._document.meshes) - 1
        return self._meshes[key]

    def _primitive(self, mesh: Mesh) -> pygltflib.Primitive:
        return pygltflib.Primitive(
            attributes=pygltflib.Attributes(
                POSITION=self._accessor(mesh.positions, "VEC3", is_spatial=True),
                NORMAL=self._accessor(mesh.normals, "VEC3", is_spatial=True),
                TEXCOORD_0=self._accessor(mesh.uvs, "VEC2"),
            ),
            indices=self._accessor(mesh.faces, "SCALAR"),
            material=self._materials[mesh.material],
        )

    def _accessor(self, array: NDArray[Any], kind: str, *, is_spatial: bool = False) -> int:
        key = (id(array), kind)  # an array that meshes share is written once
        if key not in self._arrays:
            values = vectors_to_y_up(array) if is_spatial else array.reshape(-1) if kind == "SCALAR" else array
            is_index = values.dtype == np.uint32
            view = self._view(
                np.ascontiguousarray(values).tobytes(),
                pygltflib.ELEMENT_ARRAY_BUFFER if is_index else pygltflib.ARRAY_BUFFER,
            )
            accessor = pygltflib.Accessor(
                bufferView=view,
                componentType=pygltflib.UNSIGNED_INT if is_index else pygltflib.FLOAT,
                count=len(values),
                type=kind,
            )
            if kind == "VEC3" and len(values):
                accessor.min = [float(v) for v in values.min(axis=0)]
                accessor.max = [float(v) for v in values.max(axis=0)]
            self._document.accessors.append(accessor)
            self._arrays[key] = len(self._document.accessors) - 1
        return self._arrays[key]

    def _write_cameras(self) -> list[int]:
        nodes = []
        for camera in self._scene.cameras.values():
            self._document.cameras.append(_camera(camera))
            nodes.append(
                self._node(
                    pygltflib.Node(
                        name=camera.name,
                        camera=len(self._document.cameras) - 1,
                        matrix=_columns(view_to_y_up(camera.transform)),
                    )
                )
            )
        return nodes

    def _write_sun(self) -> int:
        sun = self._scene.sun
        light = {
            "type": "directional",
            "name": SUN_PATH.rpartition(".")[2],
            "intensity": 100_000.0 * sun.irradiance,
            "extras": {EXTRAS_KEY: asdict(sun)},
        }
        self._document.extensions = {LIGHTS: {"lights": [light, *map(write_light, self._lights)]}}
        return self._node(
            pygltflib.Node(
                name=SUN_PATH.rpartition(".")[2],
                matrix=_columns(view_to_y_up(_looking_from(self._scene.sun_direction()))),
                extensions={LIGHTS: {"light": 0}},
            )
        )


def _camera(camera: Camera) -> pygltflib.Camera:
    height = camera.sensor_width_mm / _ASPECT_RATIO
    return pygltflib.Camera(
        name=camera.name,
        type="perspective",
        perspective=pygltflib.Perspective(
            aspectRatio=_ASPECT_RATIO,
            yfov=2.0 * math.atan(0.5 * height / camera.focal_length_mm),
            znear=camera.near,
            zfar=camera.far,
        ),
        extras={
            EXTRAS_KEY: {"focal_length_mm": camera.focal_length_mm, "sensor_width_mm": camera.sensor_width_mm},
        },
    )


def _looking_from(direction: NDArray[np.float64]) -> Matrix:
    """Return the (4, 4) transform of a light whose −z points away from ``direction`` (unit, towards the sun)."""
    aside = np.array([-direction[1], direction[0], 0.0])
    if np.linalg.norm(aside) < 1e-9:
        aside = np.array([1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = aside, np.cross(direction, aside), direction
    return matrix


def _columns(matrix: Matrix) -> list[float]:
    """Return the 16 numbers of a matrix by columns, as glTF stores them."""
    return [float(value) for value in matrix.T.reshape(-1)]
