"""Files to one labelled scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from valerie.errors import InvalidInput
from valerie.scene.gltf.common import FilePart
from valerie.scene.gltf.reader import read_gltf
from valerie.scene.manifest import Manifest
from valerie.scene.model import Camera, Environment, Material, Mesh, Node, Scene, Sun, Texture
from valerie.scene.objects import classified

#: Where a file has no sun: a late morning.
DEFAULT_SUN = Sun(azimuth=math.radians(150.0), elevation=math.radians(40.0))


def load_gltf(
    path: Path, *, node_classes: Mapping[str, str] | None = None, movable: Sequence[str] | None = None
) -> Scene:
    """Read one file as a scene.

    Args:
        path: a .glb or a self-contained .gltf.
        node_classes: class by path, for nodes whose names do not tell.
        movable: paths that move; None takes what the file itself marks.

    Raises:
        InvalidInput: see `read_gltf`; or two nodes of one path or instance id.
    """
    part = read_gltf(path)
    return _scene({path.name: part}, node_classes or {}, part.movable if movable is None else movable, None)


def merge(parts: Mapping[str, FilePart], manifest: Manifest) -> Scene:
    """Several files as one scene, labelled as the manifest says.

    Nodes and cameras must differ by path. Where there are several files, materials and textures get their file's name
    as a prefix. The first sun wins; the street's bearing is the manifest's.

    Args:
        parts: file name to content.
        manifest: of the asset.

    Raises:
        InvalidInput: two files bring the same node or camera.
    """
    return _scene(parts, manifest.node_classes, manifest.movable, math.radians(manifest.bearing_deg))


def _scene(
    parts: Mapping[str, FilePart], node_classes: Mapping[str, str], movable: Sequence[str], bearing: float | None
) -> Scene:
    nodes: list[Node] = []
    materials: dict[str, Material] = {}
    textures: dict[str, Texture] = {}
    cameras: dict[str, Camera] = {}
    for file, part in parts.items():
        prefixed = _prefixed(part, Path(file).stem) if len(parts) > 1 else part
        nodes += prefixed.nodes
        materials.update(prefixed.materials)
        textures.update(prefixed.textures)
        twice = cameras.keys() & prefixed.cameras.keys()
        if twice:
            raise InvalidInput("two cameras of one name", field=file, value=min(twice))
        cameras.update(prefixed.cameras)
    environment = next((part.environment for part in parts.values() if part.environment), Environment())
    return Scene(
        nodes=classified(nodes, node_classes, movable),
        materials=materials,
        textures=textures,
        cameras=cameras,
        sun=next((part.sun for part in parts.values() if part.sun), DEFAULT_SUN),
        environment=environment if bearing is None else replace(environment, bearing=bearing),
    )


def _prefixed(part: FilePart, stem: str) -> FilePart:
    """The same content with materials and textures called ``stem/name``; shared meshes stay shared."""

    def own(name: str | None) -> str | None:
        return None if name is None else f"{stem}/{name}"

    meshes: dict[int, Mesh] = {}

    def mesh(given: Mesh) -> Mesh:
        return meshes.setdefault(id(given), replace(given, material=f"{stem}/{given.material}"))

    return replace(
        part,
        nodes=tuple(replace(node, meshes=tuple(mesh(m) for m in node.meshes)) for node in part.nodes),
        materials={
            f"{stem}/{name}": replace(
                material,
                name=f"{stem}/{name}",
                base_color_texture=own(material.base_color_texture),
                normal_texture=own(material.normal_texture),
            )
            for name, material in part.materials.items()
        },
        textures={f"{stem}/{name}": Texture(f"{stem}/{name}", t.image) for name, t in part.textures.items()},
    )
