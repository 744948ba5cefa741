"""Assemble one labelled scene from glTF files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from valerie.errors import InvalidInput
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.objects import classified
from valerie.scene.assets.placements import PlacedFile
from valerie.scene.gltf.common import FilePart
from valerie.scene.gltf.reader import read_gltf
from valerie.scene.graph.model import Camera, Environment, Light, Material, Mesh, Node, Scene, Sun, Texture
from valerie.scene.graph.naming import ROOT

#: The sun of a file without one: a late morning.
DEFAULT_SUN = Sun(azimuth=math.radians(150.0), elevation=math.radians(40.0))


def load_gltf(path: Path, *, node_classes: Mapping[str, str] | None = None) -> Scene:
    """Read one file as a scene.

    Args:
        path: a .glb or .gltf.
        node_classes: class by path, for nodes whose names state none.

    Raises:
        InvalidInput: see `read_gltf`; or two nodes have the same path or instance id.
    """
    part = read_gltf(path)
    return _scene([(path.name, part)], node_classes or {}, part.movable)


def merge(parts: Mapping[str, FilePart], manifest: Manifest) -> Scene:
    """Join several files into one scene, with the labels of the manifest.

    Nodes and cameras must differ by path. With several files, materials and textures get the name of their file as a prefix,
    and materials of a placed file the name of its node, so that each can vary on its own. The first sun and the manifest's
    bearing apply. Cameras and suns of placed files are left out, since they belong to the model. Nodes that the manifest names
    but no file has are skipped; `require_declared` lists them.

    Args:
        parts: file name to content.

    Raises:
        InvalidInput: two files have the same node or camera.
    """
    prefixes = _prefixes(tuple(parts))
    contents = [(name, _prefixed(parts[name], prefixes[name], prefixes[name])) for name in manifest.files]
    for entry in manifest.placed_files:
        part = _prefixed(parts[entry.file], entry.node, prefixes[entry.file] or Path(entry.file).stem)
        contents.append((entry.file, _placed(part, entry)))
    paths = {node.path for _, part in contents for node in part.nodes}
    node_classes = {path: kind for path, kind in manifest.node_classes.items() if path in paths}
    scene = _scene(contents, node_classes, [path for path in manifest.movable if path in paths])
    cameras = dict(scene.cameras)
    for camera in manifest.placed_cameras:
        if camera.name in cameras:
            raise InvalidInput("a file already has a camera with this name", field="placed_cameras", value=camera.name)
        cameras[camera.name] = camera.camera()
    environment = replace(scene.environment, bearing=math.radians(manifest.bearing_deg))
    return replace(scene, cameras=cameras, environment=environment)


def _scene(parts: Sequence[tuple[str, FilePart]], node_classes: Mapping[str, str], movable: Sequence[str]) -> Scene:
    nodes: list[Node] = []
    materials: dict[str, Material] = {}
    textures: dict[str, Texture] = {}
    cameras: dict[str, Camera] = {}
    for file, part in parts:
        nodes += part.nodes
        materials.update(part.materials)
        textures.update(part.textures)
        repeated = cameras.keys() & part.cameras.keys()
        if repeated:
            raise InvalidInput("two cameras have the same name", field=file, value=min(repeated))
        cameras.update(part.cameras)
    return Scene(
        nodes=classified(nodes, node_classes, movable),
        materials=materials,
        textures=textures,
        cameras=cameras,
        sun=next((part.sun for _, part in parts if part.sun), DEFAULT_SUN),
        environment=next((part.environment for _, part in parts if part.environment), Environment()),
    )


def _placed(part: FilePart, entry: PlacedFile) -> FilePart:
    """Return the content of a file below the node that the manifest names."""
    model = entry.model_transform()
    below = [
        replace(
            node,
            path=f"{entry.path}{node.path.removeprefix(ROOT)}",
            transform=model @ node.transform if node.parent == ROOT else node.transform,
        )
        for node in part.nodes
    ]
    nodes = (Node(entry.path, entry.node_transform()), *below)
    return replace(part, nodes=nodes, cameras={}, sun=None, environment=None, movable=())


def _prefixes(files: Sequence[str]) -> dict[str, str]:
    """Return a prefix for the materials of each file: "" for a single file, else the stem if unique, else the whole name."""
    if len(files) == 1:
        return {files[0]: ""}
    stems = [Path(file).stem for file in files]
    return {file: stem if stems.count(stem) == 1 else file for file, stem in zip(files, stems, strict=True)}


def _prefixed(part: FilePart, for_materials: str, for_textures: str) -> FilePart:
    """Return the content with materials and textures named ``prefix/name``. Shared meshes stay shared."""
    if not for_materials:
        return part

    def textured(name: str) -> str:
        return f"{for_textures}/{name}"

    meshes: dict[int, Mesh] = {}

    def mesh(original: Mesh) -> Mesh:
        return meshes.setdefault(id(original), replace(original, material=f"{for_materials}/{original.material}"))

    def light(original: Light | None) -> Light | None:
        if original is None:
            return None
        return replace(original, glowing=tuple(f"{for_materials}/{name}" for name in original.glowing))

    return replace(
        part,
        nodes=tuple(
            replace(node, meshes=tuple(mesh(m) for m in node.meshes), light=light(node.light)) for node in part.nodes
        ),
        materials={
            f"{for_materials}/{name}": replace(material.with_textures(textured), name=f"{for_materials}/{name}")
            for name, material in part.materials.items()
        },
        textures={textured(name): replace(texture, name=textured(name)) for name, texture in part.textures.items()},
    )
