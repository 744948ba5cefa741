"""Vehicles in traffic as nodes of a scene: which of several cars is seen, a bicycle with its rider."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from valerie.scene.model import Material, Mesh, Node, Texture
from valerie.scene.naming import ROOT
from valerie.scene.paints import is_paint
from valerie.scene.procedural.vehicles.build import build_vehicle
from valerie.scene.procedural.vehicles.content import VehicleContent
from valerie.scene.procedural.vehicles.lamps import GLOWING, vehicle_lamps
from valerie.scene.procedural.vehicles.rider import build_rider
from valerie.scene.transforms import place

#: Paint of vehicles in traffic before any parameter.
DEFAULT_PAINT: Final = "blue"


@dataclass(frozen=True, slots=True)
class TrafficPlace:
    """Where a vehicle in traffic is by default (metres, degrees), and what it can be.

    Attributes:
        kinds: of a car, of which one or none is shown; empty for a bicycle.
        rider: name of the node of its rider, if it has one.
    """

    x: float
    y: float
    heading: float
    kinds: tuple[str, ...] = ()
    rider: str = ""


class Traffic:
    """Nodes, materials and textures of vehicles in traffic; each has paint of its own, since each varies alone."""

    def __init__(self) -> None:
        self.materials: dict[str, Material] = {}
        self.textures: dict[str, Texture] = {}
        self._rider: VehicleContent | None = None

    def nodes(self, name: str, where: TrafficPlace) -> Iterator[Node]:
        """The hidden node of a vehicle and what is below it."""
        if where.rider:
            yield from self.cyclist(name, where.rider, where, shown=False)
            return
        path = f"{ROOT}.{name}"
        yield Node(path, place(where.x, where.y, 0.0, where.heading), visible=False)
        for number, kind in enumerate(where.kinds):
            yield Node(f"{path}.{kind}", np.eye(4), visible=False)
            built = build_vehicle(kind, number, DEFAULT_PAINT)
            yield from self._parts(f"{path}.{kind}", name, built)
            yield from _lamps(f"{path}.{kind}", name, built)

    def cyclist(self, bicycle: str, rider: str, where: TrafficPlace, *, shown: bool) -> Iterator[Node]:
        """A bicycle with its rider, who is a node below it and of a class of his own."""
        path = f"{ROOT}.{bicycle}"
        yield Node(path, place(where.x, where.y, 0.0, where.heading), visible=shown)
        built = build_vehicle("bicycle", 0, DEFAULT_PAINT)
        yield from self._parts(path, bicycle, built)
        yield from _lamps(path, bicycle, built)
        if self._rider is None:
            self._rider = build_rider("bicycle")
        yield from self._parts(path, bicycle, self._rider, only=rider)

    def _parts(self, path: str, owner: str, content: VehicleContent, *, only: str = "") -> Iterator[Node]:
        self.textures |= content.textures
        for material in content.materials.values():
            named = _own_name(material.name, owner)
            self.materials[named] = replace(material, name=named)
        for part in content.parts:
            meshes = tuple(_owned(mesh, owner) for mesh in part.meshes)
            yield Node(f"{path}.{only or part.name}", part.transform, meshes, joints=part.joints)


def _lamps(path: str, owner: str, content: VehicleContent) -> Iterator[Node]:
    for lamp in vehicle_lamps(content, lambda material: _own_name(material, owner)):
        yield Node(f"{path}.{lamp.name}", lamp.transform, light=lamp.light)


def _own_name(material: str, owner: str) -> str:
    """Paint varies, and lenses glow, of each vehicle alone."""
    return f"{owner}/{material}" if is_paint(material) or material in GLOWING else material


def _owned(mesh: Mesh, owner: str) -> Mesh:
    return replace(mesh, material=_own_name(mesh.material, owner))
