"""Visibility of each person in a frame: areas, occlusion, truncation, distance, boxes. Uses no GPU."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON
from valerie.rendering.base import GroundTruth, PersonTruth, Rectangle, View, bounds
from valerie.rendering.scene_reading import instance_roots
from valerie.scene.graph.model import Camera, Node, Scene

#: Reasons why a person has no visible pixel.
ABSENT: Final = "absent"
OUTSIDE: Final = "outside the image"
HIDDEN: Final = "fully hidden"


@dataclass(frozen=True, slots=True)
class Visibility:
    """The visibility of one person in one frame.

    Attributes:
        instance_id: label id × 1000 + n.
        pixel_area: number of visible pixels.
        pixel_area_percent: the same as a share of the image, 0 … 100.
        pixel_area_amodal: number of pixels, within the image, of the person rendered alone.
        occlusion_rate: 1 − pixel_area / pixel_area_amodal, 0 … 1: the share that other objects hide; 1 if fully hidden, None
            if the amodal area is 0.
        truncation_rate: share of the person's pixels on a canvas padded by half an image on each side that lie beyond the image's
            border, 0 … 1; None if the person has no pixel on the padded canvas.
        distance_m: Euclidean distance from the optical centre to the person's ground origin; None if absent.
        depth_m: depth of that origin along the optical axis, negative behind the camera; None if absent.
        bearing_deg: angle from the optical axis to that origin in the plane of the axis and the image's x, −180 … 180,
            positive to the right; None if absent.
        aspect_deg: angle, seen from above, from the direction to the camera to the person's heading, −180 … 180. At 0 the person
            faces the camera, at ±180 it shows its back, at 90 its right side, at −90 its left; None if absent.
        box, amodal_box: rectangles around the visible and around the amodal pixels; None if there are none.
        undefined_reason: None if a pixel is visible, else ``absent``, ``outside the image`` or ``fully hidden``.
    """

    instance_id: int
    pixel_area: int = 0
    pixel_area_percent: float = 0.0
    pixel_area_amodal: int = 0
    occlusion_rate: float | None = None
    truncation_rate: float | None = None
    distance_m: float | None = None
    depth_m: float | None = None
    bearing_deg: float | None = None
    aspect_deg: float | None = None
    box: Rectangle | None = None
    amodal_box: Rectangle | None = None
    undefined_reason: str | None = None


def measure(truth: GroundTruth, scene: Scene, view: View) -> tuple[Visibility, ...]:
    """Return the visibility of every person in the scene, by ascending instance id.

    Persons of the scene graph that are not drawn (an unchosen character, an absent person) are ``absent``.

    Args:
        truth: ground truth of this scene and view.
        scene: the source of positions and of the persons that are absent.
        view: its camera is the origin of distances and angles.
    """
    camera = scene.cameras[view.camera]
    persons = {person.instance_id: person for person in truth.persons}
    roots = person_roots(scene)
    return tuple(
        _present(persons[number], truth, scene, roots, camera) if number in persons else _absent(number)
        for number in sorted({*roots, *persons})
    )


def person_roots(scene: Scene) -> Mapping[int, Node]:
    """Return the topmost node of each person by instance id. Its position is the person's ground origin."""
    return {number: root for number, root in instance_roots(scene).items() if root.label_id == PERSON.id}


def _absent(instance_id: int) -> Visibility:
    return Visibility(instance_id, undefined_reason=ABSENT)


def _present(
    person: PersonTruth, truth: GroundTruth, scene: Scene, roots: Mapping[int, Node], camera: Camera
) -> Visibility:
    visibility = measure_pixels(person, truth)
    root = roots.get(person.instance_id)
    if root is None:
        return visibility
    world = scene.world_transform(root.path)
    offset = world[:3, 3] - camera.position
    axes = camera.transform[:3, :3] / np.linalg.norm(camera.transform[:3, :3], axis=0)
    depth, right = -float(offset @ axes[:, 2]), float(offset @ axes[:, 0])
    return replace(
        visibility,
        distance_m=float(np.linalg.norm(offset)),
        depth_m=depth,
        bearing_deg=math.degrees(math.atan2(right, depth)),
        aspect_deg=_turn_deg(world[:2, 1], -offset[:2]),
    )


def _turn_deg(direction: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """Return the angle on the ground from ``reference`` to ``direction``, −180 … 180, counter-clockwise from above."""
    across = float(reference[0] * direction[1] - reference[1] * direction[0])
    return math.degrees(math.atan2(across, float(direction @ reference)))


def measure_pixels(person: PersonTruth, truth: GroundTruth) -> Visibility:
    """Return the part of a person's visibility that pixels determine, without distances and angles.

    Args:
        person: a person of ``truth``.
        truth: ground truth of the image.
    """
    # Visible pixels belong to the amodal mask, so they all lie inside its box.
    visible = truth.instance_map[person.box.slices] == person.instance_id
    area, amodal = int(np.count_nonzero(visible)), int(np.count_nonzero(person.mask))
    reason = None
    if area == 0:
        reason = HIDDEN if amodal else OUTSIDE
    box = bounds(visible)
    return Visibility(
        instance_id=person.instance_id,
        pixel_area=area,
        pixel_area_percent=100.0 * area / truth.instance_map.size,
        pixel_area_amodal=amodal,
        occlusion_rate=1.0 - area / amodal if amodal else None,
        truncation_rate=1.0 - amodal / person.padded_pixels if person.padded_pixels else None,
        box=None if box.empty else Rectangle(person.box.x + box.x, person.box.y + box.y, box.width, box.height),
        amodal_box=None if person.box.empty else person.box,
        undefined_reason=reason,
    )
