"""Paint thumbnails of frames, whole or cropped to a person, into one picture (a sprite sheet)."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from math import ceil, floor
from queue import LifoQueue
from threading import Lock
from typing import Final, NamedTuple, Self

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray
from PIL import Image

from valerie.db import measured
from valerie.db.archives import reading_run
from valerie.errors import Conflict, InvalidInput, MissingInput, NotFound
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.frame_pictures import FrameSources, sources_of_frames
from valerie.pipeline.reading.painting import FramePainter
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.base import Window
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import FRAME_KINDS, FUNCTION_KINDS, PictureKind

#: Kinds of picture that a thumbnail can show.
TILE_KINDS: Final = FRAME_KINDS + FUNCTION_KINDS
#: Most thumbnails of a sheet, and of a row.
MAX_TILES: Final = 64
COLUMNS: Final = 8
#: Sizes of the caches of thumbnails and of whole pictures, bytes. A whole picture has one thumbnail for each person and function.
_KEPT_BYTES: Final = 96 << 20
_WHOLE_BYTES: Final = 64 << 20
_PAINTERS: Final = 2
#: Smallest size of a crop: multiple of the person's height, and pixels of the picture.
_MARGIN: Final = 1.6
_LEAST: Final = 24
#: Least rows and columns of the picture for each of the thumbnail, where it has so many.
_DENSITY: Final = 1.5
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


#: Part of a picture, pixels: left, top, right, bottom.
Area = tuple[float, float, float, float]
#: Amodal boxes of persons by truth product and instance id.
_Boxes = Mapping[tuple[str, int], Sequence[int] | None]


class _Shape(NamedTuple):
    """The content of thumbnails, and their size in pixels."""

    kind: PictureKind
    crop: bool
    width: int
    height: int


class Tiles:
    """Cache of thumbnails of one process."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._lock = Lock()
        self._painters: LifoQueue[FramePainter] = LifoQueue()
        for _ in range(_PAINTERS):  # each for one thread at a time
            self._painters.put(FramePainter(ProductReader(context.store), kept_bytes=_WHOLE_BYTES // _PAINTERS))
        self._kept: LRUCache[tuple[Tile, _Shape], NDArray[np.uint8]] = LRUCache(
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
        shape = _Shape(PictureKind.parse(kind), crop, width, height)
        frames = self._sources(tiles, shape)  # of this sheet, since products of a running run come meanwhile
        boxes = self._boxes(frames) if crop and frames else {}
        sheet = np.full((ceil(len(tiles) / COLUMNS) * height, min(len(tiles), COLUMNS) * width, 3), _BLANK, np.uint8)
        for k, tile in enumerate(tiles):
            row, column = divmod(k, COLUMNS)
            pixels = self._tile(tile, shape, frames, boxes)
            if pixels is not None:
                sheet[row * height :, column * width :][:height, :width] = pixels
        buffer = io.BytesIO()
        Image.fromarray(sheet).save(buffer, "JPEG", quality=82)
        return buffer.getvalue()

    def _sources(self, tiles: Sequence[Tile], shape: _Shape) -> dict[FrameKey, FrameSources]:
        """Return what the tiles that are not kept may show; unknown frames are left out."""
        with self._lock:
            keys = {tile.frame: None for tile in tiles if (tile, shape) not in self._kept}
        found: dict[FrameKey, FrameSources] = {}
        for run_id in {key.run_id for key in keys}:
            of_run = [key for key in keys if key.run_id == run_id]
            with suppress(Conflict, NotFound):
                found |= sources_of_frames(self._context, run_id, of_run, evaluated=shape.kind in FUNCTION_KINDS)
        return found

    def _boxes(self, frames: Mapping[FrameKey, FrameSources]) -> _Boxes:
        boxes: dict[tuple[str, int], Sequence[int] | None] = {}
        for run_id in {key.run_id for key in frames}:
            truths = {source.frame.products.truth for key, source in frames.items() if key.run_id == run_id}
            with reading_run(self._context.engine, run_id) as connection:
                boxes |= measured.amodal_boxes(connection, truths)
        return boxes

    def _tile(
        self, tile: Tile, shape: _Shape, frames: Mapping[FrameKey, FrameSources], boxes: _Boxes
    ) -> NDArray[np.uint8] | None:
        key = (tile, shape)
        with self._lock:
            if key in self._kept:
                return self._kept[key]
        sources = frames.get(tile.frame)
        if sources is None:
            return None
        try:
            source = sources.picture(shape.kind, function=tile.function, sensor=tile.sensor)
            size = sources.resolved.spec.resolution
            box = boxes.get((source.capture.products.truth, tile.instance_id))
            area = _area(shape, box, size.width, size.height)
            window = _window(area, shape)
            with self._painter() as painter:
                picture = painter.paint(shape.kind, capture=source.capture, prediction=source.prediction, window=window)
        except (Conflict, MissingInput, NotFound):
            return None
        resized = Image.fromarray(np.ascontiguousarray(picture)).resize(
            (shape.width, shape.height), Image.Resampling.BILINEAR, box=_within(area, window, picture)
        )
        pixels = np.asarray(resized)
        with self._lock:
            self._kept[key] = pixels
        return pixels

    @contextmanager
    def _painter(self) -> Iterator[FramePainter]:
        painter = self._painters.get()
        try:
            yield painter
        finally:
            self._painters.put(painter)


def _area(shape: _Shape, box: Sequence[int] | None, width: int, height: int) -> Area:
    """Return the part of a picture that a thumbnail shows: left, top, right, bottom."""
    if shape.crop:
        return _around(box, width, height)
    if width * shape.height != height * shape.width:
        return _filled(width, height, shape.width / shape.height)
    return 0.0, 0.0, float(width), float(height)


def _window(area: Area, shape: _Shape) -> Window:
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
