"""Assets with more people, each recoloured and resized separately, for training scenes."""

from __future__ import annotations

import colorsys
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.color import luminance_of
from valerie.errors import InvalidInput
from valerie.labels import PERSON, instance_id
from valerie.parameters.assignment import digest
from valerie.parameters.definitions import ParameterDefinition
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.deferred import DeferredTexture
from valerie.scene.graph.model import Material, Node, Scene, Texture
from valerie.scene.graph.naming import ROOT, is_cloth
from valerie.scene.graph.transforms import Pose

#: Raise it whenever the same asset gives another crowd.
REVISION: Final = 1
#: Most persons in a frame.
MOST_PERSONS: Final = 5
#: Prefix of the names of grey textures.
_NEUTRAL: Final = "neutral/"


def crowd_asset(asset: SceneAsset, persons: int = MOST_PERSONS) -> SceneAsset:
    """Return the asset with copies of its first person until it has ``persons``, and with grey twins of all cloth textures.

    Characters that the asset excludes from training are removed. Copies have their own materials, so that each can be
    recoloured separately.

    Raises:
        InvalidInput: the asset has no person.
    """
    manifest, scene = _without_characters(asset, set(asset.manifest.training.left_out) - set(asset.manifest.movable))
    if not manifest.persons:
        raise InvalidInput("has no person to train on", field="asset", value=asset.name)
    source = manifest.persons[0]
    numbers = [n for n in range(1, 1000) if f"{ROOT}.{PERSON.node_class}-{n}" not in scene.nodes]
    added = [f"{ROOT}.{PERSON.node_class}-{n}" for n in numbers[: max(0, persons - len(manifest.persons))]]
    nodes, materials = dict(scene.nodes), dict(scene.materials)
    parameters = list(manifest.parameters)
    for path, number in zip(added, numbers, strict=False):
        _copy_person(scene, source, path, number, nodes, materials)
        parameters += [
            ParameterDefinition.model_validate(
                {**definition.model_dump(), "path": path + definition.path.removeprefix(source), "name": ""}
            )
            for definition in manifest.parameters
            if definition.path.startswith(f"{source}.")
        ]
    textures = dict(scene.textures)
    for material in scene.materials.values():
        if _is_worn(material.name, manifest) and material.base_color_texture is not None:
            name = f"{_NEUTRAL}{material.base_color_texture}"
            textures[name] = DeferredTexture(name, partial(_grey, scene.textures[material.base_color_texture]))
    fields = {name: getattr(manifest, name) for name in Manifest.model_fields}
    for name in ("persons", "movable", "grounded"):
        fields[name] = (*fields[name], *added)
    fields["parameters"] = tuple(parameters)
    return SceneAsset(
        Manifest.model_validate(fields),
        digest("training-crowd", asset.digest, persons, REVISION),
        replace(scene, nodes=nodes, materials=materials, textures=textures),
    )


def _without_characters(asset: SceneAsset, left_out: set[str]) -> tuple[Manifest, Scene]:
    """Return manifest and scene without the characters at some paths, so that no draw depends on them."""
    manifest, scene = asset.manifest, asset.base
    below = tuple(f"{path}." for path in left_out)
    nodes = {path: n for path, n in scene.nodes.items() if path not in left_out and not path.startswith(below)}
    parameters = tuple(
        definition.model_copy(
            update={
                "choices": tuple(
                    choice
                    for choice in definition.choices
                    if f"{definition.path.removesuffix('.character')}.{choice}" not in left_out
                )
            }
        )
        if definition.path.endswith(".character")
        else definition
        for definition in manifest.parameters
    )
    training = manifest.training.model_copy(
        update={"left_out": tuple(path for path in manifest.training.left_out if path not in left_out)}
    )
    return manifest.model_copy(update={"parameters": parameters, "training": training}), replace(scene, nodes=nodes)


def resized(scene: Scene, manifest: Manifest, rng: np.random.Generator) -> dict[str, Node]:
    """Return the nodes of a scene with each person scaled by a random factor of 0.88 to 1.06."""
    nodes = dict(scene.nodes)
    for person in manifest.persons:
        pose = Pose.of(nodes[person].transform)
        factor = float(rng.uniform(0.88, 1.06))
        nodes[person] = replace(nodes[person], transform=replace(pose, scale=(factor, factor, factor)).matrix())
    return nodes


def recoloured(scene: Scene, manifest: Manifest, rng: np.random.Generator, as_made: float) -> dict[str, Material]:
    """Return the materials of a scene with new clothes and skins.

    Each garment gets its own colour, except for a share ``as_made``; skin is scaled by a factor per person.
    """
    materials = dict(scene.materials)
    for person in manifest.persons:
        skin = float(rng.uniform(0.3, 1.1))
        names = {
            mesh.material
            for node in scene.nodes.values()
            if node.path == person or node.path.startswith(f"{person}.")
            for mesh in node.meshes
        }
        for name in sorted(names):
            material = materials[name]
            if _is_worn(name, manifest):
                if rng.random() < as_made:
                    continue
                texture = material.base_color_texture
                neutral = None if texture is None else f"{_NEUTRAL}{texture}"
                materials[name] = replace(material, base_color=_cloth_color(rng), base_color_texture=neutral)
            elif _has_part(name, manifest.training.skin):
                red, green, blue = material.base_color
                materials[name] = replace(material, base_color=(red * skin, green * skin, blue * skin))
    return materials


def _cloth_color(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw linear RGB: half of all cloth is nearly grey, as in real crowds, the rest has any hue, with uniform brightness."""
    saturation = rng.uniform(0.0, 0.2) if rng.random() < 0.5 else rng.uniform(0.3, 1.0)
    red, green, blue = colorsys.hsv_to_rgb(rng.random(), saturation, rng.uniform(0.08, 1.0))
    return red**2.2, green**2.2, blue**2.2


def _grey(texture: Texture) -> NDArray[np.uint8]:
    """Return a texture's weave without its colour, scaled to a mean of 190 so that a tint keeps its brightness."""
    image = texture.image
    luminance = luminance_of(image[..., :3].astype(np.float64))
    level = (luminance * (190.0 / max(luminance.mean(), 1.0))).clip(0, 255).astype(np.uint8)
    grey = np.repeat(level[..., None], 3, axis=2)
    return np.concatenate([grey, image[..., 3:]], axis=2)


def _copy_person(
    scene: Scene, source: str, path: str, number: int, nodes: dict[str, Node], materials: dict[str, Material]
) -> None:
    """Add a copy of the nodes at and below ``source`` under ``path``; vertex arrays are shared, materials are not."""
    old, new = (f"{person.removeprefix(f'{ROOT}.')}/" for person in (source, path))

    def renamed(name: str) -> str:
        return new + name.removeprefix(old)

    for node in [n for n in scene.nodes.values() if n.path == source or n.path.startswith(f"{source}.")]:
        figure = None if node.figure is None else node.figure.renamed(renamed)
        meshes = node.meshes if figure is None else figure.meshes
        copy = path + node.path.removeprefix(source)
        nodes[copy] = replace(
            node,
            path=copy,
            meshes=tuple(mesh.with_material(renamed(mesh.material)) for mesh in meshes) if figure is None else meshes,
            instance_id=instance_id(PERSON, number) if node.label_id == PERSON.id else node.instance_id,
            figure=figure,
        )
        names = {mesh.material for mesh in node.meshes} | {name for name in scene.materials if name.startswith(old)}
        materials.update((renamed(name), replace(scene.materials[name], name=renamed(name))) for name in sorted(names))


def _is_worn(material: str, manifest: Manifest) -> bool:
    return is_cloth(material) or _has_part(material, manifest.training.worn)


def _has_part(material: str, beginnings: tuple[str, ...]) -> bool:
    return any(part.startswith(beginnings) for part in material.split("/"))
