"""The content of a built vehicle: parts with their own frames, materials, textures, and its outline on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urban_street.solids.surfaces import Bag
from valerie.scene.graph.model import Material, Matrix, Mesh, Texture

Polygon = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class RawPart:
    """A part before it has meshes: its surfaces in the vehicle's frame, and its own origin."""

    name: str
    bag: Bag
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moves: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class VehiclePart:
    """One node below the vehicle's own.

    Attributes:
        name: as in a path: ``body``, ``door-1``, ``wheel-2``.
        transform: (4, 4) part to vehicle: a door's origin is on its hinge, a wheel's on its axle.
        meshes: one per material, in the part's frame.
        moves: the rotation that is the part's own: ``rot.z`` of a door, ``rot.x`` of a wheel; empty if it is fixed.
        joints: (len(JOINTS), 3) of a human body, metres in the part's frame; None for other parts.
    """

    name: str
    transform: Matrix
    meshes: tuple[Mesh, ...]
    moves: str = ""
    joints: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class VehicleContent:
    """One vehicle in its own frame: origin on the road in the middle, facing +y, z up, metres.

    Attributes:
        kind: e.g. ``hatchback``.
        object_class: the Cityscapes class as in node names: ``car``, ``truck``, ``bus``, ``motorcycle``, ``bicycle``,
            ``rider``.
        parts: parents are the vehicle's node itself.
        materials, textures: by name; names without the vehicle's own prefix are shared by all vehicles.
        footprint: (x, y) corners of the ground that it takes, counter-clockwise.
        height_m: from the road to the highest point.
    """

    kind: str
    object_class: str
    parts: tuple[VehiclePart, ...]
    materials: dict[str, Material]
    textures: dict[str, Texture]
    footprint: Polygon
    height_m: float

    @property
    def triangles(self) -> int:
        """Return the number of triangles of all parts."""
        return sum(len(mesh.faces) for part in self.parts for mesh in part.meshes)


def footprint_of(length: float, width: float) -> Polygon:
    """Return a rectangle with cut corners around the origin, counter-clockwise."""
    x, y = 0.5 * width, 0.5 * length
    u, v = 0.22 * width, 0.09 * length
    corners = [(x, v - y), (x, y - v), (x - u, y), (u - x, y), (-x, y - v), (-x, v - y), (u - x, -y), (x - u, -y)]
    return tuple((round(a, 4), round(b, 4)) for a, b in corners)
