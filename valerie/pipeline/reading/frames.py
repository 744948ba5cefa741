"""One frame of a run: its pictures, and making it again from scratch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.errors import Conflict, UnknownName
from valerie.parameters.assignment import digest
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.reading.capture import Capture, capture_of
from valerie.pipeline.reading.pictures import (
    ANNOTATION_KINDS,
    FRAME_KINDS,
    FUNCTION_KINDS,
    PAINTING_REVISION,
    FramePainter,
)
from valerie.pipeline.reading.products import ProductReader
from valerie.rendering.annotations.kinds import AnnotationKind

#: Kinds that are drawn from the ground truth alone, and from the picture alone (a prediction apart).
_OF_TRUTH = ("truth", "instances", "depth")
_OF_IMAGE = ("picture", "overlay", "boxes", "joints")


@dataclass(frozen=True, slots=True)
class PictureSource:
    """What one picture is made of; all of it is stored.

    Attributes:
        kind: one of `valerie.pipeline.reading.pictures.KINDS`.
        capture: the frame and the sensor that sees it.
        prediction: digest; None where no function looked.
        annotation: digest, of a kind that shows one.
    """

    kind: str
    capture: Capture
    prediction: str | None
    annotation: str | None = None

    @property
    def tag(self) -> str:
        """32 hexadecimal characters that stand for the painted picture, known before it is painted."""
        return digest(
            "picture", PAINTING_REVISION, self.kind, self.capture.tag, self.prediction or self.annotation or ""
        )


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
        annotations = results.frame_annotations(connection, run_id, variant, camera, time)
        evaluations = results.frame_evaluations(connection, run_id, variant, camera, time)
        states = {
            product: results.product(connection, product).state for product in (row.background, row.layer, row.truth)
        } | {one.product: one.state for one in annotations.values()}
    spec = resolved.spec
    function_index = _index("function", function, list(spec.functions))
    sensor_index = _index("sensor", sensor, [setting.name for setting in spec.sensors])
    chosen = next(
        (one for one in evaluations if (one.sensor_index, one.function_index) == (sensor_index, function_index)), None
    )
    velocity = annotations["velocity"].product if "velocity" in annotations else None
    capture = capture_of(
        resolved,
        sensor_index=sensor_index,
        camera_index=camera,
        assignment=resolved.at(row.assignment, time),
        background=row.background,
        layer=row.layer,
        truth=row.truth,
        velocity=velocity,
    )
    missing = [states[product] for product in _needed(kind, capture) if states[product] != "done"]
    if kind in FUNCTION_KINDS and chosen is not None and chosen.prediction_state != "done":
        missing.append(chosen.prediction_state)
    if kind in ANNOTATION_KINDS:
        if kind not in annotations:
            raise UnknownName(
                "kind of picture",
                kind,
                (*FRAME_KINDS, *FUNCTION_KINDS, *(one for one in annotations if one in ANNOTATION_KINDS)),
                field="kind",
            )
        missing += [one.state for one in (annotations[kind],) if one.state != "done"]
    if missing:
        raise Conflict(f"the frame is not there yet: what the picture needs is {missing[0]}")
    annotation = annotations[kind].product if kind in ANNOTATION_KINDS else None
    return PictureSource(kind, capture, None if chosen is None else chosen.prediction, annotation)


def draw(context: Context, source: PictureSource) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB.

    Raises:
        UnknownName: no such kind, or it needs a function and the run has none.
        MissingInput: an object is gone.
    """
    painter = FramePainter(ProductReader(context.store))
    return painter.paint(
        source.kind, capture=source.capture, prediction=source.prediction, annotation=source.annotation
    )


def _needed(kind: str, capture: Capture) -> tuple[str, ...]:
    """Digests of what a kind of picture is drawn from, besides a prediction."""
    if kind in ("prediction", AnnotationKind.NORMALS):
        return ()
    image, truth = (capture.background, capture.layer), (capture.truth,)
    moving = (capture.velocity,) if capture.velocity is not None and capture.setting.needs_velocity else ()
    if kind in _OF_TRUTH:
        return (*truth, *moving)
    return image if kind in _OF_IMAGE and not capture.setting.needs_depth else (*image, *truth, *moving)


def _index(what: str, name: str | None, names: Sequence[str]) -> int:
    if name is None:
        return 0
    if name not in names:
        raise UnknownName(what, name, names, field=what)
    return names.index(name)
