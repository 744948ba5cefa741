"""Checks of shapes: sizes that hint at a wrong unit, origins off the ground, too many triangles, textures without coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import BY_ID
from valerie.scene.assets.manifest import Manifest
from valerie.scene.checks.doubts import Doubt, Severity
from valerie.scene.graph.model import Mesh, Node, Scene

#: Largest number of triangles of one object and of the whole scene. More slow every engine down without visible gain.
MAX_TRIANGLES: Final = 1_000_000
#: Number of objects that the finding on a heavy scene names.
_HEAVIEST: Final = 3
#: Usual heights of objects by class. Other heights hint at a wrong unit (centimetres, inches).
HEIGHTS_M: Final[Mapping[str, tuple[float, float]]] = {
    "person": (0.4, 2.6),
    "rider": (0.4, 2.6),
    "car": (0.8, 3.5),
    "truck": (1.2, 5.0),
    "bus": (1.8, 5.0),
    "motorcycle": (0.6, 2.6),
    "bicycle": (0.5, 2.6),
}
#: Classes of ground that people and cars stand on.
GROUND_CLASSES: Final = frozenset({"road", "sidewalk", "parking", "terrain", "ground", "rail-track", "bridge"})
#: Largest distance of the top of the ground from the places of persons, metres.
_GROUND_M: Final = 1.0
#: Largest distance of a person's lowest point from its origin, metres.
_FEET_M: Final = 0.15
#: Largest distance of a person's middle from its origin over the ground, metres.
_ASIDE_M: Final = 0.5


def shape_findings(scene: Scene, manifest: Manifest) -> Iterator[Doubt]:
    """Yield findings on the geometry of a scene with every parameter at its default."""
    for path, node in scene.nodes.items():
        if node.visible:
            for mesh in node.meshes:
                yield from _mesh_findings(path, mesh, scene)
        determinant = float(np.linalg.det(node.transform[:3, :3]))
        if abs(determinant) < 1e-12:
            yield Doubt(
                Severity.WARNING,
                "flat",
                path,
                "scaled to zero in one direction: nothing below it has a volume",
                f"determinant {determinant:.3g}",
                "not 0",
            )
    yield from _triangles(scene)
    boxes = object_boxes(scene)
    yield from _sizes(scene, boxes)
    yield from _origins(scene, manifest, boxes)
    yield from _extent(manifest, boxes)
    yield from _ground(scene, manifest, boxes)


def object_boxes(scene: Scene, *, labelled: bool = True) -> dict[str, NDArray[np.float64]]:
    """Return the path of each visible object and its box in the world: (2, 3) metres, lowest and highest corner.

    The path is that of the topmost node of the instance, or of the class for classes without instances.

    Args:
        labelled: True for objects with a class, False for those without.
    """
    boxes: dict[str, NDArray[np.float64]] = {}
    for path, node in scene.nodes.items():
        if not node.visible or bool(node.label_id) is not labelled or not node.meshes:
            continue
        owner, world = object_of(scene, node), scene.world_transform(path)
        for mesh in node.meshes:
            if not len(mesh.positions):
                continue
            points = world_points(mesh, world)
            low, high = points.min(axis=0), points.max(axis=0)
            box = boxes.get(owner)
            boxes[owner] = np.stack([low, high] if box is None else [np.minimum(low, box[0]), np.maximum(high, box[1])])
    return boxes


def object_of(scene: Scene, node: Node) -> str:
    """Return the path of the topmost node of the same object."""
    owner = node
    while True:
        parent = scene.nodes.get(owner.parent)
        if parent is None or (parent.label_id, parent.instance_id) != (node.label_id, node.instance_id):
            return owner.path
        owner = parent


def world_points(mesh: Mesh, world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positions of a mesh in the world: (V, 3) metres."""
    points: NDArray[np.float64] = mesh.positions.astype(np.float64) @ world[:3, :3].T + world[:3, 3]
    return points


def _triangles(scene: Scene) -> Iterator[Doubt]:
    """Yield findings on objects with too many triangles, and on the scene if the others together have too many."""
    triangles: dict[str, int] = {}
    for node in scene.nodes.values():
        if node.visible and node.meshes:
            owner = object_of(scene, node)
            triangles[owner] = triangles.get(owner, 0) + sum(len(mesh.faces) for mesh in node.meshes)
    huge = {owner: count for owner, count in triangles.items() if count > MAX_TRIANGLES}
    for owner, count in huge.items():
        yield Doubt(
            Severity.WARNING,
            "huge-mesh",
            owner,
            "too many triangles slow every engine down: simplify it",
            f"{count:,} triangles",
            f"{MAX_TRIANGLES:,}",
        )
    rest = {owner: count for owner, count in triangles.items() if owner not in huge}
    if sum(rest.values()) > MAX_TRIANGLES:
        heaviest = sorted(rest, key=lambda owner: -rest[owner])[:_HEAVIEST]
        yield Doubt(
            Severity.WARNING,
            "huge-scene",
            "",
            f"too many triangles in the whole scene slow every engine down; most are in {', '.join(heaviest)}",
            f"{sum(triangles.values()):,} triangles",
            f"{MAX_TRIANGLES:,}",
        )


def _mesh_findings(path: str, mesh: Mesh, scene: Scene) -> Iterator[Doubt]:
    material = scene.materials.get(mesh.material)
    if material is None or not len(mesh.uvs):
        return
    texture = next(iter(material.textures), None)
    if texture is not None and not np.ptp(mesh.uvs, axis=0).any():
        yield Doubt(
            Severity.WARNING,
            "no-texture-coordinates",
            path,
            f"material {mesh.material} has the texture {texture}, but the mesh has no texture coordinates: it gets one colour",
        )


def _sizes(scene: Scene, boxes: Mapping[str, NDArray[np.float64]]) -> Iterator[Doubt]:
    for owner, box in boxes.items():
        kind = BY_ID[scene.nodes[owner].label_id].node_class
        height = float(box[1, 2] - box[0, 2])
        smallest, largest = HEIGHTS_M.get(kind, (0.0, np.inf))
        if not smallest <= height <= largest:
            yield Doubt(
                Severity.WARNING,
                "size",
                owner,
                f"not the height of a {kind}: is the unit the metre? placed_files can scale",
                f"{height:.3g} m",
                f"{smallest:g}…{largest:g} m",
            )


def _origins(scene: Scene, manifest: Manifest, boxes: Mapping[str, NDArray[np.float64]]) -> Iterator[Doubt]:
    for path in manifest.persons:
        box = boxes.get(path)
        if box is None:
            continue
        origin = scene.world_transform(path)[:3, 3]
        below = float(box[0, 2] - origin[2])
        aside = float(np.linalg.norm(box.mean(axis=0)[:2] - origin[:2]))
        if abs(below) > _FEET_M:
            yield Doubt(
                Severity.WARNING,
                "origin",
                path,
                "its origin belongs on the ground between the feet: it stands in or above the ground",
                f"lowest point at {below:+.2f} m",
                f"±{_FEET_M} m",
            )
        if aside > _ASIDE_M:
            yield Doubt(
                Severity.WARNING,
                "origin",
                path,
                "its origin belongs below its middle: it turns about the origin, and distances are measured to it",
                f"{aside:.2f} m aside",
                f"{_ASIDE_M} m",
            )


def _extent(manifest: Manifest, boxes: Mapping[str, NDArray[np.float64]]) -> Iterator[Doubt]:
    if not boxes:
        return
    corners = np.stack(list(boxes.values()))
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    x0, y0, x1, y1 = manifest.extent
    if high[0] < x0 or low[0] > x1 or high[1] < y0 or low[1] > y1:
        yield Doubt(
            Severity.WARNING,
            "extent",
            "extent",
            "the whole scene is outside it: is the unit the metre?",
            f"scene from ({low[0]:.3g}, {low[1]:.3g}) to ({high[0]:.3g}, {high[1]:.3g}) m",
            f"({x0:g}, {y0:g}) to ({x1:g}, {y1:g}) m",
        )


def _ground(scene: Scene, manifest: Manifest, boxes: Mapping[str, NDArray[np.float64]]) -> Iterator[Doubt]:
    x0, y0, x1, y1 = manifest.extent
    lowest = min([0.0, *(region.height for region in manifest.ground)])
    for owner, (low, high) in boxes.items():
        if BY_ID[scene.nodes[owner].label_id].node_class not in GROUND_CLASSES:
            continue
        below = low[0] <= x1 and high[0] >= x0 and low[1] <= y1 and high[1] >= y0
        if below and low[2] <= lowest + _GROUND_M and high[2] >= lowest - _GROUND_M:
            return
    yield Doubt(
        Severity.WARNING,
        "no-ground",
        "extent",
        f"nothing to stand on: there is no {', '.join(sorted(GROUND_CLASSES))} below it",
        limit=f"z within {_GROUND_M:g} m of {lowest:g} m",
    )
