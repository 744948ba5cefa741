"""At the end of a run, remove the pictures that its spec does not keep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final
from zlib import crc32

import orjson
import structlog
from sqlalchemy import Connection

from valerie.db import retention
from valerie.db.archives import read_archived_digests
from valerie.db.engine import reading, writing
from valerie.db.runs import RunRow
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import started_run
from valerie.pipeline.base.run_artifacts import SUMMARY
from valerie.pipeline.reading.kept_thumbnails import keep_thumbnails, variants_together
from valerie.pipeline.reading.named_frames import named_frames
from valerie.pipeline.reading.painting import FramePainter
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.runs.document.run_spec import SAMPLED, Retention
from valerie.runs.products.frame_keys import FrameKey
from valerie.storage.keys import product_key, run_key

log = structlog.get_logger()

#: Size of the pictures and labels that are kept for further thumbnails of a frame.
_PAINTED_BYTES: Final = 64 << 20


def remove_pictures(
    context: Context, run: RunRow, keep: Callable[[str, bytes], object], require_held: Callable[[Connection], None]
) -> None:
    """Remove pictures, truths, annotations and predictions of the frames that the run does not keep, and no other run does.

    Thumbnails of these frames remain, which are kept before the pictures go. Repeating it changes nothing. A killed process
    may leave products whose objects are gone; the next call finds them.

    Args:
        context: of this process.
        run: whose products are all done or failed.
        keep: stores an artifact of the run under a name.
        require_held: raises if another process finishes the run.
    """
    if run.spec.retention is Retention.ALL:
        return
    shown = set() if run.spec.retention is Retention.NUMBERS else _shown(context, run.id)
    painter = FramePainter(ProductReader(context.store), kept_bytes=_PAINTED_BYTES)
    together = variants_together(started_run(context, run.id).resolved)
    read_archived_digests(context.engine)
    removed = 0
    for first in range(0, run.next_index, together):
        last = first + together - 1
        with reading(context.engine) as connection:
            frames = _unkept_frames(connection, run, first, last) - shown
        keep_thumbnails(context, frames, painter, keep)
        with writing(context.engine) as connection:
            require_held(connection)
            retention.mark_removed(connection, frames, f"retention: {run.spec.retention}")
            unkept = retention.park_unkept(connection, run.id, first, last)
            # Before the commit: once they are parked, another run may make them again.
            context.store.delete(product_key(kind, digest) for digest, kind in unkept)
        removed += len(unkept)
    log.info("finish.removed", run=run.id, products=removed)


def _unkept_frames(connection: Connection, run: RunRow, first: int, last: int) -> set[FrameKey]:
    """Return the frames of these variants that the run still keeps and, apart from examples, its spec does not."""
    frames = retention.kept_frames(connection, run.id, first, last)
    if run.spec.retention is Retention.NUMBERS:
        return frames
    threshold = run.spec.detection_threshold
    frames -= retention.failing_frames(connection, run.id, first, last, threshold=threshold)
    return {frame for frame in frames if not _sampled(frame)}


def _shown(context: Context, run_id: str) -> set[FrameKey]:
    """Return the examples of findings and verdicts, which the run's evidence contains."""
    summary = orjson.loads(context.store.get(run_key(run_id, SUMMARY)))
    return {frame.key for frame in named_frames([summary["findings"], summary["verdicts"]])}


def _sampled(frame: FrameKey) -> bool:
    # A checksum, since steps of the index may be those of a grid.
    return crc32(b"%d" % frame.variant) % SAMPLED == 0
