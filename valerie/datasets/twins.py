"""Frames that show the same scene in two data sets, such as a recorded frame and its rendered twin."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.datasets.cityscapes import CityscapesFolder
from valerie.datasets.frame import FrameName
from valerie.errors import InvalidInput
from valerie.labels import PERSON

#: Smallest intersection over union of the boxes of one person in both frames: a rebuilt scene is not aligned to a pixel.
LEAST_OVERLAP: Final = 0.3

#: Frame and instance ids of a person here and there.
Twin = tuple[FrameName, int, int]


def person_twins(here: CityscapesFolder, there: CityscapesFolder) -> list[Twin]:
    """Return the persons that both data sets show, in frames of equal names and sizes.

    Each person has at most one twin, so that the boxes of all pairs of a frame overlap most in total (Kuhn 1955,
    doi:10.1002/nav.3800020109).

    Raises:
        InvalidInput: no frames have equal names, a twin has another size, or the labels do not distinguish persons.
    """
    for folder in (here, there):
        if not folder.has_instances:
            raise InvalidInput(
                "the labels do not distinguish persons",
                field="--twin",
                value=str(folder.root),
                limit="_instanceIds.png",
            )
    frames = {name: index for index, name in enumerate(there.names)}
    shared = [(name, index, frames[name]) for index, name in enumerate(here.names) if name in frames]
    if not shared:
        raise InvalidInput(
            "the data sets share no frame",
            field="--twin",
            value=f"{there.names[0]}, …",
            limit=f"frames with names such as {here.names[0]}",
        )
    twins = []
    for name, own, counterpart in shared:
        instances, twin = here.instance_map(own), there.instance_map(counterpart)
        if instances.shape != twin.shape:
            raise InvalidInput(
                f"the twin of {name} has another size", field="--twin", value=twin.shape, limit=instances.shape
            )
        twins += [(name, *pair) for pair in matched(instances, twin)]
    return twins


def matched(here: NDArray[np.uint16], there: NDArray[np.uint16]) -> list[tuple[int, int]]:
    """Return the instance ids of the persons in both maps of one frame, (H, W) each; see `person_twins`."""
    from scipy.optimize import linear_sum_assignment

    ids_here, boxes_here = _boxes(here)
    ids_there, boxes_there = _boxes(there)
    low = np.maximum(boxes_here[:, None, :2], boxes_there[None, :, :2])
    high = np.minimum(boxes_here[:, None, 2:], boxes_there[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0), axis=2)
    sizes_here, sizes_there = (np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) for boxes in (boxes_here, boxes_there))
    overlap = common / (sizes_here[:, None] + sizes_there[None, :] - common)
    overlap[overlap < LEAST_OVERLAP] = 0.0
    rows, columns = linear_sum_assignment(overlap, maximize=True)
    return [
        (ids_here[row], ids_there[column]) for row, column in zip(rows, columns, strict=True) if overlap[row, column]
    ]


def _boxes(instance_map: NDArray[np.uint16]) -> tuple[list[int], NDArray[np.float64]]:
    """Return the ids of the persons and their boxes, (N, 4) x0, y0, x1, y1 in pixels, end exclusive."""
    from scipy.ndimage import find_objects

    first = PERSON.id * 1000
    numbers = instance_map.astype(np.int32) - first
    people = np.where((numbers >= 0) & (numbers < 1000), numbers + 1, 0)
    ids, boxes = [], []
    for number, slices in enumerate(find_objects(people)):
        if slices is not None:
            ids.append(first + number)
            boxes.append((slices[1].start, slices[0].start, slices[1].stop, slices[0].stop))
    return ids, np.array(boxes, np.float64).reshape(-1, 4)
