"""Scenes on the GPU. Earlier uploads are found by the identity of meshes and textures."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.raster.gl.cache import LeastRecentlyUsed
from valerie.rendering.raster.upload.materials import SurfaceKind, material_table, mean_reflectance, surface_kind
from valerie.rendering.raster.upload.movable_geometry import MeshBuffers, PlacedMesh
from valerie.rendering.raster.upload.static_geometry import StaticGeometry
from valerie.rendering.raster.upload.textures import TextureSet
from valerie.rendering.scene_reading import DrawItem, draw_items, material_of
from valerie.scene.graph.model import Material, Node, Scene

#: Largest number of assets on the GPU. A worker renders groups of variants of one asset.
ASSETS: Final = 2
#: Largest number of movable meshes on the GPU.
MESHES: Final = 256


@dataclass(frozen=True, slots=True, eq=False)
class Statics:
    """The static part of a scene.

    Attributes:
        nodes: its nodes in order; compared by identity.
        key: cache key of the shape and of the material properties that the G-buffer contains.
        shape_key: cache key of the surfaces as far as they hide the sun or the sky.
        materials: the materials of the statics, in the order of their rows.
        names: names of these materials.
        table: their rows of the material table.
        albedo, share: see `mean_reflectance`.
    """

    nodes: tuple[Node, ...]
    geometry: StaticGeometry
    textures: TextureSet
    materials: tuple[Material, ...]
    names: tuple[str, ...]
    key: Hashable
    shape_key: Hashable
    table: NDArray[np.float32]
    albedo: NDArray[np.float64]
    share: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A scene ready to draw.

    Attributes:
        placed: the movables' meshes at their places. Their materials follow those of the statics in ``materials``.
        materials: the materials in the order of the rows of the material table.
    """

    scene: Scene
    statics: Statics
    placed: tuple[PlacedMesh, ...]
    materials: tuple[Material, ...]

    def table(self) -> NDArray[np.float32]:
        """Return the material table, (N, 6, 4) float32."""
        # The statics have hundreds of materials and a movable has a dozen, so only the movables' rows are computed.
        count = len(self.statics.materials)
        if len(self.materials) == count:
            return self.statics.table
        moving = material_table(self.materials[count:], self.statics.textures)
        return np.concatenate([self.statics.table[:count], moving])


class SceneStore:
    """Uploads scenes, and caches the uploads for further scenes of the same asset.

    Args:
        gl: the GL context; it must be current in every call.
    """

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._textures: LeastRecentlyUsed[TextureSet] = LeastRecentlyUsed(ASSETS)
        self._geometries: LeastRecentlyUsed[StaticGeometry] = LeastRecentlyUsed(ASSETS)
        self._meshes: LeastRecentlyUsed[MeshBuffers] = LeastRecentlyUsed(MESHES)
        self._last: Statics | None = None

    def prepare(self, scene: Scene, *, movables: bool = True) -> Prepared:
        """Upload a scene's geometry, without its movables if ``movables`` is False."""
        statics = self._statics(scene)
        materials = list(statics.materials)
        movable_meshes = self.place(scene, draw_items(scene, movable=True), statics, materials) if movables else ()
        return Prepared(scene, statics, movable_meshes, tuple(materials))

    def place(
        self, scene: Scene, items: Sequence[DrawItem], statics: Statics, materials: list[Material]
    ) -> tuple[PlacedMesh, ...]:
        """Upload single meshes and place them in the world. Their materials are appended to ``materials``."""
        meshes: list[PlacedMesh] = []
        statics.textures.require(material_of(scene, mesh, item.node.path) for item in items for mesh in item.meshes)
        for item in items:
            for mesh in item.meshes:
                if not mesh.faces.size:
                    continue
                material = material_of(scene, mesh, item.node.path)
                buffers = self._meshes.get(id(mesh), lambda m=mesh: MeshBuffers(self._gl, m))  # type: ignore[misc]
                materials.append(material)
                kind = surface_kind(material, statics.textures)
                meshes.append(PlacedMesh.place(buffers, item, kind, len(materials) - 1))
        return tuple(meshes)

    def release(self) -> None:
        """Free everything."""
        self._last = None
        for cache in (self._textures, self._geometries, self._meshes):
            cache.clear()

    def _statics(self, scene: Scene) -> Statics:
        nodes = tuple(node for node in scene.nodes.values() if not node.movable)
        last = self._last
        textures = self._texture_set(scene)
        if (
            last is not None
            and last.textures is textures
            and len(last.nodes) == len(nodes)
            and all(map(is_, last.nodes, nodes))
            and all(map(is_, map(scene.materials.get, last.names), last.materials))
        ):
            return last
        items = draw_items(scene, movable=False)
        rows: dict[str, int] = {}
        materials: list[Material] = []
        item_rows: list[tuple[int, ...]] = []
        item_kinds: list[tuple[SurfaceKind, ...]] = []
        textures.require(material_of(scene, mesh, item.node.path) for item in items for mesh in item.meshes)
        for item in items:
            item_materials = [material_of(scene, mesh, item.node.path) for mesh in item.meshes]
            for material in item_materials:
                if material.name not in rows:
                    rows[material.name] = len(materials)
                    materials.append(material)
            item_rows.append(tuple(rows[material.name] for material in item_materials))
            item_kinds.append(tuple(surface_kind(material, textures) for material in item_materials))
        key = (
            textures.serial,
            tuple(item_kinds),
            tuple((tuple(map(id, i.meshes)), i.world.tobytes(), i.node.label_id, i.node.instance_id) for i in items),
        )
        geometry = self._geometries.get(key, lambda: StaticGeometry(self._gl, items, item_rows, item_kinds))
        appearance = tuple(
            (m.base_color, m.textures, m.alpha_cutoff, m.transmission, m.rooms is not None and m.emissive)
            for m in materials
        )
        # A solid surface hides light regardless of its textures.
        shape = tuple(
            (m.alpha_cutoff, m.base_color_texture if surface_kind(m, textures).cut else None, m.transmission)
            for m in materials
        )
        self._last = Statics(
            nodes,
            geometry,
            textures,
            tuple(materials),
            tuple(m.name for m in materials),
            (geometry.serial, textures.serial, appearance),
            (geometry.serial, textures.serial, shape),
            material_table(materials, textures),
            *mean_reflectance(materials, textures),
        )
        return self._last

    def _texture_set(self, scene: Scene) -> TextureSet:
        key = (*scene.textures, *map(id, scene.textures.values()))
        return self._textures.get(key, lambda: TextureSet(self._gl, scene.textures))
