"""Label policies: exact labels, and labels as annotators draw them.

The truth is exact: sky between two leaves is sky. Cityscapes is drawn by hand with polygons, and its policy closes such gaps:
"labeled foreground objects must never have holes, i.e. if there is some background visible 'through' some foreground object, it
is considered to be part of the foreground"; a fence "includes any holes" (M. Cordts et al., "The Cityscapes Dataset for Semantic
Urban Scene Understanding", CVPR 2016, arXiv:1604.01685, and https://www.cityscapes-dataset.com/dataset-overview/). Networks
trained on real data have learned the second kind.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.errors import MissingDependency
from valerie.labels import BY_NAME, PERSON
from valerie.rendering.base import GroundTruth, Rectangle, bounds

if TYPE_CHECKING:
    from collections.abc import Iterator

Mask = NDArray[np.bool_]


class LabelPolicy(StrEnum):
    """The kind of labels that predictions are compared with and data sets hold."""

    EXACT = "exact"
    CITYSCAPES = "cityscapes"


#: Half of the widest gap that is closed, as a share: of the image's height in foliage, whose outline has no size of its own; of
#: the height of an object (an instance, or a connected piece of a class without instances) elsewhere.
FOLIAGE: Final = 1.0 / 90.0
OF_OBJECTS: Final = {"fence": 1.0 / 4.0, "motorcycle": 1.0 / 8.0, "bicycle": 1.0 / 8.0}
#: Gaps keep the pixels of people, since a person seen through a tree must still be detected.
_KEPT: Final = (PERSON.id, BY_NAME["rider"].id)
#: A gap lies behind an object if its depth is at least this share of the object's nearest.
_BEHIND: Final = 0.98


def labelled(truth: GroundTruth, policy: LabelPolicy) -> GroundTruth:
    """Return the truth with the labels of a policy, or the truth itself under the exact policy.

    Under ``cityscapes``, gaps in vegetation, fences and two-wheelers take the class and instance of the object around them.
    A gap shows surfaces behind the object; surfaces in front keep their labels. Pixels of persons and riders keep theirs too, so
    occlusion, areas and masks of people are the same under both policies. Depths are those of the visible surfaces.

    Raises:
        MissingDependency: OpenCV is not installed.
    """
    if policy is LabelPolicy.EXACT:
        return truth
    classes, instances = truth.class_map.copy(), truth.instance_map.copy()
    for label, instance, outline, box in _outlines(truth):
        inside = box.slices
        gap = outline & ~np.isin(truth.class_map[inside], _KEPT)
        classes[inside][gap] = label
        instances[inside][gap] = instance
    return replace(truth, class_map=classes, instance_map=instances)


class _Shown(NamedTuple):
    """An object in the image.

    Attributes:
        nearest: its smallest depth, metres; infinite for what is never nearer than others.
        label, instance: its ids.
        mask: (H, W) bool, its pixels.
        radius: of the disc that closes its gaps, pixels.
    """

    nearest: float
    label: int
    instance: int
    mask: Mask
    radius: int


def _outlines(truth: GroundTruth) -> Iterator[tuple[int, int, Mask, Rectangle]]:
    """Yield each object's class, instance, gaps and their rectangle, far objects first, so that near ones close gaps last."""
    objects: list[_Shown] = []
    height = truth.class_map.shape[0]
    foliage = BY_NAME["vegetation"].id
    if (mask := truth.class_map == foliage).any():
        objects.append(_Shown(np.inf, foliage, 0, mask, max(round(FOLIAGE * height), 1)))
    for name, share in OF_OBJECTS.items():
        label = BY_NAME[name]
        of_class = truth.class_map == label.id
        if not of_class.any():
            continue
        for instance, mask in _instances(of_class, truth.instance_map) if label.has_instances else _pieces(of_class):
            nearest = float(truth.depth[mask].min())
            radius = max(round(share * bounds(mask).height), 1)
            objects.append(_Shown(nearest, label.id, instance, mask, radius))
    for item in sorted(objects, key=lambda item: -item.nearest):
        wide = bounds(item.mask).widened(item.radius).clipped(item.mask.shape[1], height)
        gaps = _gaps(item.mask[wide.slices], truth.depth[wide.slices], item.radius)
        yield item.label, item.instance, gaps, wide


def _gaps(mask: Mask, depth: NDArray[np.float32], radius: int) -> Mask:
    """Return the pixels behind an object in gaps that a closing by a disc fills, and in enclosed gaps up to twice as wide."""
    cv2 = _opencv()
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), radius, radius, radius, radius, cv2.BORDER_CONSTANT, value=0)
    solid = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)[radius:-radius, radius:-radius]
    count, numbers, boxes, _ = cv2.connectedComponentsWithStats((solid == 0).astype(np.uint8), connectivity=4)
    rows, columns = solid.shape
    for number in range(1, count):
        x, y, width, height, area = boxes[number]
        on_border = x == 0 or y == 0 or x + width == columns or y + height == rows
        if not on_border and area <= np.pi * (2 * radius) ** 2:
            solid[numbers == number] = 1
    wider = cv2.getStructuringElement(cv2.MORPH_RECT, (4 * radius + 1, 4 * radius + 1))
    nearest = cv2.erode(np.where(mask, depth, np.float32(np.inf)), wider)
    gaps: Mask = (solid > 0) & ~mask & (depth >= _BEHIND * nearest)
    return gaps


def _instances(of_class: Mask, instance_map: NDArray[np.uint16]) -> Iterator[tuple[int, Mask]]:
    for instance in np.unique(instance_map[of_class]).tolist():
        yield instance, of_class & (instance_map == instance)


def _pieces(of_class: Mask) -> Iterator[tuple[int, Mask]]:
    """Yield the connected pieces of a class without instances, as instance 0."""
    count, numbers = _opencv().connectedComponents(of_class.astype(np.uint8), connectivity=8)
    for number in range(1, count):
        yield 0, numbers == number


def _opencv() -> Any:
    try:
        import cv2
    except ModuleNotFoundError as error:
        raise MissingDependency(
            "labels as annotators draw them need OpenCV; install it with: pip install 'valerie[eval]'"
        ) from error
    return cv2
