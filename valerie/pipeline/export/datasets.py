"""A run's frames as a data set in files: Cityscapes layout, COCO, a Parquet index.

Everything is written into a hidden folder beside the target, one frame after the other. A fragment with the frame's entries for
the documents that list all frames marks each frame as complete. At the end these documents are joined, and the folder gets its
name. So the target is complete or does not exist, and the same request continues where it was interrupted.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from valerie.pipeline.base.context import Context
from valerie.pipeline.base.progress import Pace
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.export.export_plan import ExportPlan, ExportSettings, plan_export
from valerie.pipeline.export.folder import (
    FRAGMENTS,
    close_partial,
    new_folder,
    open_partial,
    require_free_name,
    require_room,
)
from valerie.pipeline.export.frame_files import FrameWriter
from valerie.pipeline.export.joining import write_documents


@dataclass(frozen=True, slots=True)
class Exported:
    """The result of an export.

    Attributes:
        folder: folder of the data set.
        frames: number of frames per split.
        left_out: number of finished frames of the run that were not selected.
        polygons_lose_percent: share of each class's pixels that polygons paint as another class; empty if there are none.
    """

    folder: Path
    frames: Mapping[str, int]
    left_out: int
    polygons_lose_percent: Mapping[str, float]


def export_run(
    context: Context,
    run_id: str,
    out: Path,
    settings: ExportSettings = ExportSettings(),  # noqa: B008  # frozen
    *,
    progress: Pace = lambda *_: None,
) -> Exported:
    """Write the frames of a run as a data set.

    Args:
        context: database and artifact store.
        run_id: id of a run with finished frames; it need not be complete.
        out: folder to create; must not exist, or be empty.
        settings: the request.
        progress: is told the frames so far, those that this attempt wrote per second, and how many were there already.

    Raises:
        NotFound: no such run.
        Conflict: ``out`` is not empty, or a prediction or an annotation is not available yet.
        InvalidInput, UnknownName: the settings do not fit the run, or select nothing.
        StorageFull: there is not enough room; nothing was written.
        StorageUnavailable: ``out`` cannot be written. The same export continues from what was written so far.
    """
    run = read_run(context, run_id)
    require_free_name(out)
    plan = plan_export(context, run, settings)
    require_room(out, plan.bytes, f"{len(plan.frames):,} frames", context.settings.min_free_mb)
    with new_folder(out, resumes=True) as partial:
        open_partial(partial, plan.request())
        _write_frames(FrameWriter(context, plan), plan, partial, progress)
        splits, lost = write_documents(context.engine, plan, partial)
        close_partial(partial)
    return Exported(out, splits, plan.left_out, lost)


def _write_frames(writer: FrameWriter, plan: ExportPlan, partial: Path, progress: Pace) -> None:
    """Write the frames that no earlier attempt wrote."""
    started, written, resumed = time.monotonic(), 0, 0
    for done, frame in enumerate(plan.frames, start=1):
        path = partial / FRAGMENTS / f"{plan.name(frame)}.json"
        if path.is_file():
            resumed += 1
        else:
            fragment = writer.write(frame, partial)
            unsealed = path.with_suffix(".part")
            unsealed.write_text(fragment.model_dump_json())
            unsealed.replace(path)  # from here on the frame counts as written
            written += 1
        elapsed = time.monotonic() - started
        there = f"{resumed:,} already there" if resumed else ""
        progress(done, len(plan.frames), written / elapsed if elapsed > 0 else 0.0, there)
