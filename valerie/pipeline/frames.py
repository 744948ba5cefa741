"""One frame of a run: its pictures, and making it again from scratch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.errors import Conflict, UnknownName
from valerie.pipeline.context import Context
from valerie.pipeline.makers.inputs import ProductReader
from valerie.pipeline.pictures import FUNCTION_KINDS, FramePainter
from valerie.pipeline.resolution import resolve_stored

#: Kinds that are drawn from the ground truth alone.
_OF_TRUTH = ("truth", "instances", "depth")


def paint(
    context: Context,
    run_id: str,
    variant: int,
    camera: int,
    time: int = 0,
    *,
    kind: str,
    function: str | None = None,
    sensor: str | None = None,
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB; ``function`` and ``sensor`` default to the run's first.

    Raises:
        NotFound: no such run or frame.
        UnknownName: no such kind, function or sensor setting.
        Conflict: what the picture needs is not made yet.
    """
    with reading(context.engine) as connection:
        resolved = resolve_stored(runs.get(connection, run_id), context.settings)
        row = results.frame(connection, run_id, variant, camera, time)
        evaluations = results.frame_evaluations(connection, run_id, variant, camera, time)
        states = {
            digest: results.product(connection, digest).state for digest in (row.background, row.layer, row.truth)
        }
    spec = resolved.spec
    function_index = _index("function", function, list(spec.functions))
    sensor_index = _index("sensor", sensor, [setting.name for setting in spec.sensors])
    chosen = next(
        (one for one in evaluations if (one.sensor_index, one.function_index) == (sensor_index, function_index)), None
    )
    needed = [row.truth] if kind in _OF_TRUTH else [row.background, row.layer, row.truth]
    missing = [states[digest] for digest in needed if states[digest] != "done"]
    if kind in FUNCTION_KINDS and chosen is not None and chosen.prediction_state != "done":
        missing.append(chosen.prediction_state)
    if missing:
        raise Conflict(f"the frame is not there yet: what the picture needs is {missing[0]}")
    return FramePainter(ProductReader(context.store)).paint(
        kind,
        background=row.background,
        layer=row.layer,
        truth=row.truth,
        prediction=None if chosen is None else chosen.prediction,
        sensor=spec.sensors[sensor_index],
        assignment=row.assignment,
    )


def _index(what: str, name: str | None, names: Sequence[str]) -> int:
    if name is None:
        return 0
    if name not in names:
        raise UnknownName(what, name, names, field=what)
    return names.index(name)
