"""Thumbnails that remain of frames whose run removed their pictures.

They show what the dashboard's grid shows first: the picture and the errors of each function, whole and cropped to each person.
Frames of neighbouring variants share one object of the run, a zip archive of WebP files.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from typing import Final
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from valerie.db import measured
from valerie.db.engine import reading
from valerie.errors import Conflict, MissingInput, NotFound
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import started_run
from valerie.pipeline.reading.frame_pictures import FrameSources, sources_of_frames
from valerie.pipeline.reading.painting import FramePainter
from valerie.pipeline.reading.thumbnail import Shape, paint_thumbnail
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import PictureKind
from valerie.runs.resolving.spec import ResolvedRun
from valerie.storage.keys import run_key
from valerie.storage.store import ArtifactStore

#: Width of a thumbnail in pixels, as the dashboard's grid shows it.
_WIDTH: Final = 160
_QUALITY: Final = 85
#: Most frames of one object, unless there are more cameras.
_FRAMES: Final = 50
_KINDS: Final = (PictureKind.PICTURE, PictureKind.ERRORS)
#: The instance of a thumbnail that shows the whole frame.
_WHOLE: Final = 0


def variants_together(resolved: ResolvedRun) -> int:
    """Return the number of neighbouring variants whose thumbnails share an object."""
    return max(1, _FRAMES // (len(resolved.cameras) * len(resolved.times.elapsed)))


def keep_thumbnails(
    context: Context, frames: Collection[FrameKey], painter: FramePainter, keep: Callable[[str, bytes], object]
) -> None:
    """Keep thumbnails of frames of a run, as far as their pictures are there. Those that are kept already stay.

    Args:
        context: of this process.
        frames: of the run; it is fastest if frames that share an object come together.
        painter: of the pictures in the context's store.
        keep: stores an object of the run under a name.
    """
    together: dict[str, list[FrameKey]] = {}
    for frame in sorted(frames):
        name = _object_name(frame, started_run(context, frame.run_id).resolved)
        together.setdefault(name, []).append(frame)
    for name, some in together.items():
        files = _files(context.store, run_key(some[0].run_id, name))
        present = len(files)
        _add(files, context, some, painter)
        if len(files) > present:
            keep(name, _archive(files))


def _add(files: dict[str, bytes], context: Context, frames: Collection[FrameKey], painter: FramePainter) -> None:
    """Add those thumbnails of some frames of a run that are missing among the files of an object."""
    run_id = next(iter(frames)).run_id
    sources = sources_of_frames(context, run_id, frames, evaluated=True)
    with reading(context.engine) as connection:
        boxes = measured.amodal_boxes(connection, {source.frame.products.truth for source in sources.values()})
    for key, source in sources.items():
        seen = {n: box for (truth, n), box in boxes.items() if truth == source.frame.products.truth and box is not None}
        for kind, sensor, function in _shown(source):
            for instance, box in {_WHOLE: None, **seen}.items():
                file = _file_name(key, kind, sensor, function, instance)
                if file not in files:
                    with suppress(Conflict, MissingInput):
                        picture = source.picture(kind, function=function, sensor=sensor)
                        shape = Shape.of(kind, _WIDTH, crop=instance != _WHOLE)
                        size = source.resolved.spec.resolution
                        files[file] = _webp(paint_thumbnail(painter, picture, shape, box, size))


class KeptThumbnails:
    """Reader of the thumbnails that remain, which reads each object once."""

    def __init__(self, store: ArtifactStore) -> None:
        self._store = store
        self._objects: dict[str, dict[str, bytes]] = {}

    def thumbnail(
        self, source: FrameSources, shape: Shape, *, function: str | None, sensor: str | None, instance: int
    ) -> NDArray[np.uint8] | None:
        """Return a thumbnail of a frame whose pictures are removed, (height, width, 3) uint8 sRGB; None if there is none.

        Args:
            source: the frame.
            shape: of the thumbnail, which is resized to it.
            function, sensor: names in the spec; None: the first.
            instance: person that a crop shows; the middle of the whole frame if no thumbnail shows this person.
        """
        frame = source.frame.key
        if source.frame.removed is None or shape.kind not in _KINDS:
            return None
        key = run_key(frame.run_id, _object_name(frame, source.resolved))
        if key not in self._objects:
            self._objects[key] = _files(self._store, key)
        sensor_name = sensor or source.resolved.spec.sensors[0].name
        function_name = function or next(iter(source.resolved.spec.functions), None)
        names = (
            _file_name(frame, shape.kind, sensor_name, function_name, shown)
            for shown in (instance if shape.crop else _WHOLE, _WHOLE)
        )
        found = next((file for name in names if (file := self._objects[key].get(name))), None)
        if found is None:
            return None
        picture = Image.open(io.BytesIO(found))
        margin = (picture.width - picture.height) / 2 if shape.crop else 0.0
        box = (margin, 0.0, picture.width - margin, float(picture.height))
        return np.asarray(picture.resize((shape.width, shape.height), Image.Resampling.BILINEAR, box=box))


def _shown(source: FrameSources) -> Iterator[tuple[PictureKind, str, str | None]]:
    """Yield kind, sensor and function of the pictures that have thumbnails."""
    spec = source.resolved.spec
    for sensor in spec.sensors:
        yield PictureKind.PICTURE, sensor.name, None
    for link in source.predictions:
        yield PictureKind.ERRORS, spec.sensors[link.sensor_index].name, spec.functions[link.function_index]


def _object_name(frame: FrameKey, resolved: ResolvedRun) -> str:
    variants, moments = variants_together(resolved), max(1, _FRAMES // len(resolved.cameras))
    return f"thumbnails-{frame.variant // variants * variants}-{frame.time // moments * moments}.zip"


def _file_name(frame: FrameKey, kind: PictureKind, sensor: str, function: str | None, instance: int) -> str:
    """Return the name of a thumbnail in its archive."""
    of = (sensor,) if kind is PictureKind.PICTURE or function is None else (sensor, function)
    names = (str(kind), *(quote(name, safe="") for name in of), "whole" if instance == _WHOLE else str(instance))
    return f"{frame.variant}.{frame.camera}.{frame.time}/{'/'.join(names)}.webp"


def _files(store: ArtifactStore, key: str) -> dict[str, bytes]:
    """Read the thumbnails of an object, by name; none if it is missing or damaged."""
    try:
        with zipfile.ZipFile(io.BytesIO(store.get(key))) as archive:
            return {name: archive.read(name) for name in archive.namelist()}
    except (NotFound, zipfile.BadZipFile):
        return {}


def _archive(files: Mapping[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(name), data)  # without the time, so that equal thumbnails are equal bytes
    return buffer.getvalue()


def _webp(pixels: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "WEBP", quality=_QUALITY)
    return buffer.getvalue()
