"""How well each person is seen in a frame: areas, occlusion, truncation, distance, boxes. Pure numpy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON
from valerie.rendering.base import GroundTruth, PersonTruth, View, bounds
from valerie.rendering.scene_reading import instance_roots
from valerie.scene.graph.model import Camera, Node, Scene

#: Raised by hand whenever a column's meaning changes.
REVISION: Final = 1

#: Why a person has no visible pixel.
ABSENT: Final = "absent"
OUTSIDE: Final = "outside the image"
HIDDEN: Final = "fully hidden"

Box = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class Visibility:
    """One person in one frame.

    Attributes:
        instance_id: label id × 1000 + n.
        pixel_area: visible pixels.
        pixel_area_percent: the same, of all pixels of the image, 0 … 100.
        pixel_area_amodal: pixels of the person rendered alone, within the image.
        occlusion_rate: 1 − pixel_area / pixel_area_amodal, by other objects only, 0 … 1; 1 when fully hidden; None when the
            amodal area is 0.
        truncation_rate: share of the whole person (on a canvas padded by half an image on each side) that lies beyond the
            image's border, 0 … 1; None when nothing of it is on the padded canvas.
        distance_m: from the optical centre to the person's ground origin, Euclidean; None when absent.
        depth_m: of that origin along the optical axis, negative behind the camera; None when absent.
        bearing_deg: angle from the optical axis to that origin in the plane of the axis and the image's x, −180 … 180,
            positive to the right; None when absent.
        aspect_deg: how the person is turned to the camera, seen from above: heading less the direction from its origin to
            the camera, −180 … 180. 0 faces the camera, ±180 shows the back, 90 the right side, −90 the left; None when absent.
        box, amodal_box: (x, y, width, height) of the visible and of the amodal pixels; None when there are none.
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
    box: Box | None = None
    amodal_box: Box | None = None
    undefined_reason: str | None = None


def measure(truth: GroundTruth, scene: Scene, view: View) -> tuple[Visibility, ...]:
    """Visibility of every person that the scene names, by ascending instance id.

    Persons of the scene graph that are not drawn (an unchosen character, an absent person) are reported as ``absent``.

    Args:
        truth: of this scene and view.
        scene: for positions and for the persons that are absent.
        view: whose camera distances are measured from.
    """
    camera = scene.cameras[view.camera]
    drawn = {person.instance_id: person for person in truth.persons}
    roots = person_roots(scene)
    return tuple(
        _present(drawn[number], truth, scene, roots, camera) if number in drawn else _absent(number)
        for number in sorted({*roots, *drawn})
    )


def person_roots(scene: Scene) -> Mapping[int, Node]:
    """Instance id of each person to its topmost node, whose place is the person's ground origin."""
    return {number: root for number, root in instance_roots(scene).items() if root.label_id == PERSON.id}


def _absent(instance_id: int) -> Visibility:
    return Visibility(instance_id, undefined_reason=ABSENT)


def _present(
    person: PersonTruth, truth: GroundTruth, scene: Scene, roots: Mapping[int, Node], camera: Camera
) -> Visibility:
    seen = measure_pixels(person, truth)
    root = roots.get(person.instance_id)
    if root is None:
        return seen
    world = scene.world_transform(root.path)
    offset = world[:3, 3] - camera.position
    axes = camera.transform[:3, :3] / np.linalg.norm(camera.transform[:3, :3], axis=0)
    depth, right = -float(offset @ axes[:, 2]), float(offset @ axes[:, 0])
    return replace(
        seen,
        distance_m=float(np.linalg.norm(offset)),
        depth_m=depth,
        bearing_deg=math.degrees(math.atan2(right, depth)),
        aspect_deg=_turn_deg(world[:2, 1], -offset[:2]),
    )


def _turn_deg(of: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """From one direction on the ground to another, −180 … 180, counter-clockwise seen from above."""
    across = float(reference[0] * of[1] - reference[1] * of[0])
    return math.degrees(math.atan2(across, float(of @ reference)))


def measure_pixels(person: PersonTruth, truth: GroundTruth) -> Visibility:
    """What the pixels alone tell of a person: everything but its distances.

    Args:
        person: of ``truth``.
        truth: of the picture.
    """
    # What is seen of a person belongs to the whole, so nothing of it lies outside the box of the whole.
    visible = truth.instance_map[person.box.slices] == person.instance_id
    area, amodal = int(np.count_nonzero(visible)), int(np.count_nonzero(person.mask))
    reason = None
    if area == 0:
        reason = HIDDEN if amodal else OUTSIDE
    seen = bounds(visible)
    return Visibility(
        instance_id=person.instance_id,
        pixel_area=area,
        pixel_area_percent=100.0 * area / truth.instance_map.size,
        pixel_area_amodal=amodal,
        occlusion_rate=1.0 - area / amodal if amodal else None,
        truncation_rate=1.0 - amodal / person.padded_pixels if person.padded_pixels else None,
        box=None if seen.empty else (person.box.x + seen.x, person.box.y + seen.y, seen.width, seen.height),
        amodal_box=None if person.box.empty else (person.box.x, person.box.y, person.box.width, person.box.height),
        undefined_reason=reason,
    )
