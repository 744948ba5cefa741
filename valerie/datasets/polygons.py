"""Label maps as Cityscapes' polygons, for tools that read only these.

Polygons have no holes: they are painted one after another. Every connected region becomes its outer outline, larger ones first,
so that regions in a hole are painted later. If regions interlock, a polygon still covers pixels of others. Classes without
instances get these pixels back, line by line. Instances do not, since tools count every polygon as an object.
"""

from __future__ import annotations

from typing import TypedDict

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from valerie.errors import MissingDependency
from valerie.labels import BY_ID, BY_NAME


class Polygon(TypedDict):
    """The class of a region, and the corners (x, y) of its outline."""

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
        segment_ids: (H, W), see `LabelledFrame.segment_ids`. Each instance has separate polygons; 0 (unlabeled) has none.

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
        # Two levels: holes, and outer outlines, also of regions within holes of the same class.
        outlines, levels = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
        for outline, level in zip(outlines, levels[0] if levels is not None else (), strict=True):
            if level[3] < 0:
                points = outline.reshape(-1, 2)
                area = float(cv2.contourArea(outline)) + cv2.arcLength(outline, closed=True) / 2
                polygons.append((area, Polygon(label=label.name, polygon=_at_least_three(points.tolist()))))
    polygons.sort(key=lambda item: -item[0])
    document = PolygonsDocument(imgHeight=height, imgWidth=width, objects=[polygon for _, polygon in polygons])
    covered = (segment_ids > 0) & (segment_ids < 1000) & (painted(document) != segment_ids)
    for number in np.unique(segment_ids[covered]).tolist():
        document["objects"] += _lines(covered & (segment_ids == number), BY_ID[number].name)
    return document


def painted(document: PolygonsDocument) -> NDArray[np.uint8]:
    """Return the label ids that annotation tools would paint from these polygons, (H, W); 0 outside all of them."""
    canvas = Image.new("L", (document["imgWidth"], document["imgHeight"]))
    drawing = ImageDraw.Draw(canvas)
    for polygon in document["objects"]:
        drawing.polygon([(x, y) for x, y in polygon["polygon"]], fill=BY_NAME[polygon["label"]].id)
    return np.asarray(canvas)


def lost_pixels(document: PolygonsDocument, class_map: NDArray[np.uint8]) -> dict[str, tuple[int, int]]:
    """Return, for each class in a map, its number of pixels and how many of them polygons paint as another class.

    Args:
        document: the polygons.
        class_map: (H, W) label ids that the polygons represent.
    """
    wrong = painted(document) != class_map
    counts, losses = (np.bincount(ids, minlength=256).tolist() for ids in (class_map.ravel(), class_map[wrong]))
    return {
        label.name: (counts[label.id], losses[label.id]) for label in BY_ID.values() if label.id and counts[label.id]
    }


def _lines(mask: NDArray[np.bool_], label: str) -> list[Polygon]:
    """Return a flat polygon for each horizontal line of pixels of a mask."""
    steps = np.diff(np.pad(mask.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, starts = np.nonzero(steps == 1)
    stops = np.nonzero(steps == -1)[1] - 1
    return [
        Polygon(label=label, polygon=[[x0, y], [x1, y], [x1, y]])
        for y, x0, x1 in zip(rows.tolist(), starts.tolist(), stops.tolist(), strict=True)
    ]


def _at_least_three(points: list[list[int]]) -> list[list[int]]:
    """Return a polygon of at least three points, which tools need even for a single pixel or a line."""
    return points if len(points) >= 3 else (points * 3)[:3]
