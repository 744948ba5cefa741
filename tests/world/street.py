"""A street drawn with numpy from an assignment: a pinhole camera, a road, houses, a parked car, a lamp post, two persons."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON, instance_id
from valerie.rendering.base import GroundTruth, Layer, LinearImage, PersonTruth, Rectangle, TruthLayer, View, bounds

ROAD, SIDEWALK, BUILDING, POLE, VEGETATION, SKY, CAR = 7, 8, 11, 17, 21, 23, 26
_COLORS = {
    ROAD: (0.16, 0.16, 0.17), SIDEWALK: (0.36, 0.34, 0.32), BUILDING: (0.42, 0.30, 0.22), POLE: (0.12, 0.12, 0.13),
    VEGETATION: (0.10, 0.20, 0.06), SKY: (0.55, 0.72, 1.1), CAR: (0.30, 0.05, 0.06),
}  # fmt: skip
_SHIRTS = {
    "red-coat": (0.6, 0.05, 0.05), "blue-coat": (0.05, 0.05, 0.6),
    "yellow-shirt": (0.75, 0.55, 0.05), "black-outfit": (0.02, 0.02, 0.025),
}  # fmt: skip
_SKIN, _TROUSERS = (0.45, 0.28, 0.2), (0.05, 0.06, 0.12)
_HEIGHT_M = 1.75


@dataclass(frozen=True)
class Person:
    """One person as the camera sees it."""

    number: int
    character: str
    distance_m: float
    depth_m: float
    mask: NDArray[np.bool_]
    padded_pixels: int


class Eye:
    """Projects points of the world for one camera of the asset."""

    def __init__(self, values: Mapping[str, Any], view: View) -> None:
        base = f"scene.{view.camera}"
        self.place = tuple(values[f"{base}.pos.{axis}"] for axis in "xyz")
        yaw = math.radians(values[f"{base}.yaw"])
        self._forward, self._right = (-math.sin(yaw), math.cos(yaw)), (math.cos(yaw), math.sin(yaw))
        self.view = view
        self.focal = values[f"{base}.focal_length_mm"] / 36.0 * view.width

    def project(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Column, row and depth of a point in metres."""
        dx, dy, dz = x - self.place[0], y - self.place[1], z - self.place[2]
        depth = max(dx * self._forward[0] + dy * self._forward[1], 0.1)
        right = dx * self._right[0] + dy * self._right[1]
        return (
            self.view.width / 2 + self.focal * right / depth,
            self.view.height / 2 - self.focal * dz / depth,
            depth,
        )

    def distance(self, x: float, y: float) -> float:
        """From the optical centre to the ground at (x, y)."""
        return math.dist(self.place, (x, y, 0.0))


class Street:
    """One variant seen by one camera."""

    def __init__(self, values: Mapping[str, Any], view: View) -> None:
        self._values, self._view, self._eye = values, view, Eye(values, view)
        self._rows, self._columns = np.mgrid[0 : view.height, 0 : view.width].astype(np.float32)

    def background(self) -> LinearImage:
        """The linear image without persons."""
        classes = self._classes()
        sun = 0.35 + 0.65 * math.sin(math.radians(self._values["scene.sun-1.elevation"]))
        pixels = np.zeros((*classes.shape, 3), np.float32)
        for label, color in _COLORS.items():
            pixels[classes == label] = color
        noise = np.random.default_rng(5).normal(1.0, 0.06, classes.shape).astype(np.float32)
        haze = 1.0 - 0.35 * np.abs(self._rows / self._view.height - 0.5)
        return LinearImage((pixels * (noise * haze * sun)[..., None]).astype(np.float16))

    def layer(self) -> Layer:
        """The part that the persons change."""
        pixels = self.background().pixels.copy()
        hidden = self._occluders()
        changed = np.zeros(pixels.shape[:2], np.bool_)
        for person in self.persons():
            visible = person.mask & ~hidden
            changed |= visible
            rows = np.flatnonzero(person.mask.any(axis=1))
            if rows.size:
                share = (self._rows - rows[0]) / max(rows[-1] - rows[0], 1)
                for low, high, color in (
                    (-1.0, 0.16, _SKIN),
                    (0.16, 0.55, _SHIRTS[person.character]),
                    (0.55, 2.0, _TROUSERS),
                ):
                    pixels[visible & (share >= low) & (share < high)] = color
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        if not rows.size:
            return Layer(Rectangle(0, 0, 0, 0), np.zeros((0, 0, 3), np.float16))
        box = Rectangle(int(columns[0]), int(rows[0]), int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1)
        return Layer(box, np.ascontiguousarray(pixels[box.slices]))

    def statics(self) -> GroundTruth:
        """Classes and depth without persons."""
        classes = self._classes()
        depth = np.where(classes == SKY, np.inf, 30.0).astype(np.float32)
        return GroundTruth(classes, np.zeros(classes.shape, np.uint16), depth, ())

    def truth(self) -> GroundTruth:
        """Classes, instances and depth."""
        statics, hidden = self.statics(), self._occluders()
        classes, instances, depth = statics.class_map.copy(), statics.instance_map.copy(), statics.depth.copy()
        persons = self.persons()
        for person in sorted(persons, key=lambda one: -one.depth_m):
            visible = person.mask & ~hidden
            classes[visible], instances[visible], depth[visible] = (
                PERSON.id,
                instance_id(PERSON, person.number),
                person.depth_m,
            )
        return GroundTruth(
            classes,
            instances,
            depth,
            tuple(PersonTruth.of(instance_id(PERSON, p.number), p.mask, p.padded_pixels) for p in persons),
        )

    def truth_layer(self) -> TruthLayer:
        """The part of the truth that the persons change."""
        truth = self.truth()
        changed = truth.instance_map > 0
        box = bounds(changed)
        mask = changed[box.slices]
        values = (one[box.slices][mask] for one in (truth.class_map, truth.instance_map, truth.depth))
        return TruthLayer(box, mask, *values, truth.persons, changed.shape)

    def persons(self) -> list[Person]:
        """All that are present, whether the image shows them or not."""
        hits = []
        for number in (1, 2):
            path = f"scene.person-{number}"
            character = self._values[f"{path}.character"]
            if character == "absent":
                continue
            x, y = self._values[f"{path}.pos.x"], self._values[f"{path}.pos.y"]
            mask, padded = self._body(x, y)
            depth = self._eye.project(x, y, 0.0)[2]
            hits.append(Person(number, character, self._eye.distance(x, y), depth, mask, padded))
        return hits

    def _body(self, x: float, y: float) -> tuple[NDArray[np.bool_], int]:
        column, feet, _ = self._eye.project(x, y, 0.0)
        head = self._eye.project(x, y, _HEIGHT_M)[1]
        height = max(feet - head, 1.0)
        size = (self._view.height * 3, self._view.width * 3)  # padded by a whole image on each side
        rows, columns = np.mgrid[0 : size[0], 0 : size[1]].astype(np.float32)
        rows, columns = rows - self._view.height, columns - self._view.width
        share = (rows - head) / height
        across = np.abs(columns - column) / height
        skull = ((share - 0.07) / 0.07) ** 2 + (across / 0.05) ** 2 <= 1
        trunk = (share > 0.14) & (share < 0.55) & (across < 0.13 - 0.04 * share)
        legs = (share >= 0.55) & (share <= 1.0) & (across < 0.085) & (across > 0.012)
        body = skull | trunk | legs
        inside = body[self._view.height : 2 * self._view.height, self._view.width : 2 * self._view.width]
        return np.ascontiguousarray(inside), int(body.sum())

    def _classes(self) -> NDArray[np.uint8]:
        view, eye = self._view, self._eye
        horizon = view.height / 2
        classes = np.full((view.height, view.width), SKY, np.uint8)
        centre = eye.project(2.5, 60.0, 0.0)[0]
        away = np.abs(self._columns - centre) / view.width
        roofs = horizon - view.height * (0.08 + 0.6 * away + 0.03 * np.sin(self._columns / view.width * 40))
        classes[(self._rows > roofs) & (self._rows < horizon + 4)] = BUILDING
        classes[(self._rows > horizon - view.height * 0.09) & (self._rows < horizon) & (away > 0.16)] = VEGETATION
        below = self._rows >= horizon
        width = view.width * 0.02 + (self._rows - horizon) * 2.2
        classes[below] = SIDEWALK
        classes[below & (np.abs(self._columns - centre) < width)] = ROAD
        car, post = self._car(), self._post()
        classes[car], classes[post] = CAR, POLE
        return classes

    def _occluders(self) -> NDArray[np.bool_]:
        return self._car() | self._post()

    def _car(self) -> NDArray[np.bool_]:
        left, bottom, _ = self._eye.project(-0.6, 3.0, 0.0)
        right, top, _ = self._eye.project(1.2, 3.0, 1.3)
        inside: NDArray[np.bool_] = (
            (self._columns >= left) & (self._columns <= right) & (self._rows >= top) & (self._rows <= bottom)
        )
        return inside

    def _post(self) -> NDArray[np.bool_]:
        left, bottom, _ = self._eye.project(5.2, 2.0, 0.0)
        right, top, _ = self._eye.project(5.36, 2.0, 5.0)
        inside: NDArray[np.bool_] = (
            (self._columns >= left) & (self._columns <= right) & (self._rows >= top) & (self._rows <= bottom)
        )
        return inside
