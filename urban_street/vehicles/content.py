"""The content of a built vehicle: parts in their own frames, materials, textures, and the footprint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from urban_street.solids.surfaces import Bag
from valerie.scene.graph.model import Material, Matrix, Mesh, Skeleton, Texture

Polygon = tuple[tuple[float, float], ...]
Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class RawPart:
    """A part without meshes: its surfaces in the vehicle's frame, and its origin."""

    name: str
    bag: Bag
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moves: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class VehiclePart:
    """One node below the vehicle's node.

    Attributes:
        name: name in a path: ``body``, ``door-1``, ``wheel-2``.
        transform: (4, 4), part to vehicle. A door's origin is on its hinge, a wheel's on its axle.
        meshes: one mesh per material, in the part's frame.
        moves: the rotation of the part: ``rot.z`` for a door, ``rot.x`` for a wheel; empty for a fixed part.
        skeleton: the joints of a human body, in the part's frame; None for other parts.
    """

    name: str
    transform: Matrix
    meshes: tuple[Mesh, ...]
    moves: str = ""
    skeleton: Skeleton | None = None


@dataclass(frozen=True, slots=True, eq=False)
class VehicleContent:
    """One vehicle in its own frame: origin in its middle on the road, facing +y, z up, metres.

    Attributes:
        kind: e.g. ``hatchback``.
        object_class: the Cityscapes class as in node names: ``car``, ``truck``, ``bus``, ``motorcycle``, ``bicycle``,
            ``rider``.
        parts: parts, whose parent is the vehicle's node.
        materials, textures: materials and textures by name. Those without the vehicle's prefix are shared by all vehicles.
        footprint: (x, y) corners of the ground that it occupies, counter-clockwise.
        lenses: places of the lenses by material, if they are known before the shapes; else None.
    """

    kind: str
    object_class: str
    parts: tuple[VehiclePart, ...]
    materials: dict[str, Material]
    textures: dict[str, Texture]
    footprint: Polygon
    lenses: Mapping[str, tuple[Place, ...]] | None = None

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
