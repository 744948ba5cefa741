"""Read one glTF file: nodes, meshes, materials, cameras and light."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pygltflib

from valerie.errors import InvalidInput
from valerie.plain import JsonObject
from valerie.scene.gltf.common import (
    LIGHTS,
    MAX_DEPTH,
    SUPPORTED_EXTENSIONS,
    FilePart,
    number,
    own_extras,
    transform_from_y_up,
    vectors_from_y_up,
    view_from_y_up,
)
from valerie.scene.gltf.container import Container, item, open_container
from valerie.scene.gltf.lights import read_light
from valerie.scene.gltf.meshes import MeshReader
from valerie.scene.gltf.textures import TextureReader
from valerie.scene.graph.model import POSITIONS, Camera, Environment, Matrix, Mesh, Node, Sun
from valerie.scene.graph.naming import ROOT, node_name

#: Largest number of names in a note.
_FIRST = 5


def read_gltf(path: Path, root: Path | None = None) -> FilePart:
    """Read a .glb or .gltf with the buffers and images that it refers to.

    Args:
        root: folder that no reference may lead out of; by default the file's own.

    Raises:
        InvalidInput: the file is broken, truncated or too large, refers to files that are missing or outside ``root``, or uses
            features that are not supported.
    """
    container = open_container(path, root)
    try:
        return _Reader(container).read()
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError) as error:
        # The JSON is well-formed, but a value has the wrong type for glTF.
        raise InvalidInput(f"not valid glTF: {error}", field=container.name) from error


class _Reader:
    def __init__(self, container: Container) -> None:
        self._container, self._document = container, container.document
        self._notes = _unread(container.document)
        self._textures = TextureReader(container)
        self._meshes = MeshReader(container, self._textures, self._notes)
        self._paths: dict[int, str] = {}
        self._worlds: dict[int, Matrix] = {}
        self._unnamed: list[str] = []
        self._renamed: list[str] = []
        self._flat: dict[str, list[str]] = {}

    def read(self) -> FilePart:
        document = self._document
        if document.animations:
            self._notes.append("animations are ignored")
        if document.skins:
            self._notes.append("skins are ignored: bodies stay as modelled")
        nodes: list[Node] = []
        cameras: dict[str, Camera] = {}
        movable: list[str] = []
        sun: Sun | None = None
        environment = self._environment()
        for index in self._ordered():
            node = document.nodes[index]
            path, local = self._paths[index], _local_matrix(node, f"{self._container.name}: nodes.{index}")
            light = self._light(node)
            if node.camera is not None:
                camera = self._camera(node, path, self._worlds[index])
                if camera is not None:
                    cameras[camera.name] = camera
            is_sun = light is not None and light.get("type") == "directional"
            if light is not None and is_sun and sun is None:
                sun = self._sun(light, self._worlds[index], environment or Environment())
            if node.mesh is None and not node.children and (node.camera is not None or is_sun):
                continue
            marks = own_extras(node.extras)
            if marks.get("movable"):
                movable.append(path)
            nodes.append(
                Node(
                    path,
                    transform_from_y_up(local),
                    () if node.mesh is None else self._mesh(node.mesh, path),
                    visible=bool(marks.get("visible", True)),
                    light=None if light is None or is_sun else read_light(light, path),
                )
            )
        materials = self._meshes.all_materials()
        self._note_lists()
        return FilePart(
            nodes=tuple(nodes),
            materials=materials,
            textures=self._textures.all_textures(),
            cameras=cameras,
            sun=sun,
            environment=environment,
            movable=tuple(movable),
            notes=tuple(dict.fromkeys(self._notes)),
        )

    def _ordered(self) -> Iterator[int]:
        """Yield the nodes of the scene in the file's order, parents first, and set their paths and world matrices."""
        parents = self._parents()
        for start in range(len(self._document.nodes)):
            chain = []
            at: int | None = start
            while at is not None and at not in self._paths:
                chain.append(at)
                if len(chain) > MAX_DEPTH:
                    raise InvalidInput(
                        "the node tree is too deep or has a cycle", field=f"{self._container.name}: nodes.{start}",
                        limit=MAX_DEPTH,
                    )  # fmt: skip
                if at not in parents:
                    chain.clear()  # the node belongs to no scene
                    break
                at = parents[at]
            for index in reversed(chain):
                self._place(index, parents[index])
                yield index

    def _scene(self) -> pygltflib.Scene | None:
        """Return the scene that the file shows; None if it has none and shows all its nodes."""
        document = self._document
        return (
            item(document.scenes, document.scene or 0, f"{self._container.name}: scenes") if document.scenes else None
        )

    def _parents(self) -> dict[int, int | None]:
        """Return the parent of every child node, and None for the roots of the scene."""
        document = self._document
        parents: dict[int, int | None] = {}
        for index, node in enumerate(document.nodes):
            for child in node.children or ():
                if not 0 <= child < len(document.nodes) or child in parents:
                    raise InvalidInput(
                        "the child is missing or has two parents",
                        field=f"{self._container.name}: nodes.{index}",
                        value=child,
                    )
                parents[child] = index
        scene = self._scene()
        if scene is not None:
            roots = scene.nodes or []
        else:
            roots = [index for index in range(len(document.nodes)) if index not in parents]
        for root in roots:
            if not 0 <= root < len(document.nodes) or root in parents:
                raise InvalidInput("not a root node", field=f"{self._container.name}: scenes", value=root)
            parents[root] = None
        return parents

    def _place(self, index: int, parent: int | None) -> None:
        node = self._document.nodes[index]
        name = node_name(node.name, index)
        if not node.name:
            self._unnamed.append(name)
        elif name != node.name:
            self._renamed.append(f"{node.name!r} → {name}")
        local = _local_matrix(node, f"{self._container.name}: nodes.{index}")
        self._paths[index] = f"{ROOT if parent is None else self._paths[parent]}.{name}"
        self._worlds[index] = local if parent is None else self._worlds[parent] @ local

    def _note_lists(self) -> None:
        if self._unnamed:
            self._notes.append(f"nodes without a name are named {_listed(self._unnamed)}")
        if self._renamed:
            self._notes.append(f"nodes are renamed to names that are valid in paths: {_listed(self._renamed)}")
        for reason, nodes in self._flat.items():
            self._notes.append(f"{reason} are computed per face, which looks faceted: {_listed(nodes)}")

    def _mesh(self, index: int, path: str) -> tuple[Mesh, ...]:
        meshes = self._meshes.read(index)
        for reason in self._meshes.computed_normals.get(index, ()):
            self._flat.setdefault(reason, []).append(path.removeprefix(f"{ROOT}."))
        return meshes

    def _camera(self, node: pygltflib.Node, path: str, world: Matrix) -> Camera | None:
        camera = item(self._document.cameras, node.camera, f"{self._container.name}: cameras")
        if camera.perspective is None:
            self._notes.append(f"camera {path} is ignored: only perspective cameras are supported, it is {camera.type}")
            return None
        own = own_extras(camera.extras)
        sensor = number(own.get("sensor_width_mm", 36.0), path)
        lens = camera.perspective
        half_height = math.tan(0.5 * float(lens.yfov))
        focal = number(
            own.get("focal_length_mm", 0.5 * sensor / (half_height * float(lens.aspectRatio or 16 / 9))), path
        )
        if not (math.isfinite(focal) and focal > 0):
            raise InvalidInput("not a valid angle of view", field=path, value=lens.yfov)
        near, far = float(lens.znear), float(lens.zfar or 600.0)
        if not 0 < near < far:
            planes = f"znear {near:g}, zfar {far:g}"
            raise InvalidInput(
                "no space between the clipping planes", field=path, value=planes, limit="0 < znear < zfar"
            )
        name = path.rpartition(".")[2]
        # Here a camera belongs to the scene itself. Its matrix includes those of its ancestors in the file.
        return Camera(f"{ROOT}.{name}", view_from_y_up(world), focal, sensor, near, far)

    def _light(self, node: pygltflib.Node) -> JsonObject | None:
        index = ((node.extensions or {}).get(LIGHTS) or {}).get("light")
        if index is None:
            return None
        lights = (self._document.extensions.get(LIGHTS) or {}).get("lights") or []
        return dict(item(lights, index, f"{self._container.name}: {LIGHTS}.lights"))

    def _sun(self, light: JsonObject, world: Matrix, environment: Environment) -> Sun:
        own = own_extras(light.get("extras"))
        if own:
            return Sun(**{name: number(value, f"{self._container.name}: sun.{name}") for name, value in own.items()})
        backwards = vectors_from_y_up(world[:3, 2] / np.linalg.norm(world[:3, 2]))
        azimuth = math.atan2(float(backwards[0]), float(backwards[1])) + environment.bearing
        self._notes.append("the sun has the strength of a clear noon, since the file's unit is not comparable")
        return Sun(azimuth % (2.0 * math.pi), math.asin(max(-1.0, min(1.0, float(backwards[2])))))

    def _environment(self) -> Environment | None:
        scene = self._scene()
        own = None if scene is None else own_extras(scene.extras).get("environment")
        if not isinstance(own, dict):
            return None
        lamps = {name: own[name] for name in ("street_lamps", "car_lamps")}
        for name, position in lamps.items():
            if position not in POSITIONS:
                field = f"{self._container.name}: environment.{name}"
                raise InvalidInput(
                    "unknown position of a switch", field=field, value=position, limit=", ".join(POSITIONS)
                )
        place = f"{self._container.name}: environment"
        numbers = {name: number(value, f"{place}.{name}") for name, value in own.items() if name not in lamps}
        return Environment(street_lamps=str(lamps["street_lamps"]), car_lamps=str(lamps["car_lamps"]), **numbers)


def _unread(document: pygltflib.GLTF2) -> list[str]:
    """Return a note on the extensions that are not supported, if there are any."""
    extensions = sorted({str(name) for name in document.extensionsUsed or ()} - SUPPORTED_EXTENSIONS)
    return [f"extensions are ignored: {_listed(extensions)}"] if extensions else []


def _listed(names: list[str]) -> str:
    more = len(names) - _FIRST
    return ", ".join(names[:_FIRST]) + (f" and {more} more" if more > 0 else "")


def _local_matrix(node: pygltflib.Node, field: str) -> Matrix:
    """Return the (4, 4) transform, node to parent, y up, from a matrix or translation, rotation, scale (glTF 2.0, 3.5.3)."""
    if node.matrix:
        matrix = np.array(node.matrix, np.float64).reshape(4, 4).T
    else:
        matrix = np.eye(4)
        x, y, z, w = (float(v) for v in node.rotation or (0.0, 0.0, 0.0, 1.0))
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        matrix[:3, :3] *= np.array(node.scale or (1.0, 1.0, 1.0), np.float64)
        matrix[:3, 3] = node.translation or (0.0, 0.0, 0.0)
    if not np.isfinite(matrix).all() or matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise InvalidInput("not a valid transform", field=field)
    return matrix
