"""Head and tail lamps of a built vehicle: places, strengths, and glowing lenses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urban_street.vehicles.content import Place, VehicleContent
from valerie.scene.graph.model import Light, Matrix
from valerie.scene.graph.transforms import Pose

WHITE: Final = "vehicle-lamp-white"
RED: Final = "vehicle-lamp-red"
#: Materials of lenses that glow. Each vehicle has its own.
GLOWING: Final = frozenset({WHITE, RED})

#: Distance of the light in front of its lens, metres.
_BEFORE: Final = 0.06
#: A dipped beam. UN Regulation 112 requires at least 10,100 cd towards the road 75 m ahead, and at most 625 cd above the
#: cut-off.
_HEAD: Final = Light(
    color=(1.0, 0.90, 0.76), intensity=12_000.0, inner=math.radians(25.0), outer=math.radians(40.0), beam="dipped", radius=0.05,
    switch="car", luminance=300_000.0,
)  # fmt: skip
#: A rear position lamp. UN Regulation 7 allows 4 … 17 cd.
_TAIL: Final = Light(
    color=(1.0, 0.04, 0.01), intensity=8.0, outer=math.radians(80.0), radius=0.06, switch="car", luminance=1_500.0
)
#: Lamps of a bicycle, candela: 10 lx ten metres ahead (German StVZO, § 67), and a dim red lamp.
_BICYCLE: Final = {WHITE: 1_000.0, RED: 2.0}
#: The cut-off falls by 1 % of the distance (UN Regulation 48).
_DOWN_DEG: Final = math.degrees(math.atan(0.01))


class VehicleLamp(NamedTuple):
    """A lamp below the vehicle's node: name, (4, 4) to the vehicle, light."""

    name: str
    transform: Matrix
    light: Light


def vehicle_lamps(vehicle: VehicleContent, own_name: Callable[[str], str]) -> Iterator[VehicleLamp]:
    """Yield head lamps, then tail lamps, from left to right. A single lens gives one lamp in the middle.

    Args:
        vehicle: a built vehicle, facing +y.
        own_name: returns a material's name in the scene.
    """
    for name, material, light, heading in (("headlamp", WHITE, _HEAD, 0.0), ("tail-lamp", RED, _TAIL, 180.0)):
        forward = 1.0 if heading == 0.0 else -1.0
        strength = _BICYCLE[material] if vehicle.kind == "bicycle" else light.intensity
        own = replace(light, intensity=strength, glowing=(own_name(material),))
        places = lens_places(vehicle, material) if vehicle.lenses is None else vehicle.lenses[material]
        for number, (x, y, z) in enumerate(places, start=1):
            pitch = 360.0 - _DOWN_DEG if heading == 0.0 else 0.0
            transform = Pose((x, y + forward * _BEFORE, z), (pitch, 0.0, heading)).matrix()
            yield VehicleLamp(f"{name}-{number}", transform, own)


def lens_places(vehicle: VehicleContent, material: str) -> list[Place]:
    """Return the places of a material's lenses: the outermost along y, the middle in x and z."""
    points = [
        mesh.positions.astype(np.float64) @ part.transform[:3, :3].T + part.transform[:3, 3]
        for part in vehicle.parts
        for mesh in part.meshes
        if mesh.material == material
    ]
    if not points:
        return []
    all_points: NDArray[np.float64] = np.concatenate(points)
    # Lenses of one colour are at one end. Reflectors elsewhere do not count.
    end = all_points[np.sign(all_points[:, 1]) == (1.0 if material == WHITE else -1.0)]
    if not len(end):
        return []
    sides = [end[end[:, 0] < -0.15], end[end[:, 0] > 0.15]]
    places = [side for side in sides if len(side)] or [end]
    outermost = np.max if material == WHITE else np.min
    return [(float(side[:, 0].mean()), float(outermost(side[:, 1])), float(side[:, 2].mean())) for side in places]
