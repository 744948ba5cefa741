"""The index of vehicles: parts, materials and lenses of each kind, so that a street knows them without building shapes.

``make vehicles`` writes it anew after a change of a vehicle.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

from urban_street.vehicles.content import Place, VehicleContent
from urban_street.vehicles.lamps import GLOWING, lens_places
from valerie.scene.graph.paints import is_paint

FILE: Final = Path(__file__).with_name("index.json")


class IndexedPart(NamedTuple):
    """One part: see `urban_street.vehicles.content.VehiclePart`. The vehicle's own paint is called ``paint``."""

    name: str
    origin: Place
    moves: str
    materials: tuple[str, ...]


class IndexEntry(NamedTuple):
    """The parts of a kind, and the places of its glowing lenses by material."""

    parts: tuple[IndexedPart, ...]
    lenses: dict[str, tuple[Place, ...]]


@lru_cache(maxsize=1)
def read_index() -> dict[str, IndexEntry]:
    """Return the entries by kind."""
    return {
        kind: IndexEntry(
            tuple(
                IndexedPart(name, _place(origin), moves, tuple(used)) for name, origin, moves, used in entry["parts"]
            ),
            {material: tuple(map(_place, places)) for material, places in entry["lenses"].items()},
        )
        for kind, entry in json.loads(FILE.read_text()).items()
    }


def _place(values: list[float]) -> Place:
    x, y, z = values
    return x, y, z


def index_entry(vehicle: VehicleContent) -> IndexEntry:
    """Return the entry of a built vehicle."""
    parts = [
        IndexedPart(
            part.name,
            _place(part.transform[:3, 3].tolist()),
            part.moves,
            tuple("paint" if is_paint(mesh.material) else mesh.material for mesh in part.meshes),
        )
        for part in vehicle.parts
    ]
    return IndexEntry(tuple(parts), {material: tuple(lens_places(vehicle, material)) for material in sorted(GLOWING)})
