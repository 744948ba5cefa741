"""Label maps as Cityscapes' polygons, for tools that read nothing else.

Polygons know no holes: they are painted one after the other. Every connected region gives its outer outline, the larger
ones first, so that what lies in a hole is painted over it.
"""

from __future__ import annotations

from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from valerie.errors import MissingDependency
from valerie.labels import BY_ID


class Polygon(TypedDict):
    """The class of a region, and the x and y of the corners of its outline."""

    label: str
    polygon: list[list[int]]


class PolygonsDocument(TypedDict):
    """One ``polygons`` file: height and width of the image, and polygons in the order of painting."""

    imgHeight: int
    imgWidth: int
    objects: list[Polygon]


def polygons_document(segment_ids: NDArray[np.uint16]) -> PolygonsDocument:
    """Return the polygons of a label map.

    Args:
        segment_ids: (H, W) as `LabelledFrame.segment_ids`; each instance gives polygons of its own, 0 (unlabeled) none.

    Raises:
        MissingDependency: OpenCV is not installed.
    """
    try:
        import cv2
    except ModuleNotFoundError as error:
        raise MissingDependency("polygons need OpenCV; install it with: pip install 'valerie[eval]'") from error

    height, width = segment_ids.shape
    polygons: list[tuple[float, Polygon]] = []
    for number in np.unique(segment_ids).tolist():
        label = BY_ID.get(number // 1000 if number >= 1000 else number)
        if label is None or label.id == 0:
            continue
        mask = (segment_ids == number).astype(np.uint8)
        # Two levels: outer outlines, also of what lies in a hole of another region of the class, and holes.
        outlines, levels = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
        for outline, level in zip(outlines, levels[0] if levels is not None else (), strict=True):
            if level[3] < 0:
                points = outline.reshape(-1, 2)
                area = float(cv2.contourArea(outline)) + cv2.arcLength(outline, closed=True) / 2
                polygons.append((area, Polygon(label=label.name, polygon=_at_least_three(points.tolist()))))
    polygons.sort(key=lambda item: -item[0])
    return PolygonsDocument(imgHeight=height, imgWidth=width, objects=[polygon for _, polygon in polygons])


def _at_least_three(points: list[list[int]]) -> list[list[int]]:
    """Return a polygon of at least three points, also for a single pixel or a line: tools that draw polygons need them."""
    return points if len(points) >= 3 else (points * 3)[:3]
