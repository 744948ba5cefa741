"""Build meshes, materials and textures from a layout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from urban_street.signs.faces import PLACED, face_materials, face_textures, plate
from urban_street.solids.surfaces import Bag, pose
from urban_street.street import amenities, furniture, house_styles, road, roadside, signals, swept
from urban_street.street.foliage import build_tree
from urban_street.street.houses import add_floor, build_house
from urban_street.street.materials import foliage_materials, foliage_textures, make_materials, make_textures
from urban_street.street.plan import Placement, StreetLayout, StreetLines
from urban_street.street.rows import HOUSE_STYLES
from urban_street.street.shapes import DEFAULT_PHASE, PHASES, Signals
from urban_street.street.species import SPECIES, species_of
from urban_street.vehicles.build import KINDS, build_vehicle, vehicle_seed
from urban_street.vehicles.content import VehicleContent
from valerie.errors import UnknownName
from valerie.scene.graph.model import Light, Material, Matrix, Mesh, Texture


@dataclass(frozen=True, slots=True, eq=False)
class StreetPart:
    """One node: an object with its shape, or a vehicle, or a part of one.

    Attributes:
        path: node path, e.g. ``scene.tree-3`` or ``scene.car-3.door-1``.
        transform: (4, 4), to the parent's frame; to the world for objects.
        meshes: one mesh per material, shared by identity between equal objects.
        light: a lamp at the node's origin.
        shown: True if it is visible by default.
    """

    path: str
    transform: Matrix
    meshes: tuple[Mesh, ...]
    light: Light | None = None
    shown: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class StreetContent:
    """All objects of a street, with their materials and textures."""

    parts: tuple[StreetPart, ...]
    materials: dict[str, Material]
    textures: dict[str, Texture]


def build_street(layout: StreetLayout) -> StreetContent:
    """Build the shape of every placement of a layout in a few CPU seconds. Equal layouts give equal bytes."""
    workshop = _Workshop(layout)
    parts: list[StreetPart] = []
    for placement in layout.placements:
        if placement.kind in KINDS:
            vehicle = workshop.vehicle(placement)
            parts.append(StreetPart(placement.path, _transform(placement), ()))
            parts += (StreetPart(f"{placement.path}.{p.name}", p.transform, p.meshes) for p in vehicle.parts)
        else:
            parts.append(StreetPart(placement.path, _transform(placement), workshop.meshes(placement)))
            if placement.kind == "lamp":
                parts.append(StreetPart(f"{placement.path}.lamp", furniture.LANTERN_PLACE, (), furniture.LANTERN))
            if isinstance(placement.shape, Signals):
                for phase in PHASES:
                    lenses = signals.lenses(placement.shape, phase).meshes()
                    parts.append(
                        StreetPart(f"{placement.path}.{phase}", np.eye(4), lenses, shown=phase == DEFAULT_PHASE)
                    )
    in_use = {mesh.material for part in parts for mesh in part.meshes}
    settings = layout.settings
    all_materials = (
        make_materials(settings.seed) | foliage_materials(settings.season) | face_materials() | workshop.materials
    )
    materials = {name: material for name, material in all_materials.items() if name in in_use}
    in_use = {texture for material in materials.values() for texture in material.textures}
    painted = make_textures(settings) | foliage_textures(settings) | face_textures() | workshop.textures
    textures = {name: texture for name, texture in painted.items() if name in in_use}
    return StreetContent(tuple(parts), materials, textures)


def _transform(placement: Placement) -> Matrix:
    matrix = pose(placement.x, placement.y, placement.z, placement.heading)
    if species_of(placement.kind):
        matrix[:3, :3] *= placement.size[0]
    return matrix


class _Workshop:
    """Builds the objects and stores shared shapes."""

    def __init__(self, layout: StreetLayout) -> None:
        self._seed = layout.settings.seed
        self._lines, self._near = layout.lines, layout.near
        self._shared: dict[tuple[str, int], tuple[Mesh, ...]] = {}
        self._vehicles: dict[tuple[str, int, bool], VehicleContent] = {}
        self.materials: dict[str, Material] = {}
        self.textures: dict[str, Texture] = {}

    def vehicle(self, placement: Placement) -> VehicleContent:
        """Build the vehicle of one placement, and keep its materials and textures."""
        x0, y0, x1, y1 = self._near
        fine = x0 < placement.x < x1 and y0 < placement.y < y1
        key = (placement.kind, placement.variant, fine)
        if key not in self._vehicles:
            content = build_vehicle(placement.kind, vehicle_seed(self._seed, placement.variant), fine=fine)
            self._vehicles[key] = content
            self.materials |= content.materials
            self.textures |= content.textures
        return self._vehicles[key]

    def meshes(self, placement: Placement) -> tuple[Mesh, ...]:
        """Return the shape of one placement.

        Raises:
            UnknownName: no builder knows the placement's kind.
        """
        kind = placement.kind
        if kind in HOUSE_STYLES or kind in house_styles.BUILDERS:
            house = house_styles.BUILDERS.get(kind, build_house)(placement)
            add_floor(house, placement)
            return house.meshes()
        if kind in _GROUND:
            return _GROUND[kind](placement, self._lines).meshes()
        if kind == "face":
            return plate(PLACED[placement.variant])
        if kind in _UNIQUE:
            return _UNIQUE[kind](placement).meshes()
        key = (kind, placement.variant)
        if key not in self._shared:
            self._shared[key] = self._build_shared(kind, placement.variant).meshes()
        return self._shared[key]

    def _build_shared(self, kind: str, variant: int) -> Bag:
        rng = np.random.default_rng(np.random.SeedSequence([self._seed, variant, len(kind)]))
        if species := species_of(kind):
            return build_tree(species, rng, kind.removeprefix("far-"))
        try:
            return _SHARED[kind]()
        except KeyError:
            kinds = (*HOUSE_STYLES, *_GROUND, *_UNIQUE, *KINDS, *SPECIES, "face", *_SHARED)
            raise UnknownName("kind of street object", kind, kinds) from None


_GROUND: dict[str, Callable[[Placement, StreetLines], Bag]] = {
    "carriageway": road.build_carriageway,
    "left": road.build_footway,
    "right": road.build_footway,
    "side-road": road.build_side_road,
    "cross-footway": road.build_cross_footway,
    "outskirts": lambda _, lines: road.build_outskirts(lines),
}

_UNIQUE: dict[str, Callable[[Placement], Bag]] = {
    "garden": road.build_garden,
    "hedge": furniture.hedge,
    "planter": furniture.planter,
    "cabinet": amenities.cabinet,
    "guard-rail": amenities.guard_rail,
    "railing": lambda placement: furniture.iron_railing(placement.size[0]),
    "low": lambda placement: furniture.low_wall(placement.size[0]),
    "bins": lambda placement: furniture.bins(placement.seed),
    "cross-road": road.build_cross_road,
    "side-footway": road.build_side_footway,
    "sweep": swept.build_sweep,
    "slab": swept.build_slab,
    "crash-barrier": roadside.crash_barrier,
    "tufts": roadside.tufts,
    "board": roadside.board,
    "signals": signals.heads,
}

_SHARED: dict[str, Callable[[], Bag]] = {
    "lamp": furniture.lamp_post,
    "post": furniture.post,
    "signal-post": lambda: furniture.post(3.4, 0.055),
    "bollard": furniture.bollard,
    "signal": furniture.signal,
    "bench": amenities.bench,
    "litter-bin": amenities.litter_bin,
    "stand": amenities.bicycle_stand,
    "shelter": amenities.shelter,
    "stop-flag": amenities.stop_flag,
    "column": amenities.advertising_column,
    "pit": amenities.tree_pit,
    "mast": amenities.mast,
    "delineator": roadside.delineator,
    "trolleys": roadside.trolley_shelter,
    "warning-triangle": roadside.warning_triangle,
}
