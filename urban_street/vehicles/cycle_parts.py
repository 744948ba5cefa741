"""Common parts of bicycles and motorcycles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from urban_street.solids.surfaces import Bag, Floats

#: Transform from the z axis of a surface of revolution to x.
AXLE: Final = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Wheel:
    bag: Bag

    def moved_to(self, axle: Floats) -> Bag:
        where = np.eye(4)
        where[:3, 3] = axle
        moved = Bag()
        moved.merge(self.bag, where)
        return moved


def arc(centre: Floats, radius: float, low: float, high: float, count: int) -> Floats:
    angle = np.radians(np.linspace(low, high, count))
    return np.stack([np.zeros(count), centre[1] + radius * np.cos(angle), centre[2] + radius * np.sin(angle)], -1)
