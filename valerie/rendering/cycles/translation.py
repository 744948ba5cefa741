"""Translate a scene into messages for Blender, without sending anything twice.

Meshes and textures are recognised by identity, materials by value. Everything is in the units of the linear image
(`valerie.rendering.sky`): Blender's radiances are image values without a factor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import asdict
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from valerie.color import LUMINANCE
from valerie.parameters.definitions import Value
from valerie.rendering.base import Rectangle, View
from valerie.rendering.beams import DIPPED
from valerie.rendering.cycles.blender import BlenderProcess
from valerie.rendering.cycles.messages import AirMessage, BeamMessage, CameraMessage, LampMessage
from valerie.rendering.lamps import Lamp, glowing, keeping_hue, lit_lamps, with_lit_rooms
from valerie.rendering.rain import rained_on
from valerie.rendering.scene_reading import DrawItem, camera_of, draw_items, material_of
from valerie.rendering.sky import AZIMUTHS, ELEVATIONS, Sky, sky_of
from valerie.rendering.snowfall import snowed_on
from valerie.rendering.surface_constants import LEAVES_LIE
from valerie.scene.graph.model import ROOM_CELLS, Camera, Material, Matrix, Mesh, Scene, Texture

#: Rows and columns of the sky panorama.
_PANORAMA: Final = (256, 512)
#: Unused objects are removed from Blender when they outnumber those in use by more than this.
_SPARE: Final = 64


class _Placed(NamedTuple):
    """One mesh of a node in the world. ``place`` is the node's position among the drawn nodes, from 1."""

    name: str
    mesh: str
    material: str
    world: Matrix
    place: int


class Guided(NamedTuple):
    """The inputs of the denoiser, each (h, w, 3) float32.

    Attributes:
        noisy: the image before denoising.
        albedo, normal: guide images, as Cycles' denoiser expects them.
    """

    noisy: NDArray[np.float32]
    albedo: NDArray[np.float32]
    normal: NDArray[np.float32]


def render(
    blender: BlenderProcess,
    scene: Scene,
    view: View,
    settings: Mapping[str, Value],
    *,
    border: Rectangle | None = None,
    movables: bool = True,
) -> NDArray[np.float32]:
    """Return the pixels inside the border, or of the whole image, (h, w, 3) float32.

    Args:
        settings: `CyclesSettings.inputs`.
        border: the rectangle to render; None for the whole image.
        movables: True if the image shows the movables.
    """
    arrays = _ask(blender, scene, view, settings, border=border, movables=movables)
    sky, part = sky_of(scene), border if border is not None else Rectangle(0, 0, view.width, view.height)
    rainy = rained_on(arrays["pixels"], sky.drops, sky.haze, part, view.height)
    focal = camera_of(scene, view).focal_length_px(view.width)
    return snowed_on(rainy, sky.flakes, sky.haze, part, view.height, focal)


def guided(
    blender: BlenderProcess,
    scene: Scene,
    view: View,
    settings: Mapping[str, Value],
    *,
    border: Rectangle | None = None,
    movables: bool = True,
) -> Guided:
    """Render as `render` does, but without denoiser, drops and flakes, and return the noisy image with the denoiser's guides.

    Only the validation of layers uses it (docs/benchmarks.md); no product does.
    """
    noisy = {**settings, "denoise": False}
    return Guided(**_ask(blender, scene, view, noisy, border=border, movables=movables, shows="guides"))


def denoised(blender: BlenderProcess, guided_image: Guided) -> NDArray[np.float32]:
    """Denoise with Cycles' own denoiser. Up to float rounding, the result equals that of `render` with ``denoise``."""
    return blender.ask("denoise", guided_image._asdict())[1]["pixels"]


def object_index(
    blender: BlenderProcess, scene: Scene, view: View, settings: Mapping[str, Value]
) -> tuple[NDArray[np.int32], tuple[DrawItem, ...]]:
    """Return Cycles' object index at pixel centres, (H, W), and the items: 0 for the sky, else the item's position plus one.

    Only tests of the truth pass use it; no product does.
    """
    index = _ask(blender, scene, view, settings, shows="index")["index"]
    return index.astype(np.int32), _items(scene, movables=True)


def _items(scene: Scene, *, movables: bool) -> tuple[DrawItem, ...]:
    return draw_items(scene, movable=False) + (draw_items(scene, movable=True) if movables else ())


def _ask(
    blender: BlenderProcess,
    scene: Scene,
    view: View,
    settings: Mapping[str, Value],
    *,
    border: Rectangle | None = None,
    movables: bool = True,
    shows: Literal["pixels", "guides", "index"] = "pixels",
) -> dict[str, NDArray[Any]]:
    """Return the arrays of one pass of Blender: the pixels, these with the denoiser's guides, or the object index."""
    camera, items = camera_of(scene, view), _items(scene, movables=movables)
    # The index pass takes one sample, see `inside.film`.
    _keep_to(blender, {**settings, "samples": 1} if shows == "index" else settings)
    sky = sky_of(scene)
    lamps, scene, unlit = lit_lamps(scene, sky), glowing(scene, sky), scene
    lenses = {name for name, material in scene.materials.items() if material is not unlit.materials[name]}
    scene = with_lit_rooms(keeping_hue(scene, sky), sky)
    sender = _Sender(blender, scene, lenses, sky)
    meshes = [mesh for i, item in enumerate(items, start=1) for mesh in sender.placed(item, i)]
    sender.forget_unused()
    matrices = np.stack([mesh.world for mesh in meshes]) if meshes else np.zeros((0, 4, 4))
    _, arrays = blender.ask(
        "render",
        {"matrices": matrices, "sky": _panorama(sky)},
        size=[view.width, view.height],
        border=None if border is None else [border.x, border.y, border.width, border.height],
        camera=_camera(camera),
        objects=[{"name": p.name, "mesh": p.mesh, "material": p.material, "index": p.place} for p in meshes],
        settings=settings,
        index=shows == "index",
        guides=shows == "guides",
        lamps=[_lamp(lamp) for lamp in lamps if movables or not lamp.movable],
        light=_light(scene, sky),
    )
    return arrays


def _keep_to(blender: BlenderProcess, settings: Mapping[str, Value]) -> None:
    """Reset Blender if the last image had other settings.

    Cycles' persistent data (Blender 4.5) depends on the settings of its first image. After a change of the number of samples,
    the noise would differ from a new Blender's. The seed and the denoiser may change.
    """
    lasting = {name: value for name, value in settings.items() if name not in ("seed", "denoise")}
    if blender.settings is not None and blender.settings != lasting:
        blender.reset()
    blender.settings = lasting


class _Sender:
    """Sends the objects that Blender lacks, and records those that the image uses.

    Args:
        lenses: names of materials that glow because a lamp is on. The lamp emits their light.
        sky: what lies on surfaces that face up.
    """

    def __init__(self, blender: BlenderProcess, scene: Scene, lenses: Set[str], sky: Sky) -> None:
        self._blender = blender
        self._scene = scene
        self._lenses = lenses
        self._sky = sky
        self._used: set[str] = set()

    def placed(self, item: DrawItem, place: int) -> list[_Placed]:
        """Send the meshes of a node, and return them with their materials and world matrices."""
        meshes = []
        for i, mesh in enumerate(item.meshes):
            if not mesh.faces.size:
                continue
            static = not item.node.movable
            # Leaves have many shader nodes, so only what has level parts gets them.
            strewn = static and self._sky.leaf_litter > 0.0 and _has_level_parts(mesh, item.world)
            material = self._material(material_of(self._scene, mesh, item.node.path), static=static, strewn=strewn)
            key, world = self._mesh(mesh, item.world)
            meshes.append(_Placed(f"{item.node.path}#{i}", key, material, world, place))
        return meshes

    def forget_unused(self) -> None:
        """Remove the objects that this image does not use once there are many, which bounds memory over many scenes."""
        objects = self._blender.known
        unused = [key for key in objects if key not in self._used]
        if len(unused) > len(self._used) + _SPARE:
            kinds = ("mesh", "material", "texture")
            lists = {kind: [key for key in unused if key.startswith(f"{kind}-")] for kind in kinds}
            self._blender.ask("forget", meshes=lists["mesh"], materials=lists["material"], textures=lists["texture"])
            for key in unused:
                del objects[key]

    def _mesh(self, mesh: Mesh, world: Matrix) -> tuple[str, Matrix]:
        if not _sheared(world):
            key = f"mesh-{id(mesh):x}"
            if self._is_new(key, mesh):
                self._send_mesh(key, mesh, mesh.positions, mesh.normals)
            return key, world
        # Blender's objects have a position, a rotation and a scale. The vertices take any other transform.
        key = f"mesh-{id(mesh):x}-{world.tobytes().hex()}"
        if self._is_new(key, mesh):
            turn = np.linalg.inv(world[:3, :3])
            normals = mesh.normals @ turn
            normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
            self._send_mesh(key, mesh, mesh.positions @ world[:3, :3].T + world[:3, 3], normals)
        return key, np.eye(4)

    def _send_mesh(self, key: str, mesh: Mesh, positions: NDArray[Any], normals: NDArray[Any]) -> None:
        arrays = {
            "positions": positions.astype(np.float32),
            "normals": normals.astype(np.float32),
            "uvs": mesh.uvs,
            "faces": mesh.faces,
        }
        if self._scene.materials[mesh.material].rooms is not None:
            arrays |= _cell_sides(positions, mesh)
        self._blender.ask("mesh", arrays, key=key)

    def _material(self, material: Material, *, static: bool, strewn: bool) -> str:
        rooms = material.rooms
        textures = {
            "base_color_texture": self._texture(material.base_color_texture if rooms is None else None, color=True),
            "normal_texture": self._texture(material.normal_texture, color=False),
            "roughness_texture": self._texture(material.roughness_texture, color=False),
        }
        values = asdict(material) | textures | {"rooms": None}
        if rooms is not None:
            # Pictures and curtains are blended as they are stored.
            pictures = self._texture(rooms.texture, color=False)
            values["rooms"] = {**asdict(rooms), "texture": pictures, "cells": ROOM_CELLS}
        lens = material.name in self._lenses
        covers = {
            "strewn": strewn and material.light_through == 0.0,
            "wet": self._sky.wetness > 0.0,
            "snowy": static and self._sky.snow_depth > 0.0,
        }
        key = f"material-{hash((material, lens, *covers.values(), *textures.values())) & (1 << 64) - 1:x}"
        if self._is_new(key, material):
            values |= covers | {"translucency": material.light_through}
            self._blender.ask("material", key=key, lens=lens, **values)
        return key

    def _texture(self, name: str | None, *, color: bool) -> str | None:
        if name is None:
            return None
        texture: Texture = self._scene.textures[name]
        key = f"texture-{id(texture):x}-{'color' if color else 'data'}"
        if self._is_new(key, texture):
            self._blender.ask("texture", {"image": texture.image}, key=key, color=color)
        return key

    def _is_new(self, key: str, value: Mesh | Material | Texture) -> bool:
        """Record a use, and return True if Blender lacks the thing. The reference to it keeps its ``id`` from being reused."""
        self._used.add(key)
        if key in self._blender.known:
            return False
        self._blender.known[key] = value
        return True


_BEAM: Final[BeamMessage] = {
    "spread": DIPPED.spread,
    "rise": DIPPED.rise,
    "edge": DIPPED.edge,
    "stray": DIPPED.stray,
}


def _camera(camera: Camera) -> CameraMessage:
    return {
        "matrix": camera.transform.ravel().tolist(),
        "focal_length_mm": camera.focal_length_mm,
        "sensor_width_mm": camera.sensor_width_mm,
        "near": camera.near,
        "far": camera.far,
    }


def _light(scene: Scene, sky: Sky) -> AirMessage:
    """Return sun, air and distant ground."""
    return {
        "sun": sky.sun.tolist(),
        "toward_sun": sky.sun_direction.tolist(),
        "angular_diameter": scene.sun.angular_diameter,
        "extinction": float(sky.extinction @ LUMINANCE),
        "haze": sky.haze.tolist(),
        "ground": sky.ground.tolist(),
        "wetness": sky.wetness,
        "snow_depth": sky.snow_depth,
        "leaf_litter": sky.leaf_litter,
    }


def _lamp(lamp: Lamp) -> LampMessage:
    """Return a lamp for Blender.

    Blender's energy is the power of a whole sphere: the radiant intensity is energy / 4π, and a white surface shows its
    irradiance divided by π.
    """
    strength = np.array(lamp.strength)
    peak = float(strength.max())
    return {
        "position": list(lamp.position),
        "direction": list(lamp.direction),
        "up": list(lamp.up),
        "energy": 4 * math.pi**2 * peak,
        "color": (strength / peak).tolist(),
        "inner": lamp.inner,
        "outer": lamp.outer,
        "radius": lamp.radius,
        "beam": _BEAM if lamp.dipped else None,
    }


def _panorama(sky: Sky) -> NDArray[np.float32]:
    """Return an equirectangular image of our sky, (H, W, 3): zenith at the top, +x at the centre, +y a quarter to the left."""
    height, width = _PANORAMA
    elevation = np.maximum(np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi, 0.0)
    direction = np.pi - (np.arange(width) + 0.5) / width * 2 * np.pi
    toward = np.arctan2(sky.sun_direction[1], sky.sun_direction[0])
    azimuth = np.abs((direction - toward + np.pi) % (2 * np.pi) - np.pi)
    rows = np.clip(np.sqrt(elevation / (np.pi / 2)) * ELEVATIONS - 0.5, 0, ELEVATIONS - 1)
    columns = np.clip(azimuth / np.pi * AZIMUTHS - 0.5, 0, AZIMUTHS - 1)
    at = np.stack(np.meshgrid(rows, columns, indexing="ij"))
    return np.stack([map_coordinates(sky.table[..., i], at, order=1) for i in range(3)], axis=2).astype(np.float32)


def _has_level_parts(mesh: Mesh, world: Matrix) -> bool:
    """Return True if leaves can lie on a part of a mesh."""
    normals = mesh.normals @ np.linalg.inv(world[:3, :3])
    return bool((normals[:, 2] > LEAVES_LIE[0] * np.linalg.norm(normals, axis=1)).any())


def _cell_sides(positions: NDArray[np.float64], mesh: Mesh) -> dict[str, NDArray[np.float32]]:
    """Return the sides of a cell of rooms in each triangle of panes, (F, 3) metres: along u and along v (see `Rooms`)."""
    first, second, third = (positions[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    at, to, on = (mesh.uvs[mesh.faces[:, k]].astype(np.float64) * ROOM_CELLS for k in range(3))
    (u1, v1), (u2, v2) = (to - at).T, (on - at).T
    area = u1 * v2 - u2 * v1
    area = np.where(np.abs(area) < 1e-12, 1e-12, area)[:, None]
    one, two = second - first, third - first
    return {
        "right": ((one * v2[:, None] - two * v1[:, None]) / area).astype(np.float32),
        "down": ((two * u1[:, None] - one * u2[:, None]) / area).astype(np.float32),
    }


def _sheared(world: Matrix) -> bool:
    """Return True if a matrix has more than translation, rotation and scale along the object's own axes."""
    axes = world[:3, :3]
    lengths = np.maximum(np.linalg.norm(axes, axis=0), 1e-300)
    cosines = (axes / lengths).T @ (axes / lengths)
    return bool(np.abs(cosines - np.eye(3)).max() > 1e-5)
