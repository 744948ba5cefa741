"""Paint thumbnails of frames, whole or cropped to a person, into one picture (a sprite sheet)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from threading import Lock
from typing import Final, Self

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray
from PIL import Image

from valerie.db import measured
from valerie.db.engine import reading
from valerie.errors import Conflict, InvalidInput, MissingInput, NotFound
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.products import ProductReader
from valerie.runs.products.frames import FrameKey
from valerie.runs.products.pictures import FRAME_KINDS, FUNCTION_KINDS

#: Kinds of picture that a thumbnail can show.
TILE_KINDS: Final = FRAME_KINDS + FUNCTION_KINDS
#: Most thumbnails of a sheet, and of a row.
MAX_TILES: Final = 64
COLUMNS: Final = 8
#: Size of the cache, bytes.
_KEPT_BYTES: Final = 96 << 20
#: Smallest size of a crop: multiple of the person's height, and pixels of the picture.
_MARGIN: Final = 1.6
_LEAST: Final = 24
_BLANK: Final = 128


@dataclass(frozen=True, slots=True)
class Tile:
    """A thumbnail: a person in a frame, with a function and a sensor setting."""

    frame: FrameKey
    instance_id: int
    function: str
    sensor: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``frame:instance:function:sensor``; instance 0 means no person.

        Raises:
            InvalidInput: the text has another form.
        """
        parts = text.split(":", 3)
        if len(parts) != 4 or not parts[1].isascii() or not parts[1].isdigit() or len(parts[1]) > 9:
            raise InvalidInput("not a tile", field="tile", value=text, limit="frame:instance:function:sensor")
        return cls(FrameKey.parse(parts[0]), int(parts[1]), parts[2], parts[3])


class Tiles:
    """Cache of thumbnails of one process."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._lock, self._painting = Lock(), Lock()
        self._reader = ProductReader(context.store)
        self._kept: LRUCache[tuple[Tile, str, bool, int], NDArray[np.uint8]] = LRUCache(
            _KEPT_BYTES, lambda pixels: pixels.nbytes
        )

    def sheet(self, tiles: Sequence[Tile], *, kind: str, crop: bool, width: int) -> bytes:
        """Return a JPEG of thumbnails, `COLUMNS` in a row; a missing picture is grey.

        Args:
            tiles: at most `MAX_TILES`.
            kind: one of `TILE_KINDS`.
            crop: crop to the person; otherwise show the whole frame.
            width: width of a thumbnail in pixels; its height is 9/16 of it, or equal to it in crops.
        """
        height = width if crop else width * 9 // 16
        sheet = np.full((ceil(len(tiles) / COLUMNS) * height, min(len(tiles), COLUMNS) * width, 3), _BLANK, np.uint8)
        for k, tile in enumerate(tiles):
            row, column = divmod(k, COLUMNS)
            pixels = self._tile(tile, kind, crop, width, height)
            if pixels is not None:
                sheet[row * height :, column * width :][:height, :width] = pixels
        buffer = io.BytesIO()
        Image.fromarray(sheet).save(buffer, "JPEG", quality=82)
        return buffer.getvalue()

    def _tile(self, tile: Tile, kind: str, crop: bool, width: int, height: int) -> NDArray[np.uint8] | None:
        key = (tile, kind, crop, width)
        with self._lock:
            if key in self._kept:
                return self._kept[key]
        try:
            source = find_picture(self._context, tile.frame, kind=kind, function=tile.function, sensor=tile.sensor)
            with self._painting:
                picture = Image.fromarray(paint_picture(self._context, source, self._reader))
        except (Conflict, MissingInput, NotFound):
            return None
        area = (0.0, 0.0, float(picture.width), float(picture.height))
        if crop:
            area = _around(self._box(source.capture.products.truth, tile.instance_id), picture.width, picture.height)
        elif picture.width * height != picture.height * width:
            area = _filled(picture.width, picture.height, width / height)
        pixels = np.asarray(picture.resize((width, height), Image.Resampling.BILINEAR, box=area))
        with self._lock:
            self._kept[key] = pixels
        return pixels

    def _box(self, truth: str, instance_id: int) -> Sequence[int] | None:
        with reading(self._context.engine) as connection:
            persons = measured.person_views(connection, truth)
        return next((person.amodal_box for person in persons if person.instance_id == instance_id), None)


def _around(box: Sequence[int] | None, width: int, height: int) -> tuple[float, float, float, float]:
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


def _filled(width: int, height: int, ratio: float) -> tuple[float, float, float, float]:
    """Return the largest centred part of a picture with a ratio of width to height."""
    wide, high = min(float(width), height * ratio), min(float(height), width / ratio)
    left, top = (width - wide) / 2, (height - high) / 2
    return left, top, left + wide, top + high
