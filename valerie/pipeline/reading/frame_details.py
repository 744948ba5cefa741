"""The frames of a run with their products and states; of one frame also its persons, scores and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from valerie.db import results
from valerie.db.engine import reading
from valerie.db.links import StoredFrame
from valerie.measures import Source, names_from
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pins import pinned_card
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.reading.painting import ANNOTATION_KINDS, FRAME_KINDS, FUNCTION_KINDS
from valerie.pipeline.reading.tables import TableRow, character_of
from valerie.runs.frames import FrameKey
from valerie.runs.spec import ResolvedRun

_LIGHT: Final = names_from(Source.LIGHT)


class Address(Protocol):
    """Tells where a picture of a frame can be fetched."""

    def __call__(self, key: FrameKey, **parameters: str) -> str:
        """Return the address of the picture with these parameters: ``kind``, ``function``, ``sensor``."""
        ...


@dataclass(frozen=True, slots=True)
class FrameSummary:
    """A frame and its products.

    Attributes:
        id: frame id.
        variant_index, time_index: places in the run.
        camera: its name.
        time_s: when the frame is taken, seconds; 0 in a run without time.
        background, layer, truth: digests.
        state: ``done``, ``failed``, or the state of the slowest product.
    """

    id: str
    variant_index: int
    camera: str
    time_index: int
    time_s: float
    background: str
    layer: str
    truth: str
    state: str


@dataclass(frozen=True, slots=True)
class FrameSequence:
    """Number of frames of each variant and camera, and the seconds from one to the next."""

    frames: int
    step_s: float


@dataclass(frozen=True, slots=True)
class FrameDetails(FrameSummary):
    """A frame with its persons, scores and pictures.

    Attributes:
        run_id: the run.
        width, height: pixels.
        sequence: None where each variant and camera has one frame.
        assignment: path to value, of the variant and at the frame's time.
        annotations: kind to product.
        persons: how each person is seen; one row for instance 0 where the scene holds no person.
        evaluations: scores and pictures, one row per sensor setting and function.
        images: kind of picture to its address, behind the run's first sensor setting.
        previous, next: ids of the frames beside this one in the order of the run.
    """

    run_id: str
    width: int
    height: int
    sequence: FrameSequence | None
    assignment: Mapping[str, Any]
    annotations: Mapping[str, str]
    persons: tuple[TableRow, ...]
    evaluations: tuple[TableRow, ...]
    images: Mapping[str, str]
    previous: str | None
    next: str | None


def list_frames(context: Context, run_id: str, *, after: FrameKey | None, limit: int) -> list[FrameSummary]:
    """Return the frames of a run that follow one, in order.

    Raises:
        NotFound: no such run.
        Conflict, UnknownName: its asset changed or is gone.
    """
    resolved = read_run(context, run_id).resolved
    with reading(context.engine) as connection:
        page = results.frames_page(connection, run_id, after=after, limit=limit)
    return [FrameSummary(**_summary(frame, states, resolved)) for frame, states in page]


def frame_details(context: Context, key: FrameKey, address: Address) -> FrameDetails:
    """Return a frame with its persons, scores and pictures.

    Raises:
        NotFound: no such run or frame.
        Conflict, UnknownName: the run's asset changed or is gone.
    """
    run = read_run(context, key.run_id)
    resolved = run.resolved
    with reading(context.engine) as connection:
        frame = results.frame(connection, key)
        states = [results.product_state(connection, digest) for digest in frame.products.required]
        annotations = results.frame_annotations(connection, key)
        persons = results.person_views(connection, frame.products.truth)
        light = annotations.get("light")
        lights = {row.instance_id: row for row in results.person_lights(connection, light.product)} if light else {}
        evaluations = results.frame_evaluations(connection, key)
        scores = results.person_scores(connection, [row.scores for row in evaluations])
        previous, following = results.neighbours(connection, key)
    kinds = (*FRAME_KINDS, *(kind for kind in annotations if kind in ANNOTATION_KINDS))
    step = resolved.times.step
    return FrameDetails(
        **_summary(frame, states, resolved),
        run_id=key.run_id,
        width=resolved.spec.resolution.width,
        height=resolved.spec.resolution.height,
        sequence=None if step is None else FrameSequence(len(resolved.times.elapsed), step),
        assignment={**frame.assignment, **resolved.at(frame.assignment, key.time)},
        annotations={kind: link.product for kind, link in annotations.items()},
        persons=tuple(
            {
                **row._mapping,  # noqa: SLF001  # public in SQLAlchemy
                **{name: getattr(lights.get(row.instance_id), name, None) for name in _LIGHT},
                "character": character_of(row.instance_id, frame.assignment, resolved),
            }
            for row in persons
        ),
        evaluations=tuple(
            {**_evaluation(key, row, run, address), "persons": scores[row.scores]} for row in evaluations
        ),
        images={kind: address(key, kind=kind) for kind in kinds},
        previous=None if previous is None else str(previous),
        next=None if following is None else str(following),
    )


def _summary(frame: StoredFrame, states: Iterable[str], resolved: ResolvedRun) -> dict[str, Any]:
    """Return the fields of a `FrameSummary`."""
    return {
        "id": str(frame.key),
        "variant_index": frame.key.variant,
        "camera": resolved.cameras[frame.key.camera],
        "time_index": frame.key.time,
        "time_s": resolved.seconds(frame.assignment, frame.key.time),
        "background": frame.products.background,
        "layer": frame.products.layer,
        "truth": frame.products.truth,
        "state": _state(states),
    }


def _evaluation(key: FrameKey, row: Any, run: StoredRun, address: Address) -> TableRow:
    sensor = run.resolved.spec.sensors[row.sensor_index].name
    function = run.resolved.spec.functions[row.function_index]
    return {
        **row._mapping,  # noqa: SLF001  # public in SQLAlchemy
        "sensor": sensor,
        "function": function,
        "judged_by": pinned_card(run.pins, function).judged_by,
        "state": _state((row.prediction_state, row.scores_state)),
        "images": {
            kind: address(key, kind=kind, function=function, sensor=sensor) for kind in ("picture", *FUNCTION_KINDS)
        },
    }


def _state(states: Iterable[str]) -> str:
    """Return the state of several products: failed if one failed, done if all are, else that of the slowest."""
    present = set(states)
    order = ("failed", "parked", "waiting", "ready", "running")
    return next((state for state in order if state in present), "done")
