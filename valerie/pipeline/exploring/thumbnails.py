"""Paint thumbnails of frames, whole or cropped to a person, into one picture (a sprite sheet)."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from math import ceil
from queue import LifoQueue
from threading import Lock
from typing import Final, Self

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray
from PIL import Image

from valerie.db import measured
from valerie.db.archives import reading_run
from valerie.errors import Conflict, InvalidInput, MissingInput, NotFound
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.frame_pictures import FrameSources, sources_of_frames
from valerie.pipeline.reading.kept_thumbnails import KeptThumbnails
from valerie.pipeline.reading.painting import FramePainter
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.thumbnail import Shape, paint_thumbnail
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
_BLANK: Final = 128


@dataclass(frozen=True, slots=True)
class Tile:
    """A thumbnail: a person in a frame, with a function and a sensor setting; an empty name means the first of the run."""

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


#: Amodal boxes of persons by truth product and instance id.
_Boxes = Mapping[tuple[str, int], Sequence[int] | None]


class Tiles:
    """Cache of thumbnails of one process."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._lock = Lock()
        self._painters: LifoQueue[FramePainter] = LifoQueue()
        for _ in range(_PAINTERS):  # each for one thread at a time
            self._painters.put(FramePainter(ProductReader(context.store), kept_bytes=_WHOLE_BYTES // _PAINTERS))
        self._kept: LRUCache[tuple[Tile, Shape], NDArray[np.uint8]] = LRUCache(
            _KEPT_BYTES, lambda pixels: pixels.nbytes
        )

    def sheet(self, tiles: Sequence[Tile], *, kind: str, crop: bool, width: int) -> bytes:
        """Return a JPEG of thumbnails, `COLUMNS` in a row; a missing picture is grey.

        Of a picture that its run removed, the thumbnail that remains is shown.

        Args:
            tiles: at most `MAX_TILES`.
            kind: one of `TILE_KINDS`.
            crop: crop to the person; otherwise show the whole frame.
            width: width of a thumbnail in pixels; its height is 9/16 of it, or equal to it in crops.
        """
        shape = Shape.of(PictureKind.parse(kind), width, crop=crop)
        height = shape.height
        frames = self._sources(tiles, shape)  # of this sheet, since products of a running run come meanwhile
        boxes = self._boxes(frames) if crop and frames else {}
        kept = KeptThumbnails(self._context.store)
        sheet = np.full((ceil(len(tiles) / COLUMNS) * height, min(len(tiles), COLUMNS) * width, 3), _BLANK, np.uint8)
        for k, tile in enumerate(tiles):
            row, column = divmod(k, COLUMNS)
            pixels = self._tile(tile, shape, frames, boxes, kept)
            if pixels is not None:
                sheet[row * height :, column * width :][:height, :width] = pixels
        buffer = io.BytesIO()
        Image.fromarray(sheet).save(buffer, "JPEG", quality=82)
        return buffer.getvalue()

    def _sources(self, tiles: Sequence[Tile], shape: Shape) -> dict[FrameKey, FrameSources]:
        """Return the sources of the tiles that are not kept; unknown frames are left out."""
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
        self,
        tile: Tile,
        shape: Shape,
        frames: Mapping[FrameKey, FrameSources],
        boxes: _Boxes,
        kept: KeptThumbnails,
    ) -> NDArray[np.uint8] | None:
        key = (tile, shape)
        with self._lock:
            if key in self._kept:
                return self._kept[key]
        sources = frames.get(tile.frame)
        if sources is None:
            return None
        function, sensor = tile.function or None, tile.sensor or None
        try:
            source = sources.picture(shape.kind, function=function, sensor=sensor)
            box = boxes.get((source.capture.products.truth, tile.instance_id))
            with self._painter() as painter:
                pixels = paint_thumbnail(painter, source, shape, box, sources.resolved.spec.resolution)
        except (Conflict, MissingInput, NotFound):
            remaining = kept.thumbnail(sources, shape, function=function, sensor=sensor, instance=tile.instance_id)
            if remaining is None:
                return None
            pixels = remaining
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
