"""Plan and compose whole frames of a path tracer from a window around the pedestrian and a background.

A pixel of a render inside a border equals that of the whole render, bit for bit (tests/cycles). So the full render of a
frame is needed only where it can differ from a background of the same seed by more than noise: in a window, which consists of
the layer's rectangle and the margin that the denoiser reads (`denoised_window`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count as counted
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.parameters.definitions import Value
from valerie.rendering.base import LinearImage, Rectangle, View
from valerie.rendering.cycles.reach import denoised_window, reached_rectangle
from valerie.rendering.cycles.translation import Guided
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.graph.model import Scene
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply

_BRIGHTEST: Final = float(np.finfo(np.float16).max)
#: Places of pedestrians: metres across the street, and along it from the cameras' line.
_ACROSS_M: Final = (-2.0, 7.0)
_DISTANCE_M: Final = (16.0, 64.0)
_CAMERAS_AT_M: Final = -12.0
#: Number of consecutive frames in one group, since a background is the most expensive part.
_BLOCK: Final = 50


class Group(NamedTuple):
    """Frames that share a background."""

    name: str
    camera: str
    light: Mapping[str, Value]


GROUPS: Final = (
    Group("a", "camera-1", {}),
    Group("b", "camera-3", {"scene.sun-1.elevation": 25.0, "scene.sun-1.azimuth": 120.0}),
)


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """One pedestrian in front of one background.

    Attributes:
        index: number of the frame, from 0.
        rectangle: rectangle of the layer.
        window: rectangle of the full render.
    """

    index: int
    group: Group
    scene: Scene
    view: View
    rectangle: Rectangle
    window: Rectangle

    @property
    def core(self) -> Rectangle:
        """Return the layer's rectangle in pixels of the window."""
        inside = self.rectangle
        return Rectangle(inside.x - self.window.x, inside.y - self.window.y, inside.width, inside.height)

    @property
    def distance_m(self) -> float:
        """Return the distance from the optical centre to the pedestrian's origin on the ground."""
        feet = self.scene.world_transform("scene.person-1")[:3, 3]
        return float(np.linalg.norm(feet - self.scene.cameras[self.view.camera].position))


def planned(asset: SceneAsset, width: int, height: int, count: int, groups: Sequence[Group] = GROUPS) -> list[Planned]:
    """Return the first ``count`` frames: distances uniform in their logarithm, all outfits and headings, all groups.

    Places follow Roberts' low-discrepancy sequence (R₃; *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018), so
    that the first frames of any number are spread evenly. Illegal places (inside a car) and places out of view are skipped.
    """
    outfits = [name for name in asset.manifest.definition("scene.person-1.character").choices if name != "absent"]
    root = 1.2207440846057596  # solves x⁴ = x + 1
    steps = np.array([1 / root, 1 / root**2, 1 / root**3])
    frames: list[Planned] = []
    for number in counted():
        if len(frames) == count:
            return frames
        across, along, turn = (0.5 + number * steps) % 1
        near, far = _DISTANCE_M
        values: dict[str, Value] = {
            "scene.person-1.pos.x": round(float(_ACROSS_M[0] + across * (_ACROSS_M[1] - _ACROSS_M[0])), 2),
            "scene.person-1.pos.y": round(float(near * (far / near) ** along) + _CAMERAS_AT_M, 2),
            "scene.person-1.heading": round(360.0 * float(turn), 1),
            "scene.person-1.character": outfits[number % len(outfits)],
        }
        group = groups[len(frames) // _BLOCK % len(groups)]
        if rejection_reason(values, asset.manifest) is not None:
            continue
        scene, view = apply({**group.light, **values}, asset), View(group.camera, width, height)
        rectangle = reached_rectangle(scene, view)
        if not rectangle.empty:
            frames.append(Planned(len(frames), group, scene, view, rectangle, denoised_window(rectangle, view)))
    raise AssertionError("numbers do not end")


def put(window: Guided, at: Rectangle, background: Guided) -> Guided:
    """Return the whole frame: the background with the window inserted."""
    whole = [layer.copy() for layer in background]
    for layer, part in zip(whole, window, strict=True):
        layer[at.slices] = part
    return Guided(*whole)


def cut(frame: Guided, part: Rectangle) -> Guided:
    return Guided(*(np.ascontiguousarray(layer[part.slices]) for layer in frame))


def mean(first: Guided, second: Guided) -> Guided:
    """Return the mean of renders with two seeds, which is equivalent to one with twice the samples."""
    return Guided(*((a + b) / np.float32(2) for a, b in zip(first, second, strict=True)))


def linear(pixels: NDArray[np.float32]) -> LinearImage:
    """Return pixels in the engine's output format."""
    return LinearImage(np.clip(pixels, 0.0, _BRIGHTEST).astype(np.float16))
