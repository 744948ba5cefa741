"""Vehicles in traffic as nodes of a scene, with their riders."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from urban_street.traffic_places import DEFAULT_PAINT, TrafficPlace, class_of
from urban_street.vehicles.build import outline_vehicle
from urban_street.vehicles.content import VehicleContent
from urban_street.vehicles.lamps import GLOWING, vehicle_lamps
from urban_street.vehicles.rider import MOUNTS, build_rider
from valerie.scene.graph.model import Material, Mesh, Node, Texture
from valerie.scene.graph.naming import ROOT
from valerie.scene.graph.paints import is_paint
from valerie.scene.graph.transforms import place


class Traffic:
    """Nodes, materials and textures of vehicles in traffic. Each vehicle has its own paint, which varies independently."""

    def __init__(self) -> None:
        self.materials: dict[str, Material] = {}
        self.textures: dict[str, Texture] = {}

    def nodes(self, name: str, at: TrafficPlace) -> Iterator[Node]:
        """Yield the nodes of a vehicle: the top node, then its kinds, or its parts and its rider, who is a separate object."""
        path = f"{ROOT}.{name}"
        yield Node(path, place(at.x, at.y, 0.0, at.heading), visible=at.shown)
        for number, kind in enumerate(at.kinds):
            yield Node(f"{path}.{kind}", np.eye(4), visible=at.shown and number == 0)
            yield from self._vehicle(f"{path}.{kind}", name, outline_vehicle(kind, at.seed + number, DEFAULT_PAINT))
        if not at.kinds:
            mount = class_of(name)
            yield from self._vehicle(path, name, outline_vehicle(mount, at.seed, DEFAULT_PAINT))
            if at.rider:
                yield from self._parts(path, name, _rider(mount), only=at.rider)

    def _vehicle(self, path: str, owner: str, content: VehicleContent) -> Iterator[Node]:
        yield from self._parts(path, owner, content)
        for lamp in vehicle_lamps(content, lambda material: _own_name(material, owner)):
            yield Node(f"{path}.{lamp.name}", lamp.transform, light=lamp.light)

    def _parts(self, path: str, owner: str, content: VehicleContent, *, only: str = "") -> Iterator[Node]:
        self.textures |= content.textures
        for material in content.materials.values():
            renamed = _own_name(material.name, owner)
            self.materials[renamed] = replace(material, name=renamed)
        for part in content.parts:
            meshes = tuple(_owned(mesh, owner) for mesh in part.meshes)
            yield Node(f"{path}.{only or part.name}", part.transform, meshes, skeleton=part.skeleton)


@lru_cache(maxsize=len(MOUNTS))
def _rider(mount: str) -> VehicleContent:
    """Return the rider of a vehicle, whose shape is built on first use. It is the same in every street."""
    return build_rider(mount)


def _own_name(material: str, owner: str) -> str:
    """Return a material's name, with the owner's prefix for paint and glowing lenses, which vehicles do not share."""
    return f"{owner}/{material}" if is_paint(material) or material in GLOWING else material


def _owned(mesh: Mesh, owner: str) -> Mesh:
    return mesh.with_material(_own_name(mesh.material, owner))
