"""Vehicles by name: `build_vehicle`."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial
from typing import Final

import numpy as np

from urban_street.solids.surfaces import Bag
from urban_street.vehicles import bicycle, bus, motorcycle, truck
from urban_street.vehicles.bodies import CARS
from urban_street.vehicles.cars import build_body, build_wheels
from urban_street.vehicles.content import Polygon, RawPart, VehicleContent, VehiclePart, footprint_of
from urban_street.vehicles.designs import HATCHBACK
from urban_street.vehicles.details import PLATES
from urban_street.vehicles.index import read_index
from urban_street.vehicles.materials import common_materials, paint, plates
from urban_street.vehicles.paints import ALL_PAINTS, FREQUENCIES, PAINTS, Color
from valerie.errors import InvalidInput, UnknownName
from valerie.scene.graph.deferred import DeferredMesh
from valerie.scene.graph.model import Material, Mesh, freeze
from valerie.scene.graph.paints import PAINT_PREFIX

#: Kind to Cityscapes class, as in node names. A van is a car.
KINDS: Final[dict[str, str]] = {
    **dict.fromkeys(CARS, "car"),
    **dict.fromkeys(("truck", "box-truck", "flatbed-truck"), "truck"),
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
}
#: Length, width and height of vehicles without a `CarDesign`, metres.
_SIZES: Final = {
    **dict.fromkeys(("truck", "box-truck"), (truck.LENGTH, truck.WIDTH, truck.HEIGHT)),
    "flatbed-truck": (truck.LENGTH, truck.WIDTH, truck.FLAT_HEIGHT),
    "bus": (bus.LENGTH, bus.WIDTH, bus.HEIGHT),
    "motorcycle": (2.10, 0.86, 1.27),
    "bicycle": (1.84, 0.66, 1.08),
}


def build_vehicle(
    kind: str, seed: int = 0, colour: str | Color | None = None, *, lights: float = 0.0, fine: bool = True
) -> VehicleContent:
    """Build one vehicle. Equal arguments give equal bytes, and equal shapes share their arrays.

    Args:
        kind: one of `KINDS`.
        seed: determines rim, number plate and, without ``colour``, paint; 0 is a valid seed.
        colour: a name of `ALL_PAINTS`, a linear RGB reflectance in [0, 1], or None.
        fine: False for a car seen from more than about 40 m, with a third of the triangles.
        lights: brightness of the lamps, 0 off … 1 full.

    Raises:
        UnknownName: there is no such kind or paint.
        InvalidInput: a colour or the brightness is out of range.
    """
    if kind not in KINDS:
        raise UnknownName("kind of vehicle", kind, KINDS)
    if not 0.0 <= lights <= 1.0:
        raise InvalidInput("brightness out of range", field="lights", value=lights, limit="0…1")
    coat = _paint(colour if colour is not None else picked_paint(kind, seed))
    rim, plate = _picked(kind, seed)
    model = _body(kind, fine) + (_wheels(kind, rim, fine) if kind in CARS else ())
    parts = tuple(
        replace(part, meshes=tuple(_finished(mesh, coat.name, plate) for mesh in part.meshes)) for part in model
    )
    return _content(kind, parts, coat, lights)


def outline_vehicle(kind: str, seed: int = 0, colour: str | Color | None = None) -> VehicleContent:
    """Return the vehicle of `build_vehicle`, whose shapes are computed when they are first read.

    Its parts, materials and lenses are those of `urban_street.vehicles.index`.

    Raises:
        UnknownName, InvalidInput: see `build_vehicle`.
    """
    if kind not in KINDS:
        raise UnknownName("kind of vehicle", kind, KINDS)
    coat = _paint(colour if colour is not None else picked_paint(kind, seed))
    entry = read_index()[kind]
    parts = []
    for number, part in enumerate(entry.parts):
        there = np.eye(4)
        there[:3, 3] = part.origin
        meshes = tuple(
            DeferredMesh(partial(_mesh, kind, seed, colour, (number, k)), coat.name if name == "paint" else name)
            for k, name in enumerate(part.materials)
        )
        parts.append(VehiclePart(part.name, there, meshes, part.moves))
    return replace(_content(kind, tuple(parts), coat, 0.0), lenses=entry.lenses)


def _mesh(kind: str, seed: int, colour: str | Color | None, place: tuple[int, int]) -> Mesh:
    """Return one mesh of a built vehicle by the numbers of its part and material."""
    return _built(kind, seed, colour).parts[place[0]].meshes[place[1]]


@lru_cache(maxsize=8)
def _built(kind: str, seed: int, colour: str | Color | None) -> VehicleContent:
    return build_vehicle(kind, seed, colour)


def _picked(kind: str, seed: int) -> tuple[str, int]:
    """Return the design of the rims and the number of the plate that a seed chooses."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, *kind.encode(), 1]))
    return str(rng.choice(CARS[kind].rims if kind in CARS else HATCHBACK.rims)), int(rng.integers(PLATES))


def _content(kind: str, parts: tuple[VehiclePart, ...], coat: Material, lights: float) -> VehicleContent:
    """Return the parts with the materials and textures that they use."""
    names = {mesh.material for part in parts for mesh in part.meshes}
    materials = {name: m for name, m in {**common_materials(lights), coat.name: coat}.items() if name in names}
    images = {material.base_color_texture for material in materials.values()}
    textures = {texture.name: texture for texture in (plates(),) if texture.name in images}
    return VehicleContent(kind, KINDS[kind], parts, materials, textures, size_of(kind)[0])


def picked_paint(kind: str, seed: int) -> str:
    """Return the name of a vehicle's default paint."""
    weights = np.array(FREQUENCIES)
    rng = np.random.default_rng(np.random.SeedSequence([seed, *kind.encode()]))
    return str(rng.choice(list(PAINTS), p=weights / weights.sum()))


def vehicle_seed(seed: int, variant: int) -> int:
    """Return the seed of the vehicle for a variant number and the seed of a scene."""
    return int(np.random.SeedSequence([seed, variant, 7003]).generate_state(1)[0])


def size_of(kind: str) -> tuple[Polygon, float]:
    """Return footprint and height of a kind, without building it.

    Raises:
        UnknownName: no such kind.
    """
    length, width, height = dimensions(kind)
    return footprint_of(length, width), height


def dimensions(kind: str) -> tuple[float, float, float]:
    """Return length, width (without mirrors) and height in metres.

    Raises:
        UnknownName: no such kind.
    """
    if kind in CARS:
        return CARS[kind].size
    if kind not in _SIZES:
        raise UnknownName("kind of vehicle", kind, KINDS)
    return _SIZES[kind]


@lru_cache(maxsize=2 * len(KINDS))
def _body(kind: str, fine: bool) -> tuple[VehiclePart, ...]:
    """Return the parts that do not depend on the seed, painted in ``paint``, with plate number 0."""
    if kind in CARS:
        raw = build_body(CARS[kind], fine=fine)
    else:
        builders = {
            "truck": truck.build_truck,
            "box-truck": truck.build_box_truck,
            "flatbed-truck": truck.build_flatbed_truck,
            "bus": bus.build_bus,
            "motorcycle": motorcycle.build_motorcycle,
            "bicycle": bicycle.build_bicycle,
        }
        raw = builders[kind]()
    return tuple(_placed(part) for part in raw)


@lru_cache(maxsize=12 * len(CARS))
def _wheels(kind: str, rim: str, fine: bool) -> tuple[VehiclePart, ...]:
    return tuple(_placed(part) for part in build_wheels(CARS[kind], rim, fine=fine))


def _paint(colour: str | Color) -> Material:
    if isinstance(colour, str):
        if colour not in ALL_PAINTS:
            raise UnknownName("paint", colour, ALL_PAINTS)
        chosen = ALL_PAINTS[colour]
        coat = paint(f"{PAINT_PREFIX}{colour}", chosen.base_color, chosen.metallic)
        return replace(coat, roughness=chosen.roughness)
    if not all(0.0 <= value <= 1.0 for value in colour):
        raise InvalidInput("colour out of range", field="colour", value=colour, limit="0…1")
    tag = "-".join(f"{round(10_000 * value):05d}" for value in colour)
    return paint(f"{PAINT_PREFIX}{tag}", colour, 0.25)


def _finished(mesh: Mesh, coat: str, plate: int) -> Mesh:
    """Return a mesh of the model with this vehicle's paint and number plate."""
    if mesh.material == "paint":
        return replace(mesh, material=coat)
    if mesh.material == "vehicle-plate":
        return replace(mesh, uvs=freeze(mesh.uvs + np.array([0.0, plate / PLATES], np.float32)))
    return mesh


def _placed(part: RawPart) -> VehiclePart:
    """Return the part in its own frame."""
    back, there = np.eye(4), np.eye(4)
    back[:3, 3] = -np.asarray(part.origin)
    there[:3, 3] = part.origin
    local = Bag()
    local.merge(part.bag, back)
    return VehiclePart(part.name, there, local.meshes(), part.moves)
