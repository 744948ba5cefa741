"""The folder that an export writes into: it replaces nothing, and an interrupted export continues in it."""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from valerie.errors import Conflict, StorageFull, StorageUnavailable
from valerie.pipeline.export.export_plan import ExportRequest

#: Subfolder of an unfinished export, with one document per written frame.
FRAGMENTS: Final = "fragments"
_REQUEST: Final = "request.json"


@contextmanager
def new_folder(out: Path, *, resumes: bool = False) -> Iterator[Path]:
    """Give the path of a hidden folder beside ``out``, which gets the name ``out`` when the body has filled it.

    Args:
        out: must not exist, or be an empty folder.
        resumes: True leaves what an earlier attempt wrote, and what this one writes if it is interrupted.

    Raises:
        StorageFull, StorageUnavailable: the body or the renaming cannot write.
    """
    partial = out.with_name(f".{out.name}.partial")
    try:
        if not resumes:
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
        yield partial
        if out.exists():
            out.rmdir()
        partial.rename(out)
    except OSError as error:
        if error.errno == errno.ENOSPC:
            again = "; free some and run the same export again to continue" if resumes else ""
            raise StorageFull(f"no space left for {out}{again}") from error
        raise StorageUnavailable(f"{out} cannot be written: {error.strerror or error}") from error
    finally:
        if not resumes:
            shutil.rmtree(partial, ignore_errors=True)


def open_partial(partial: Path, request: ExportRequest) -> None:
    """Prepare the folder: keep what an earlier attempt at the same request wrote; otherwise empty it."""
    path = partial / _REQUEST
    if path.is_file() and (partial / FRAGMENTS).is_dir() and json.loads(path.read_bytes()) == request:
        return
    if partial.exists():
        shutil.rmtree(partial)
    (partial / FRAGMENTS).mkdir(parents=True)
    path.write_text(json.dumps(request))


def close_partial(partial: Path) -> None:
    """Remove the files that only an unfinished export needs."""
    (partial / _REQUEST).unlink()
    shutil.rmtree(partial / FRAGMENTS)


def require_free_name(out: Path) -> None:
    """Refuse an occupied path.

    Raises:
        Conflict: ``out`` is anything but an empty folder.
    """
    if out.is_dir() and not any(out.iterdir()):
        return
    if out.exists() or out.is_symlink():
        raise Conflict(f"{out} exists already; an export never replaces anything")


def require_room(out: Path, needed: float, what: str, min_free_mb: int) -> None:
    """Refuse an export that does not fit the disk.

    Raises:
        StorageFull: ``needed`` bytes for ``what`` would leave less than ``min_free_mb``.
    """
    place = next(parent for parent in out.absolute().parents if parent.exists())
    free = shutil.disk_usage(place).free - min_free_mb * 1e6
    if needed > free:
        raise StorageFull(
            f"{what} need up to {needed / 1e6:,.0f} MB; {max(free, 0) / 1e6:,.0f} MB may be used in {place}"
        )
