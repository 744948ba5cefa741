"""Uploaded predictions: label maps for the frames of a run whose function is of kind ``predictions``.

Such a prediction is a product like any other, on a route that no worker serves. It is *ready* when its frame is rendered, and
done when a user uploads the label map; until then its run is ``awaiting-predictions``. After the run's deadline, missing
predictions fail for good, with the deadline as the reason.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from valerie.db import functions, results, runs
from valerie.db.claiming import Job
from valerie.db.engine import reading
from valerie.db.publishing import Finished
from valerie.errors import Conflict, InvalidInput, NotFound, TransientError, UnknownName
from valerie.labels import VOID
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.label_png import decode_labels
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.deadlines import deadlines
from valerie.pipeline.base.resolved_runs import StoredRun, resolve_stored
from valerie.pipeline.work.stages import make_products
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.resolving.spec import ResolvedRun
from valerie.storage import codecs
from valerie.storage.keys import product_key


def put_prediction(
    context: Context, key: FrameKey, data: bytes, *, function: str | None = None, sensor: str | None = None
) -> bool:
    """Store the label map of one frame as its prediction.

    Args:
        context: context of this process.
        key: the frame.
        data: PNG of the frame's size with 8 bits per pixel; values are ids of the function's classes, 255 is void.
        function: name in the spec; None if the run awaits predictions of one function.
        sensor: sensor setting; None if the run has one.

    Returns:
        True if it is new; the same label map again changes nothing.

    Raises:
        NotFound: no such run or frame, or the function was removed.
        UnknownName, InvalidInput: no such function or sensor; not a label map, another size, an id without a class.
        Conflict: the frame already has another label map, it is not rendered yet, or the deadline has passed, or the
            run is archived.
    """
    with reading(context.engine) as connection:
        run = resolve_stored(runs.to_change(connection, key.run_id), context.settings)
        resolved = run.resolved
        place = _place(run, function, sensor)
        rows = results.frame_evaluations(connection, key)
        if not rows:
            raise NotFound("frame", key)
        digest = next(row.prediction for row in rows if (row.sensor_index, row.function_index) == place)
        name = resolved.spec.functions[place[1]]
        registered = functions.of_digest(connection, run.pins.functions[name].digest)
    if registered is None:
        raise NotFound("version of the function", f"{name}: it was removed")
    encoded, pixels = _encoded(data, registered.document, resolved)
    return _publish(context, digest, encoded, pixels)


class _Uploaded:
    """The maker of a prediction that was made elsewhere."""

    def __init__(self, context: Context, data: bytes, pixels: int) -> None:
        self._context, self._data, self._pixels = context, data, pixels

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        self._context.store.put(product_key("prediction", job.digest), self._data)
        return Finished(job.digest, len(self._data), self._pixels, 0.0)


def _place(run: StoredRun, function: str | None, sensor: str | None) -> tuple[int, int]:
    """Return the indices of sensor and function."""
    resolved = run.resolved
    awaited = tuple(deadlines(run.pins))
    if not awaited:
        raise Conflict(f"run {run.id} is not waiting for predictions")
    sensors = [setting.name for setting in resolved.spec.sensors]
    for kind, name, names in (("function", function, awaited), ("sensor", sensor, sensors)):
        if name is None and len(names) > 1:
            raise InvalidInput(f"which {kind}?", field=kind, limit=", ".join(names))
        if name is not None and name not in names:
            raise UnknownName(kind, name, names, field=kind)
    return (
        0 if sensor is None else sensors.index(sensor),
        resolved.spec.functions.index(awaited[0] if function is None else function),
    )


def _encoded(data: bytes, document: FunctionDocument, resolved: ResolvedRun) -> tuple[bytes, int]:
    """Return the stored object of a label map, and its number of pixels."""
    size, classes = resolved.spec.resolution, document.output.classes
    ids = decode_labels(data, size.height, size.width, field="label map")
    unknown = [number for number in np.unique(ids).tolist() if number >= len(classes) and number != VOID]
    if unknown:
        raise InvalidInput(
            "an id without a class",
            field="label map",
            value=", ".join(map(str, unknown[:8])),
            limit=f"0…{len(classes) - 1} as {document.name} declares its classes, or {VOID} for void",
        )
    return codecs.encode_prediction(document.output.lookup[ids]), int(ids.size)


def _publish(context: Context, digest: str, encoded: bytes, pixels: int) -> bool:
    key = product_key("prediction", digest)
    state = _state(context, digest)
    if state == "done":
        if context.store.get(key) != encoded:
            raise Conflict(
                "this frame already has another prediction, and results may depend on it; to upload others, register "
                "the function again with another document (for example, another provenance) and submit a run with it"
            )
        return False
    if state != "ready":
        raise Conflict(_WHY_NOT.get(state, f"the prediction is {state}"))
    # An interrupted upload may have left an object that no result uses; the first published one counts.
    context.store.delete(key)
    make_products(context, _Uploaded(context, encoded, pixels), [digest])
    state = _state(context, digest)
    if state == "parked":
        raise Conflict(_WHY_NOT[state])
    if state != "done":
        raise TransientError("the prediction could not be stored at present; try again")
    return True


def _state(context: Context, digest: str) -> str:
    with reading(context.engine) as connection:
        return results.product_states(connection, [digest])[digest]


_WHY_NOT: Final = {
    "waiting": "the frame is not rendered yet",
    "running": "another upload of the prediction of this frame is being stored",
    "parked": "no running run waits for this prediction",
    "failed": "the frame failed or its deadline has passed; `valerie retry` makes the run wait again",
}
