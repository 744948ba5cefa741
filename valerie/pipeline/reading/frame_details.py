"""The frames of a run with their products and states; for one frame also its persons, scores and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final, Protocol

from sqlalchemy import Connection

from valerie.db import frames, measured, results
from valerie.db.archives import reading_run
from valerie.db.links import StoredFrame
from valerie.db.measured import MeasuredPerson
from valerie.db.models import Assignment
from valerie.db.results import FrameEvaluation
from valerie.labels import PERSON, TRAIN_NAMES
from valerie.measures import Measures, Source, names_from
from valerie.parameters.definitions import Value
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.reading.tables import character_of
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import ANNOTATION_KINDS, FRAME_KINDS, FUNCTION_KINDS, PictureKind
from valerie.runs.products.states import ProductState
from valerie.runs.resolving.spec import ResolvedRun
from valerie.storage.codecs import decode_counts

_DARK: Final = dict.fromkeys(names_from(Source.LIGHT))
#: Most rejected variants between a frame and its neighbour.
_SKIPPED: Final = 60
_UNSCORED: Final = dict.fromkeys(("tp", "fn", "tn", "pacc", *names_from(Source.FRAME_SCORE)))


class Address(Protocol):
    """Function from a frame's picture to its address."""

    def __call__(self, key: FrameKey, **parameters: str) -> str:
        """Return the address of the picture with these parameters: ``kind``, ``function``, ``sensor``."""
        ...


@dataclass(frozen=True, slots=True)
class FrameSummary:
    """A frame and its products.

    Attributes:
        id: frame id.
        variant_index, time_index: indices in the run.
        camera: name of the camera.
        time_s: moment of the frame in seconds; 0 in a run without time.
        background, layer, truth: digests.
        state: ``done``, ``failed``, or the state of the slowest product.
        removed: why pictures of it are gone; None: none is.
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
    removed: str | None


@dataclass(frozen=True, slots=True)
class FrameSequence:
    """Number of frames per variant and camera, and the seconds between two frames."""

    frames: int
    step_s: float


@dataclass(frozen=True, slots=True)
class PersonDetails:
    """A person of a frame.

    Attributes:
        instance_id: label id × 1000 + n; 0 stands for a scene without persons.
        character: the pedestrian.
        box, amodal_box: x0, y0, x1, y1 of the visible pixels and of the whole person, end exclusive.
        measures: measures of place, pixels and light.
    """

    instance_id: int
    character: str | None
    box: Sequence[int] | None
    amodal_box: Sequence[int] | None
    measures: Measures


@dataclass(frozen=True, slots=True)
class EvaluationDetails:
    """An evaluation of a function on a frame through one sensor setting.

    Attributes:
        sensor, function: their names.
        prediction, scores: digests.
        state: ``done``, ``failed``, or the state of the slower product.
        infer_class: numeric class of the prediction.
        measures: scores of the class person and of the frame; None until done.
        called_instead: class that missed pixels of persons are called, to their number, most first.
        judged_by: classes of the scores over all classes; empty: all.
        persons: scores of the persons.
        images: kind of picture to its address.
    """

    sensor: str
    function: str
    prediction: str
    scores: str
    state: str
    infer_class: str
    measures: Measures
    called_instead: Mapping[str, int]
    judged_by: Sequence[str]
    persons: Sequence[MeasuredPerson]
    images: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A frame that differs from another in one parameter only, and its value there."""

    frame: str
    value: Value


@dataclass(frozen=True, slots=True)
class ParameterNeighbours:
    """The nearest frames that differ in one parameter only; None at an end.

    Attributes:
        parameter: its path, or ``camera``.
        before, after: in the order of the parameter's values in the run.
    """

    parameter: str
    before: Neighbour | None
    after: Neighbour | None


@dataclass(frozen=True, slots=True)
class FrameDetails(FrameSummary):
    """A frame with its persons, scores and pictures.

    Attributes:
        run_id: the run.
        width, height: pixels.
        sequence: None if each variant and camera has one frame.
        assignment: path to value, of the variant and at the frame's time.
        units: parameter path to unit, where there is one.
        render_class, truth_class: numeric classes of image and ground truth.
        annotations: kind to product.
        persons: the visible persons; in a scene without persons, one with instance 0.
        evaluations: one per sensor setting and function.
        images: kind of picture to its address, through the run's first sensor setting.
        previous, next: ids of the neighbouring frames in the order of the run.
        neighbours: of each parameter that a grid varies, and of the camera.
    """

    run_id: str
    width: int
    height: int
    sequence: FrameSequence | None
    assignment: Assignment
    units: dict[str, str]
    render_class: str
    truth_class: str
    annotations: Mapping[str, str]
    persons: tuple[PersonDetails, ...]
    evaluations: tuple[EvaluationDetails, ...]
    images: Mapping[str, str]
    previous: str | None
    next: str | None
    neighbours: tuple[ParameterNeighbours, ...]


def list_frames(context: Context, run_id: str, *, after: FrameKey | None, limit: int) -> list[FrameSummary]:
    """Return the frames of a run after a frame, in order.

    Raises:
        NotFound: no such run.
        Conflict, UnknownName: its asset changed or is gone.
    """
    resolved = read_run(context, run_id).resolved
    with reading_run(context.engine, run_id) as connection:
        page = frames.page(connection, run_id, after=after, limit=limit)
    return [_summary(frame, states, resolved) for frame, states in page]


def frame_details(context: Context, key: FrameKey, address: Address) -> FrameDetails:
    """Return a frame with its persons, scores and pictures.

    Raises:
        NotFound: no such run or frame.
        Conflict, UnknownName: the run's asset changed or is gone.
    """
    run = read_run(context, key.run_id)
    resolved = run.resolved
    with reading_run(context.engine, key.run_id) as connection:
        frame = frames.get(connection, key)
        states = list(results.product_states(connection, frame.products.required).values())
        annotations = frames.annotation_links(connection, key)
        persons = measured.person_views(connection, frame.products.truth)
        light = annotations.get("light")
        lit = measured.person_lights(connection, light.product) if light else []
        evaluations = results.frame_evaluations(connection, key)
        scores = measured.person_scores(connection, [row.scores for row in evaluations])
        previous, following = frames.neighbours(connection, key)
        neighbours = tuple(_neighbours(connection, key, resolved))
    lights = {person.instance_id: person.measures for person in lit}
    kinds = (*FRAME_KINDS, *(kind for kind in annotations if kind in ANNOTATION_KINDS))
    step, pins = resolved.times.step, run.pins.at(frame.assignment)
    return FrameDetails(
        **asdict(_summary(frame, states, resolved)),
        run_id=key.run_id,
        width=resolved.spec.resolution.width,
        height=resolved.spec.resolution.height,
        sequence=None if step is None else FrameSequence(len(resolved.times.elapsed), step),
        assignment={**frame.assignment, **resolved.at(frame.assignment, key.time)},
        units={d.path: d.unit_sign for d in resolved.definitions if d.unit},
        render_class=pins.engine.numeric_class,
        truth_class=pins.truth.numeric_class,
        annotations={kind: link.product for kind, link in annotations.items()},
        persons=tuple(
            PersonDetails(
                instance_id=person.instance_id,
                character=character_of(person.instance_id, frame.assignment, resolved),
                box=person.box,
                amodal_box=person.amodal_box,
                measures={**person.measures, **lights.get(person.instance_id, _DARK)},
            )
            for person in persons
        ),
        evaluations=tuple(_evaluation(frame, row, scores[row.scores], run, address) for row in evaluations),
        images={kind: address(key, kind=kind) for kind in kinds},
        previous=None if previous is None else str(previous),
        next=None if following is None else str(following),
        neighbours=neighbours,
    )


def _neighbours(connection: Connection, key: FrameKey, resolved: ResolvedRun) -> Iterator[ParameterNeighbours]:
    """Yield the neighbours in each parameter; rejected variants, up to `_SKIPPED` on end, are skipped."""
    cameras = [Neighbour(str(replace(key, camera=place)), name) for place, name in enumerate(resolved.cameras)]
    if len(cameras) > 1:
        before, after = cameras[: key.camera][-1:], cameras[key.camera + 1 :][:1]
        yield ParameterNeighbours("camera", *(side[0] if side else None for side in (before, after)))
    sides = {
        path: (line[: line.index(key.variant)][::-1][:_SKIPPED], line[line.index(key.variant) + 1 :][:_SKIPPED])
        for path, line in resolved.space.lines(key.variant).items()
        if len(line) > 1
    }
    variants = {variant for lines in sides.values() for line in lines for variant in line}
    present = frames.variants_with_frame(connection, key, variants)
    for path, lines in sides.items():
        nearest = [next((variant for variant in line if variant in present), None) for line in lines]
        yield ParameterNeighbours(
            path,
            *(
                None
                if variant is None
                else Neighbour(str(replace(key, variant=variant)), resolved.space[variant].values[path])
                for variant in nearest
            ),
        )


def _summary(frame: StoredFrame, states: Iterable[ProductState], resolved: ResolvedRun) -> FrameSummary:
    state = _state(states)
    return FrameSummary(
        id=str(frame.key),
        variant_index=frame.key.variant,
        camera=resolved.cameras[frame.key.camera],
        time_index=frame.key.time,
        time_s=resolved.seconds(frame.assignment, frame.key.time),
        background=frame.products.background,
        layer=frame.products.layer,
        truth=frame.products.truth,
        state=state,
        removed=None if state == ProductState.DONE else frame.removed,
    )


def _called_instead(confusion: bytes) -> dict[str, int]:
    counts = zip(TRAIN_NAMES.values(), decode_counts(confusion)[PERSON.train_id].tolist(), strict=True)
    missed = {name: count for name, count in counts if count and name != PERSON.name}
    return dict(sorted(missed.items(), key=lambda one: -one[1]))


def _evaluation(
    frame: StoredFrame, row: FrameEvaluation, persons: Sequence[MeasuredPerson], run: StoredRun, address: Address
) -> EvaluationDetails:
    sensor = run.resolved.spec.sensors[row.sensor_index].name
    function = run.resolved.spec.functions[row.function_index]
    pin = run.pins.at(frame.assignment).functions[function]
    return EvaluationDetails(
        sensor=sensor,
        function=function,
        prediction=row.prediction,
        scores=row.scores,
        # Scores stay where the prediction was removed.
        state=_state((row.scores_state,) if row.score else (row.prediction_state, row.scores_state)),
        infer_class=pin.numeric_class,
        measures=_UNSCORED if row.score is None else row.score.figures,
        called_instead={} if row.score is None else _called_instead(row.score.confusion),
        judged_by=pin.card.judged_by,
        persons=persons,
        images={
            kind: address(frame.key, kind=kind, function=function, sensor=sensor)
            for kind in (PictureKind.PICTURE, *FUNCTION_KINDS)
        },
    )


def _state(states: Iterable[ProductState]) -> ProductState:
    """Return the state of several products: failed if one failed, done if all are, otherwise that of the slowest."""
    present = set(states)
    order = (
        ProductState.FAILED, ProductState.PARKED, ProductState.WAITING, ProductState.READY, ProductState.RUNNING
    )  # fmt: skip
    return next((state for state in order if state in present), ProductState.DONE)
