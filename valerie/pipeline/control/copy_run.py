"""Copy a run, with all that it needs, from one deployment into another. A data folder is a deployment, too."""

from __future__ import annotations

import time

from valerie.db import copying, functions, runs
from valerie.db.archives import reading_run
from valerie.db.engine import reading, writing
from valerie.document import Document
from valerie.errors import Conflict
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.progress import Pace
from valerie.storage.keys import function_key, is_archive_key, product_key, run_prefix
from valerie.storage.store import copy_objects


class Copied(Document):
    """The content of a copy.

    Attributes:
        run: id of the run.
        objects: number of stored objects: products, functions and results.
        bytes: their total size.
    """

    run: str
    objects: int
    bytes: int


def copy_run(source: Context, target: Context, run_id: str, *, progress: Pace = lambda *_: None) -> Copied:
    """Copy an ended run with its products, functions under test, results and marks.

    The objects come first, so that a copy that is interrupted leaves only objects, which `gc` removes. Objects that the target
    has are kept. Assets of users are not part of a deployment's storage and are not copied.

    Args:
        source, target: two deployments of this version.
        run_id: id of the run.
        progress: is told the objects so far.

    Raises:
        NotFound: the source has no such run.
        Conflict: the run has not ended; or as `valerie.db.copying.copy_rows`.
    """
    with reading_run(source.engine, run_id) as connection:
        run = runs.get(connection, run_id)
        if run.state in runs.ACTIVE:
            raise Conflict(f"run {run_id} is {run.state}: it can be copied when it has ended or is cancelled")
        pins = () if run.pins is None else run.pins.functions.values()
        stored = copying.stored_products(connection, run_id)
    with reading(source.engine) as connection:
        registered = [row for pin in pins if (row := functions.of_digest(connection, pin.digest)) is not None]
    payloads = [row.document.payload for row in registered if row.document.payload is not None]
    keys = [function_key(payload.sha256, payload.format) for payload in payloads]
    keys += [product_key(product.kind, product.digest) for product in stored if product.kind.has_object]
    own = [info.key for info in source.store.list(run_prefix(run_id).rstrip("/"))]
    keys += [key for key in own if not is_archive_key(key)]  # a copy is not archived
    size, started = 0, time.monotonic()
    for number, bytes_copied in enumerate(copy_objects(source.store, target.store, keys), start=1):
        size += bytes_copied
        progress(number, len(keys), number / max(time.monotonic() - started, 1e-6), "")
    with reading_run(source.engine, run_id) as connection, writing(target.engine) as other:
        for row in registered:
            functions.register(other, row.document, row.created_at)
        copying.copy_rows(connection, other, run_id)
    return Copied(run=run_id, objects=len(keys), bytes=size)
