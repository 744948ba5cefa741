"""What is wrong or suspicious with a user's asset, all at once, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np
import shapely

from valerie.errors import InvalidInput, InvalidInputs, ValerieError
from valerie.labels import BY_ID, PERSON
from valerie.scene.asset import SceneAsset
from valerie.scene.asset_files import read_manifest
from valerie.scene.legality import rejection_reason
from valerie.scene.manifest import Manifest
from valerie.scene.model import Scene
from valerie.scene.naming import object_label, parse_object_name
from valerie.scene.objects import require_declared, unclassified
from valerie.scene.variation import apply

#: A mesh above this slows every engine down without being seen.
HUGE_TRIANGLES: Final = 500_000
#: Objects of these classes have about this size; others hint at a wrong unit (centimetres, inches).
_HEIGHTS_M: Final = {"person": (0.4, 2.6), "car": (0.8, 3.5)}


def asset_problems(folder: Path) -> list[str]:
    """Check a user's asset; an empty list means that nothing was found.

    Args:
        folder: with ``manifest.yaml`` and the files that it lists.

    Returns:
        One sentence per problem: unnamed nodes, unknown classes, no person, missing normals, huge meshes, what the
        manifest declares and the scene lacks, features of the files that are ignored.
    """
    from valerie.scene.gltf import FilePart, merge, read_gltf

    problems: list[str] = []
    try:
        manifest, asset_digest, files = read_manifest(folder)
    except InvalidInputs as error:
        return [str(problem) for problem in error.problems]
    except InvalidInput as error:
        return [str(error)]
    parts: dict[str, FilePart] = {}
    for name, path in files.items():
        try:
            parts[name] = read_gltf(path)
            problems += [f"{name}: {note}" for note in parts[name].notes]
        except InvalidInput as error:
            problems.append(str(error))
    if len(parts) < len(files):
        return problems
    try:
        scene = merge(parts, manifest)
    except InvalidInput as error:
        return [*problems, str(error)]
    return [*problems, *_scene_problems(scene, manifest), *_declared_problems(scene, manifest, asset_digest)]


def _scene_problems(scene: Scene, manifest: Manifest) -> Iterator[str]:
    if not any(node.label_id == PERSON.id and node.meshes for node in scene.nodes.values()):
        yield "no person: no node called person-1 (or made one by node_classes) has a mesh"
    elif not manifest.persons:
        yield "the manifest names no persons: nobody is under test"
    if not scene.cameras:
        yield "no camera"
    for path in unclassified(scene):
        parsed = parse_object_name(path.rpartition(".")[2])
        if parsed is not None and object_label(path.rpartition(".")[2]) is None:
            yield f"{path}: {parsed[0]!r} is no known class"
        else:
            yield f"{path} has no class: name it ObjectClass-ID or list it in node_classes"
    for path, node in scene.nodes.items():
        for mesh in node.meshes:
            if len(mesh.faces) > HUGE_TRIANGLES:
                yield f"{path}: a mesh of {len(mesh.faces)} triangles (more than {HUGE_TRIANGLES})"
        if np.linalg.det(node.transform[:3, :3]) <= 0.0:
            yield f"{path} is mirrored or flat: its surfaces face inwards"
    yield from _sizes(scene)


def _sizes(scene: Scene) -> Iterator[str]:
    """Persons and cars whose height is not that of one: the unit is probably not the metre."""
    heights: dict[str, tuple[float, float]] = {}
    for path in scene.nodes:
        owner = _owner(scene, path)
        if owner is None:
            continue
        world = scene.world_transform(path)
        for mesh in scene.nodes[path].meshes:
            z = mesh.positions.astype(np.float64) @ world[2, :3] + world[2, 3]
            low, high = heights.get(owner, (np.inf, -np.inf))
            heights[owner] = (min(low, float(z.min())), max(high, float(z.max())))
    for owner, (low, high) in heights.items():
        object_class = _class_of(scene, owner)
        smallest, largest = _HEIGHTS_M[object_class]
        if not smallest <= high - low <= largest:
            yield f"{owner} is {high - low:.3g} m high, unlike a {object_class}: is the unit the metre?"


def _class_of(scene: Scene, path: str) -> str:
    return BY_ID[scene.nodes[path].label_id].node_class


def _owner(scene: Scene, path: str) -> str | None:
    """The object (person or car) that a node is a part of."""
    if _class_of(scene, path) not in _HEIGHTS_M:
        return None
    owner = path
    label = scene.nodes[path].label_id
    while (parent := scene.nodes[owner].parent) in scene.nodes and scene.nodes[parent].label_id == label:
        owner = parent
    return owner


def _declared_problems(scene: Scene, manifest: Manifest, asset_digest: str) -> Iterator[str]:
    try:
        require_declared(scene, manifest)
        apply({}, SceneAsset(manifest, asset_digest, scene))
    except ValerieError as error:
        yield str(error)
    everywhere: Mapping[str, float] = {
        f"scene.{camera}.pos.{axis}": float(value)
        for camera in manifest.cameras
        if camera in scene.cameras
        for axis, value in zip("xyz", scene.cameras[camera].position, strict=True)
        if f"scene.{camera}.pos.{axis}" in manifest.by_path
    }
    for obstacle in manifest.obstacles:
        if not shapely.Polygon(obstacle.polygon).is_valid:
            yield f"the footprint of {obstacle.path} crosses itself"
    reason = rejection_reason(everywhere, manifest)
    if reason:
        yield f"with every parameter at its default, {reason}"
