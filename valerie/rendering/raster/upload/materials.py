"""Materials as rows of a float texture, which shaders read by index."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.raster.upload.textures import TextureSet
from valerie.scene.graph.model import Material

#: RGBA texels per material.
TEXELS: Final = 6


class SurfaceKind(NamedTuple):
    """The properties of a material that select its program and GL state. Static meshes of one kind share a draw call.

    Attributes:
        color_side, normal_side, roughness_side: sides of the texture arrays, 0 for no texture.
        double_sided: back faces are drawn.
        cut: texels with low alpha are cut out.
        clear: the surface is a transparent pane.
        room_side: side of the array of the texture of rooms, 0 for none.
    """

    color_side: int
    normal_side: int
    roughness_side: int
    double_sided: bool
    cut: bool
    clear: bool
    room_side: int


def surface_kind(material: Material, textures: TextureSet) -> SurfaceKind:
    """Return the kind of a material."""
    cut = material.alpha_cutoff is not None and material.base_color_texture is not None
    return SurfaceKind(
        textures.side(material.base_color_texture),
        textures.side(material.normal_texture),
        textures.side(material.roughness_texture),
        material.double_sided,
        cut,
        material.transmission > 0.0,
        textures.side(material.rooms.texture if material.rooms is not None else None),
    )


def mean_reflectance(
    materials: Sequence[Material], textures: TextureSet
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean linear albedo of diffuse reflection, (M, 3), and the share of the area that is not cut out, (M,)."""
    albedo, share = np.zeros((len(materials), 3)), np.ones(len(materials))
    for row, material in enumerate(materials):
        metallic = material.metallic
        if material.roughness_texture is not None:
            metallic *= textures.mean_metallic(material.roughness_texture)
        albedo[row] = np.array(material.base_color) * (1.0 - metallic)
        if material.base_color_texture is not None:
            color, share[row] = textures.mean(material.base_color_texture, material.alpha_cutoff)
            albedo[row] *= color
    return albedo, share


def material_table(materials: Sequence[Material], textures: TextureSet) -> NDArray[np.float32]:
    """Return the material table, (N, 6, 4) float32: six RGBA texels per material.

    0: base colour, alpha cutoff (0: none) · 1: roughness, metallic, specular, specular tint · 2: emissive, translucency
    (−1: the emissive light is that of rooms) ·
    3: layers of the colour and of the normal texture, sides of their arrays (0: none) · 4: transmission, layer of the roughness
    texture, side of its array (0: none), traffic · 5: layer, width and depth of the rooms, soaks.
    """
    table = np.zeros((max(len(materials), 1), TEXELS, 4), np.float32)
    for row, material in zip(table, materials, strict=False):
        row[0] = (*material.base_color, material.alpha_cutoff or 0.0)
        row[1] = (material.roughness, material.metallic, material.specular, material.specular_tint)
        row[2] = (*material.emissive, material.light_through)
        for column, name in enumerate((material.base_color_texture, material.normal_texture)):
            if name is not None:
                slot = textures.slots[name]
                row[3, column], row[3, column + 2] = slot.layer, slot.side
        row[4, 0], row[4, 3] = material.transmission, material.traffic
        row[5, 3] = material.soaks
        if material.roughness_texture is not None:
            slot = textures.slots[material.roughness_texture]
            row[4, 1:3] = slot.layer, slot.side
        if material.rooms is not None:
            row[2, 3] = -1.0
            row[5, :3] = textures.slots[material.rooms.texture].layer, material.rooms.width, material.rooms.depth
    return table
