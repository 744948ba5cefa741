"""A data set of few frames as a zip archive, sent while it is read."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from zipfile import ZIP_STORED, ZipFile

from valerie.errors import InvalidInput
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.export.datasets import export_run
from valerie.pipeline.export.export_plan import ExportSettings, plan_export

#: Most frames of an archive: it is written before the first byte is sent.
MAX_FRAMES: Final = 500


def export_archive(context: Context, run_id: str, settings: ExportSettings) -> Iterator[bytes]:
    """Export frames of a run, and return the parts of a zip archive with the files.

    Raises:
        InvalidInput: the settings select more than `MAX_FRAMES`.
        ValerieError: as `valerie.pipeline.export.datasets.export_run`.
    """
    frames = len(plan_export(context, read_run(context, run_id), settings).frames)
    if frames > MAX_FRAMES:
        hint = f"{MAX_FRAMES} frames; `valerie dataset export` has no limit"
        raise InvalidInput("selects too many frames for a download", field="where", value=frames, limit=hint)
    folder = TemporaryDirectory(prefix="valerie-export-")
    try:
        export_run(context, run_id, Path(folder.name) / "dataset", settings)
    except BaseException:
        folder.cleanup()
        raise
    return _zipped(folder)


def _zipped(folder: TemporaryDirectory[str]) -> Iterator[bytes]:
    """Yield a zip archive of a folder, which is removed afterwards. Its files are compressed already."""
    sink = _Sink()
    with folder, ZipFile(sink, "w", ZIP_STORED) as archive:
        for path in sorted(Path(folder.name).rglob("*")):
            if path.is_file():
                archive.write(path, path.relative_to(folder.name))
                yield sink.taken()
        archive.close()
        yield sink.taken()


class _Sink(io.RawIOBase):
    """Keeps what is written until it is taken; it cannot seek, so a zip archive is written in one pass."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: object) -> int:  # bytes-like
        part = bytes(data)  # type: ignore[call-overload]
        self._parts.append(part)
        return len(part)

    def taken(self) -> bytes:
        """Return the bytes that were written since the last call."""
        data = b"".join(self._parts)
        self._parts.clear()
        return data
