"""A few labelled frames made by hand: road, sky, a car, a bicycle without instance, two persons, one half hidden."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from valerie.datasets.frame import FrameName, LabelledFrame

ROAD, SIDEWALK, SKY, PERSON, CAR, BICYCLE, STATIC = 7, 8, 23, 24, 26, 33, 4


def labelled(number: int = 0, *, height: int = 24, width: int = 40, city: str = "testtown") -> LabelledFrame:
    """Frame ``number``: the persons stand a little further to the right in each."""
    class_map = np.full((height, width), ROAD, np.uint8)
    class_map[: height // 3] = SKY
    class_map[height // 3 : height // 3 + 3] = SIDEWALK
    class_map[-2:, :4] = STATIC
    class_map[-4:-2, -6:] = BICYCLE
    instance_map = np.zeros((height, width), np.uint16)
    first, second = box(height, width, 6 + number, 6), box(height, width, 20 + number, 12)
    car = box(height, width, 23 + number, 6, top=12)
    for mask, label, instance in ((first, PERSON, 24_001), (second, PERSON, 24_002), (car, CAR, 26_001)):
        class_map[mask], instance_map[mask] = label, instance
    picture = np.random.default_rng(number).integers(0, 256, (height, width, 3), np.uint8)
    return LabelledFrame(
        FrameName.of(city, number, 0),
        picture,
        class_map,
        instance_map,
        camera={"intrinsic": {"fx": 50.0}},
        amodal={24_001: first, 24_002: second},
        persons={24_002: {"occlusion_rate": 0.25}},
    )


def box(height: int, width: int, left: int, across: int, *, top: int = 9) -> NDArray[np.bool_]:
    mask = np.zeros((height, width), np.bool_)
    mask[top : height - 3, left : left + across // 2] = True
    return mask
