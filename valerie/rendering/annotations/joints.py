"""Joints of persons and riders in world, camera and image coordinates, computed from scene and ground truth without a GPU."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON, RIDER
from valerie.rendering.base import GroundTruth, View
from valerie.rendering.projection import project, view_from_world
from valerie.rendering.scene_reading import DrawItem, camera_of, draw_items
from valerie.scene.graph.model import JOINTS, Camera, Scene, freeze

#: Visibility of a joint: outside the image or behind the camera; hidden by another object; hidden by the person's own body;
#: visible.
OUTSIDE, HIDDEN, SELF_HIDDEN, VISIBLE = 0, 1, 2, 3
#: Largest depth of a visible joint below the person's surface at its pixel, metres. It exceeds the flesh and clothes around a
#: shoulder, a hip or a head, but not the depth of a trunk.
DEPTH_WITHIN_M: Final = 0.2

#: Classes of human bodies.
_BODIES: Final = frozenset({PERSON.id, RIDER.id})

#: Pairs of joints that a limb connects, for drawings.
LIMBS: Final = tuple(
    (JOINTS.index(a), JOINTS.index(b))
    for a, b in (
        ("pelvis", "spine"), ("spine", "chest"), ("chest", "neck"), ("neck", "head"), ("head", "head_top"),
        *(
            (f"{side}_{a}" if a not in ("neck", "pelvis") else a, f"{side}_{b}")
            for side in ("left", "right")
            for a, b in (
                ("neck", "shoulder"), ("shoulder", "elbow"), ("elbow", "wrist"),
                ("pelvis", "hip"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "toes"),
            )
        ),
    )
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """The joints of every drawn person and rider, by ascending instance id: J = ``len(JOINTS)`` each, in the order of `JOINTS`.

    Attributes:
        instances: (N,) int64, label id × 1000 + n.
        known: (N,) uint8, 1 with a skeleton, 0 without one (the other arrays then hold NaN and `OUTSIDE`).
        places: (N, J, 3) float32, metres in the world.
        camera_places: (N, J, 3) float32, metres in the camera's frame (x right, y up, the camera looks along −z).
        pixels: (N, J, 2) float32, x and y in the image or beyond its border; NaN behind the camera.
        visibility: (N, J) uint8: `OUTSIDE`, `HIDDEN`, `SELF_HIDDEN` or `VISIBLE`.
    """

    instances: NDArray[np.int64]
    known: NDArray[np.uint8]
    places: NDArray[np.float32]
    camera_places: NDArray[np.float32]
    pixels: NDArray[np.float32]
    visibility: NDArray[np.uint8]

    def __post_init__(self) -> None:
        for name in self.__slots__:
            freeze(getattr(self, name))


def measure_joints(scene: Scene, view: View, truth: GroundTruth) -> Joints:
    """Return the joints of a scene's persons and riders as a camera sees them.

    Args:
        scene: the source of positions and poses.
        view: camera and image size.
        truth: ground truth of this scene and view; its depth decides which joints are hidden.

    Raises:
        UnknownName: the scene has no such camera.
    """
    camera = camera_of(scene, view)
    skeletons: dict[int, NDArray[np.float64] | None] = {}
    for item in (*draw_items(scene, movable=False), *draw_items(scene, movable=True)):
        if item.node.label_id in _BODIES and item.node.instance_id:
            skeletons.setdefault(item.node.instance_id, None)
            if (joints := _in_the_world(item)) is not None:
                skeletons[item.node.instance_id] = joints
    numbers = sorted(skeletons)
    places = np.full((len(numbers), len(JOINTS), 3), np.nan)
    for i, number in enumerate(numbers):
        if (skeleton := skeletons[number]) is not None:
            places[i] = skeleton
    to_camera = view_from_world(camera)
    pixels, depths = _pixels(places, camera, view)
    return Joints(
        instances=np.array(numbers, np.int64),
        known=np.isfinite(places).all(axis=(1, 2)).astype(np.uint8),
        places=places.astype(np.float32),
        camera_places=(places @ to_camera[:3, :3].T + to_camera[:3, 3]).astype(np.float32),
        pixels=pixels.astype(np.float32),
        visibility=np.array(
            [
                [_visibility(number, tuple(place), depth, truth) for place, depth in zip(row, along, strict=True)]
                for number, row, along in zip(numbers, pixels.tolist(), depths.tolist(), strict=True)
            ],
            np.uint8,
        ).reshape(len(numbers), len(JOINTS)),
    )


def _in_the_world(item: DrawItem) -> NDArray[np.float64] | None:
    """Return the joints of a drawn item, (J, 3) metres in the world, or None without a skeleton."""
    body = item.node.figure or item.node.skeleton
    return None if body is None else np.asarray(body.joints @ item.world[:3, :3].T + item.world[:3, 3], np.float64)


def _pixels(places: NDArray[np.float64], camera: Camera, view: View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (N, J, 2) pixels, NaN behind the camera, and (N, J) depths along the optical axis, metres."""
    with np.errstate(divide="ignore", invalid="ignore"):
        projected = project(places.reshape(-1, 3), camera, view.width, view.height)
    projected[~(projected[:, 2] >= camera.near), :2] = np.nan
    shape = places.shape[:2]
    return projected[:, :2].reshape(*shape, 2), projected[:, 2].reshape(shape)


def _visibility(number: int, place: tuple[float, float], depth: float, truth: GroundTruth) -> int:
    height, width = truth.class_map.shape
    x, y = place
    if not (math.isfinite(x) and 0 <= x < width and 0 <= y < height):
        return OUTSIDE
    pixel = int(y), int(x)
    surface = float(truth.depth[pixel])
    if truth.instance_map[pixel] == number:
        return VISIBLE if surface >= depth - DEPTH_WITHIN_M else SELF_HIDDEN
    return HIDDEN if surface < depth else VISIBLE
