"""Convert materials between this project's metallic-roughness model and that of glTF."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Final

import numpy as np
import pygltflib

from valerie.errors import InvalidInput
from valerie.plain import JsonObject
from valerie.scene.gltf.common import (
    DIFFUSE_TRANSMISSION,
    EMISSIVE_STRENGTH,
    EXTRAS_KEY,
    SPECULAR,
    TRANSMISSION,
    own_extras,
)
from valerie.scene.graph.model import Material, Rooms

TextureIndex = Callable[[str], int]
TextureName = Callable[[int, str], str]

#: Values in [0, 1] that glTF lacks, 0 by default.
_SHARES: Final = ("transmission", "traffic", "soaks")
_ROOM_SIZES: Final = ("width", "depth", "luminance")


def write_material(material: Material, texture_index: TextureIndex) -> pygltflib.Material:
    """Return a glTF material. The specular tint is also written as a colour, for other programs.

    Args:
        texture_index: returns the index of the glTF texture for the name of a texture.
    """
    hue = np.asarray(material.base_color) / max(*material.base_color, 1e-6)
    tint = (1.0 - material.specular_tint) + material.specular_tint * hue
    strength = max(*material.emissive, 1.0)
    extensions: JsonObject = {
        SPECULAR: {
            "specularFactor": min(material.specular, 1.0),
            "specularColorFactor": [float(c) * max(material.specular, 1.0) for c in tint],
        }
    }
    if strength > 1.0:
        extensions[EMISSIVE_STRENGTH] = {"emissiveStrength": strength}
    extras = {
        "specular": material.specular,
        "specular_tint": material.specular_tint,
        "emissive": list(material.emissive),
        **{share: getattr(material, share) for share in _SHARES if getattr(material, share)},
    }
    if material.signal:
        extras["signal"] = True
    if material.translucency is not None:
        extras["translucency"] = material.translucency
    if (rooms := material.rooms) is not None:
        extras["rooms"] = {**asdict(rooms), "texture": texture_index(rooms.texture)}
    color = None if material.base_color_texture is None else texture_index(material.base_color_texture)
    normal = None if material.normal_texture is None else texture_index(material.normal_texture)
    rough = None if material.roughness_texture is None else texture_index(material.roughness_texture)
    return pygltflib.Material(
        name=material.name,
        pbrMetallicRoughness=pygltflib.PbrMetallicRoughness(
            baseColorFactor=[*map(float, material.base_color), 1.0],
            metallicFactor=material.metallic,
            roughnessFactor=material.roughness,
            baseColorTexture=None if color is None else pygltflib.TextureInfo(index=color),
            metallicRoughnessTexture=None if rough is None else pygltflib.TextureInfo(index=rough),
        ),
        normalTexture=None if normal is None else pygltflib.NormalMaterialTexture(index=normal),
        emissiveFactor=[float(c) / strength for c in material.emissive],
        alphaMode=pygltflib.OPAQUE if material.alpha_cutoff is None else pygltflib.MASK,
        alphaCutoff=material.alpha_cutoff,
        doubleSided=material.double_sided,
        extensions=extensions,
        extras={EXTRAS_KEY: extras},
    )


def read_material(
    source: pygltflib.Material,
    name: str,
    *,
    texture_name: TextureName,
    notes: list[str],
) -> Material:
    """Return a material of a scene. Properties that the model lacks are approximated and noted.

    Args:
        source: the material of the file.
        name: name of the material in the scene.
        texture_name: returns the name of a glTF texture, given its index and the place that refers to it.
        notes: receives a sentence for every property that is ignored or approximated.

    Raises:
        InvalidInput: a number is missing, not finite or out of range, or a texture is missing.
    """

    def texture(info: Any, field: str) -> str | None:
        return None if info is None else texture_name(info.index, f"material {name}: {field}")

    pbr = source.pbrMetallicRoughness or pygltflib.PbrMetallicRoughness()
    metallic, roughness = _one(pbr.metallicFactor, 1.0), _one(pbr.roughnessFactor, 1.0)
    if source.emissiveTexture is not None:
        notes.append(f"material {name}: its emissive texture is ignored")
    if source.occlusionTexture is not None:
        notes.append(f"material {name}: its occlusion texture is ignored")
    cutoff = None
    if source.alphaMode == pygltflib.MASK:
        cutoff = _one(source.alphaCutoff, 0.5)
    elif source.alphaMode == pygltflib.BLEND:
        cutoff = 0.5
        notes.append(f"material {name}: blending is replaced by a cut at alpha 0.5, so that labels stay exact")
    extensions = source.extensions or {}
    extras = own_extras(source.extras)
    specular = extensions.get(SPECULAR) or {}
    panes = extensions.get(TRANSMISSION) or {}
    sheets = extensions.get(DIFFUSE_TRANSMISSION)
    if panes.get("transmissionTexture") is not None:
        notes.append(f"material {name}: its transmission texture is ignored")
    if any(key != "diffuseTransmissionFactor" for key in sheets or ()):
        notes.append(f"material {name}: textures and colour of its diffuse transmission are ignored")
    strength = _one((extensions.get(EMISSIVE_STRENGTH) or {}).get("emissiveStrength"), 1.0)
    emissive = (
        [strength * c for c in _three(source.emissiveFactor, 0.0)] if source.emissiveTexture is None else [0.0] * 3
    )

    def share(key: str, otherwise: float) -> float:
        return float(_in_range([_one(extras.get(key), otherwise)], f"{name}.{key}", 1.0)[0])

    color = _three(pbr.baseColorFactor, 1.0)
    return Material(
        name=name,
        base_color=_in_range(color, f"{name}.base_color", 1.0),
        base_color_texture=texture(pbr.baseColorTexture, "baseColorTexture"),
        normal_texture=texture(source.normalTexture, "normalTexture"),
        roughness_texture=texture(pbr.metallicRoughnessTexture, "metallicRoughnessTexture"),
        metallic=_in_range([metallic], f"{name}.metallic", 1.0)[0],
        roughness=_in_range([roughness], f"{name}.roughness", 1.0)[0],
        specular=_one(extras.get("specular"), _one(specular.get("specularFactor"), 1.0)),
        specular_tint=_one(extras.get("specular_tint"), 0.0),
        emissive=_in_range(_three(extras.get("emissive", emissive), 0.0), f"{name}.emissive", 1e6),
        alpha_cutoff=cutoff,
        double_sided=bool(source.doubleSided),
        transmission=share("transmission", _one(panes.get("transmissionFactor"), 0.0)),
        traffic=share("traffic", 0.0),
        soaks=share("soaks", 0.0),
        translucency=None
        if sheets is None and "translucency" not in extras
        else share("translucency", _one((sheets or {}).get("diffuseTransmissionFactor"), 0.0)),
        rooms=_rooms(extras.get("rooms"), name, texture_name),
        signal=extras.get("signal") is True,
    )


def _rooms(source: Any, name: str, texture_name: TextureName) -> Rooms | None:
    if source is None:
        return None
    texture = texture_name(int(source["texture"]), f"material {name}: rooms")
    sizes = {key: _in_range([_one(source[key], 0.0)], f"{name}.rooms.{key}", 1e6)[0] for key in _ROOM_SIZES}
    return Rooms(texture, **sizes)


def _one(value: object, otherwise: float) -> float:
    return otherwise if value is None else float(value)  # type: ignore[arg-type]  # anything else is caught above


def _three(values: Any, otherwise: float) -> list[float]:
    return [float(v) for v in list(values)[:3]] if values else [otherwise] * 3


def _in_range(values: list[float], field: str, highest: float) -> Any:
    for value in values:
        if not 0.0 <= value <= highest:
            raise InvalidInput("out of range", field=f"material {field}", value=value, limit=f"0…{highest:g}")
    return tuple(values)
