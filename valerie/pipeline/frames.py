"""One frame of a run: its pictures, and making it again from scratch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.errors import Conflict, UnknownName
from valerie.parameters.assignment import digest
from valerie.pipeline.context import Context
from valerie.pipeline.makers.inputs import ProductReader
from valerie.pipeline.pictures import FUNCTION_KINDS, PAINTING_REVISION, FramePainter
from valerie.pipeline.resolution import resolve_stored
from valerie.sensing.sensor import REVISION as SENSING_REVISION
from valerie.sensing.settings import SensorSetting

#: Kinds that are drawn from the ground truth alone, and from the picture alone (a prediction apart).
_OF_TRUTH = ("truth", "instances", "depth")
_OF_IMAGE = ("picture", "overlay")


@dataclass(frozen=True, slots=True)
class PictureSource:
    """What one picture is made of; all of it is stored.

    Attributes:
        kind: one of `valerie.pipeline.pictures.KINDS`.
        background, layer, truth, prediction: digests; ``prediction`` is None where no function looked.
        sensor: the setting.
        assignment: path to value; its ``sensor.*`` part changes the picture.
    """

    kind: str
    background: str
    layer: str
    truth: str
    prediction: str | None
    sensor: SensorSetting
    assignment: Mapping[str, Any]

    @property
    def tag(self) -> str:
        """32 hexadecimal characters that stand for the painted picture, known before it is painted."""
        products = (self.background, self.layer, self.truth, self.prediction or "")
        radiometry = {path: value for path, value in self.assignment.items() if path.startswith("sensor.")}
        setting = self.sensor.model_dump(exclude={"name"})
        return digest("picture", PAINTING_REVISION, SENSING_REVISION, self.kind, products, setting, radiometry)


def find(
    context: Context,
    run_id: str,
    variant: int,
    camera: int,
    time: int = 0,
    *,
    kind: str,
    function: str | None = None,
    sensor: str | None = None,
) -> PictureSource:
    """Find what a picture is made of; ``function`` and ``sensor`` default to the run's first.

    Raises:
        NotFound: no such run or frame.
        UnknownName: no such function or sensor setting.
        Conflict: what the picture needs is not made yet.
    """
    with reading(context.engine) as connection:
        resolved = resolve_stored(runs.get(connection, run_id), context.settings)
        row = results.frame(connection, run_id, variant, camera, time)
        evaluations = results.frame_evaluations(connection, run_id, variant, camera, time)
        states = {
            product: results.product(connection, product).state for product in (row.background, row.layer, row.truth)
        }
    spec = resolved.spec
    function_index = _index("function", function, list(spec.functions))
    sensor_index = _index("sensor", sensor, [setting.name for setting in spec.sensors])
    chosen = next(
        (one for one in evaluations if (one.sensor_index, one.function_index) == (sensor_index, function_index)), None
    )
    missing = [states[product] for product in _needed(kind, row) if states[product] != "done"]
    if kind in FUNCTION_KINDS and chosen is not None and chosen.prediction_state != "done":
        missing.append(chosen.prediction_state)
    if missing:
        raise Conflict(f"the frame is not there yet: what the picture needs is {missing[0]}")
    return PictureSource(
        kind=kind,
        background=row.background,
        layer=row.layer,
        truth=row.truth,
        prediction=None if chosen is None else chosen.prediction,
        sensor=spec.sensors[sensor_index],
        assignment=row.assignment,
    )


def draw(context: Context, source: PictureSource) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB.

    Raises:
        UnknownName: no such kind, or it needs a function and the run has none.
        MissingInput: an object is gone.
    """
    return FramePainter(ProductReader(context.store)).paint(
        source.kind,
        background=source.background,
        layer=source.layer,
        truth=source.truth,
        prediction=source.prediction,
        sensor=source.sensor,
        assignment=source.assignment,
    )


def _needed(kind: str, row: Any) -> tuple[str, ...]:
    """Digests of what a kind of picture is drawn from, besides a prediction."""
    if kind in _OF_TRUTH:
        return (row.truth,)
    if kind in _OF_IMAGE:
        return (row.background, row.layer)
    return () if kind == "prediction" else (row.background, row.layer, row.truth)


def _index(what: str, name: str | None, names: Sequence[str]) -> int:
    if name is None:
        return 0
    if name not in names:
        raise UnknownName(what, name, names, field=what)
    return names.index(name)
