"""A thumbnail of a frame: a small picture of all of it, or of a person in it."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from valerie.pipeline.reading.frame_pictures import ShownProducts
from valerie.pipeline.reading.painting import FramePainter
from valerie.rendering.base import Window
from valerie.runs.document.run_spec import Resolution
from valerie.runs.products.pictures import PictureKind

#: Smallest size of a crop: multiple of the person's height, and pixels of the picture.
_MARGIN: Final = 1.6
_LEAST: Final = 24
#: Least rows and columns of the picture for each of the thumbnail, where it has so many.
_DENSITY: Final = 1.5

#: Part of a picture, pixels: left, top, right, bottom.
Area = tuple[float, float, float, float]


class Shape(NamedTuple):
    """The content of thumbnails, and their size in pixels."""

    kind: PictureKind
    crop: bool
    width: int
    height: int

    @classmethod
    def of(cls, kind: PictureKind, width: int, *, crop: bool) -> Self:
        """Return the shape of a width: the height is 9/16 of it, or equal to it in crops."""
        return cls(kind, crop, width, width if crop else width * 9 // 16)


def paint_thumbnail(
    painter: FramePainter, source: ShownProducts, shape: Shape, box: Sequence[int] | None, size: Resolution
) -> NDArray[np.uint8]:
    """Paint a thumbnail: (height, width, 3) uint8 sRGB.

    Args:
        painter: of the store.
        source: what it shows.
        shape: of the thumbnail.
        box: amodal box of the person that a crop shows; None: the middle of the picture.
        size: of the picture.

    Raises:
        UnknownName: its kind needs a prediction and there is none.
        MissingInput: an object is gone.
    """
    area = _area(shape, box, size.width, size.height)
    window = _window(area, shape)
    picture = painter.paint(shape.kind, capture=source.capture, prediction=source.prediction, window=window)
    resized = Image.fromarray(np.ascontiguousarray(picture)).resize(
        (shape.width, shape.height), Image.Resampling.BILINEAR, box=_within(area, window, picture)
    )
    return np.asarray(resized)


def _area(shape: Shape, box: Sequence[int] | None, width: int, height: int) -> Area:
    """Return the part of a picture that a thumbnail shows: left, top, right, bottom."""
    if shape.crop:
        return _around(box, width, height)
    if width * shape.height != height * shape.width:
        return _filled(width, height, shape.width / shape.height)
    return 0.0, 0.0, float(width), float(height)


def _window(area: Area, shape: Shape) -> Window:
    """Return the rows and columns from which an area is resized: those inside and the reach of the filter around them.

    Of a large area, they are only every second, third, …, at least `_DENSITY` for each pixel of the thumbnail.
    """
    left, top, right, bottom = area
    shrunk = (right - left) / shape.width
    step, reach = max(1, floor(shrunk / _DENSITY)), ceil(max(1.0, shrunk)) + 1
    rows = slice(max(floor(top) - reach, 0), ceil(bottom) + reach, step)
    return rows, slice(max(floor(left) - reach, 0), ceil(right) + reach, step)


def _within(area: Area, window: Window, picture: NDArray[np.uint8]) -> Area:
    """Return an area in coordinates of the pixels of a window, whose middles stay where they are."""
    rows, columns = window
    height, width = picture.shape[:2]

    def moved(edge: float, taken: slice, most: int) -> float:
        place: float = (edge - taken.start - 0.5) / taken.step + 0.5
        return min(place, most)

    left, top, right, bottom = area
    return (
        moved(left, columns, width),
        moved(top, rows, height),
        moved(right, columns, width),
        moved(bottom, rows, height),
    )


def _around(box: Sequence[int] | None, width: int, height: int) -> Area:
    """Return a square within a picture around a person's box; without a box, the largest in the middle."""
    side = float(min(width, height))
    middle = (width / 2, height / 2)
    if box is not None:
        x0, y0, x1, y1 = box
        side = min(max(_MARGIN * max(x1 - x0, y1 - y0), _LEAST), side)
        middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    left = min(max(middle[0] - side / 2, 0.0), width - side)
    top = min(max(middle[1] - side / 2, 0.0), height - side)
    return left, top, left + side, top + side


def _filled(width: int, height: int, ratio: float) -> Area:
    """Return the largest centred part of a picture with a ratio of width to height."""
    wide, high = min(float(width), height * ratio), min(float(height), width / ratio)
    left, top = (width - wide) / 2, (height - high) / 2
    return left, top, left + wide, top + high
