"""Queries of a scene for engines: visible nodes in the world (statics or movables), lights, cameras, materials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput, RenderingError, UnknownName
from valerie.rendering.base import View
from valerie.scene.graph.model import Camera, Material, Matrix, Mesh, Node, Scene

#: Largest image side, pixels. Padded and supersampled canvases have twice as many per side, and drivers allow 16,384.
MAX_PIXELS: Final = 8192
_IDENTITY: Final[Matrix] = np.eye(4)


@dataclass(frozen=True, slots=True, eq=False)
class DrawItem:
    """One node's meshes in the world.

    Attributes:
        world: (4, 4) float64 object to world.
    """

    node: Node
    world: Matrix

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        return self.node.meshes


def draw_items(scene: Scene, *, movable: bool, label_id: int | None = None) -> tuple[DrawItem, ...]:
    """Return the movable, or the static, nodes with meshes that are visible with all their ancestors, in the scene's order.

    Args:
        movable: True for movables, False for statics.
        label_id: only nodes with this label; None for all.
    """
    items: list[DrawItem] = []
    world_of = _Worlds(scene)
    for node in scene.nodes.values():
        if node.movable == movable and label_id in (None, node.label_id) and node.meshes:
            world = world_of(node)
            if world is not None:
                items.append(DrawItem(node, world))
    return tuple(items)


def instance_roots(scene: Scene) -> dict[int, Node]:
    """Return the topmost node of each instance by instance id, visible or not. Its position and heading are the instance's."""
    roots: dict[int, Node] = {}
    for node in scene.nodes.values():
        if node.instance_id:
            root = roots.get(node.instance_id)
            if root is None or node.path.count(".") < root.path.count("."):
                roots[node.instance_id] = node
    return roots


def lights(scene: Scene) -> tuple[DrawItem, ...]:
    """Return the visible nodes with lights, in the scene's order."""
    items: list[DrawItem] = []
    world_of = _Worlds(scene)
    for node in scene.nodes.values():
        if node.light is not None:
            world = world_of(node)
            if world is not None:
                items.append(DrawItem(node, world))
    return tuple(items)


class _Worlds:
    """World transforms of nodes: None for a node that is hidden or has a hidden ancestor."""

    def __init__(self, scene: Scene) -> None:
        self._nodes = scene.nodes
        self._worlds: dict[str, Matrix | None] = {}

    def __call__(self, node: Node) -> Matrix | None:
        if node.path not in self._worlds:
            parent = self._nodes.get(node.parent)
            above = _IDENTITY if parent is None else self(parent)
            self._worlds[node.path] = above @ node.transform if node.visible and above is not None else None
        return self._worlds[node.path]


def camera_of(scene: Scene, view: View) -> Camera:
    """Return the camera that a view names.

    Raises:
        UnknownName: the scene has no such camera.
        InvalidInput: the image has no pixels, or too many for the graphics library.
    """
    for name in ("width", "height"):
        pixels = getattr(view, name)
        if not 1 <= pixels <= MAX_PIXELS:
            raise InvalidInput("image size out of range", field=name, value=pixels, limit=f"1…{MAX_PIXELS}")
    try:
        return scene.cameras[view.camera]
    except KeyError:
        raise UnknownName("camera", view.camera, scene.cameras, field="camera") from None


def camera_key(camera: Camera, view: View) -> tuple[object, ...]:
    """Return a cache key of everything that determines where a point falls in the image."""
    lens = (camera.focal_length_mm, camera.sensor_width_mm, camera.near, camera.far)
    return (camera.transform.tobytes(), *lens, view.width, view.height)


def material_of(scene: Scene, mesh: Mesh, path: str) -> Material:
    """Return the material that a mesh names.

    Raises:
        RenderingError: the scene has no such material, or the material names a texture that the scene lacks.
    """
    material = scene.materials.get(mesh.material)
    if material is None:
        raise RenderingError(f"{path}: the scene has no material {mesh.material!r}")
    for texture in material.textures:
        if texture not in scene.textures:
            raise RenderingError(f"{path}: the scene has no texture {texture!r} of material {material.name!r}")
    return material


def normal_matrix(world: Matrix) -> NDArray[np.float32]:
    """Return the normal matrix of ``world``, (3, 3) float32: its inverse transpose."""
    matrix: NDArray[np.float32] = np.linalg.inv(world[:3, :3]).T.astype(np.float32)
    return matrix
