"""Read models: what the API answers with. Requests are the documents of `valerie.runs` themselves."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from services.api import examples
from valerie.analysis.findings import Findings
from valerie.analysis.summary import Summary
from valerie.runs.moments import in_utc

Moment = Annotated[datetime, AfterValidator(in_utc)]


class Read(BaseModel):
    """Base of all read models: built from rows by attribute."""

    model_config = ConfigDict(from_attributes=True)


def _example(value: Any) -> ConfigDict:
    return ConfigDict(from_attributes=True, json_schema_extra={"example": value})


class StageProgress(Read):
    done: int
    total: int = Field(description="exact once every variant is fed; extrapolated before")
    failed: int
    running: int = Field(description="products of this stage that workers hold at present, of all runs")
    rate_per_s: float
    eta_s: float | None = Field(description="None while nothing finishes")


class VariantProgress(Read):
    total: int
    fed: int
    rejected: int


class Progress(Read):
    model_config = _example(examples.PROGRESS)

    state: str
    reason: str | None = None
    variants: VariantProgress
    stages: dict[str, StageProgress] = Field(description="render counts frames; infer and eval count evaluations")
    updated_at: float | None = Field(description="Unix seconds of the count; None before the first")


class RunRead(Read):
    model_config = _example(examples.RUN)

    id: str
    name: str
    state: str
    reason: str | None = Field(description="why it waits, is paused or failed")
    spec_digest: str
    asset_digest: str
    parent_run: str | None
    iteration: int
    variant_count: int
    rejected_count: int
    pins: dict[str, Any] | None = Field(description="numeric classes that make the run's pixels")
    stages: dict[str, StageProgress] = Field(description="at the latest count; empty before the first")
    created_at: Moment
    started_at: Moment | None
    finished_at: Moment | None


class RunDetail(RunRead):
    model_config = _example({**examples.RUN, "spec": examples.SPEC})

    spec: dict[str, Any]


class RunPage(Read):
    model_config = _example({"items": [examples.RUN], "next": None})

    items: list[RunRead]
    next: str | None = Field(description="cursor of the next page; None on the last")


class VariantRead(Read):
    index: int
    block: int
    assignment: dict[str, Any] = Field(description="path to value; angles in degrees")
    rejection: str | None = Field(description="why no frame was made of it")


class VariantPage(Read):
    model_config = _example({"items": [examples.VARIANT], "next": "WzQxXQ"})

    items: list[VariantRead]
    next: str | None


class FrameRead(Read):
    id: str
    variant_index: int
    camera: str
    time_index: int
    time_s: float = Field(description="when the frame is taken; 0 in a run without time")
    background: str
    layer: str
    truth: str
    state: str = Field(description="done, failed, or the state of the slowest of its products")


class FramePage(Read):
    model_config = _example({"items": [examples.FRAME], "next": "WzQyLDEsMF0"})

    items: list[FrameRead]
    next: str | None


class PersonRead(Read):
    instance_id: int = Field(description="label id × 1000 + n; 0 stands for a scene without persons")
    character: str | None
    pixel_area: int
    pixel_area_percent: float
    pixel_area_amodal: int
    occlusion_rate: float | None
    truncation_rate: float | None
    distance_m: float | None
    depth_m: float | None
    bearing_deg: float | None = Field(description="from the optical axis, positive to the right")
    aspect_deg: float | None = Field(description="heading against the line of sight; 0 faces the camera")
    irradiance: float | None = Field(
        default=None, description="light on the body, 1 = clear noon sun; annotation light"
    )
    shadow_share: float | None = Field(
        default=None, description="share of the visible body in shadow; annotation light"
    )
    contrast: float | None = Field(default=None, description="to the ring around the body, −1…1; annotation light")
    box: list[int] | None = Field(description="x0, y0, x1, y1 of the visible pixels, end exclusive")
    amodal_box: list[int] | None
    undefined_reason: str | None = Field(description="why pACC has no value")


class PersonScoreRead(Read):
    instance_id: int
    tp: int
    fn: int
    pacc: float | None


class FrameEvaluation(Read):
    sensor: str
    function: str
    prediction: str
    scores: str
    state: str
    tp: int | None
    fp: int | None
    fn: int | None
    tn: int | None
    pacc: float | None
    precision: float | None
    iou: float | None
    pixel_accuracy: float | None
    miou: float | None
    fwiou: float | None
    macc: float | None
    judged_by: list[str] = Field(
        description="classes that pixel_accuracy, miou, fwiou and macc are over; empty: all 19"
    )
    persons: list[PersonScoreRead]
    images: dict[str, str] = Field(description="kind of picture to its address: what this function saw and made of it")


class SequenceRead(Read):
    frames: int = Field(
        description="moments of each variant and camera; their frames' ids differ in the last part alone"
    )
    step_s: float = Field(description="seconds from one to the next")


class FrameDetail(FrameRead):
    model_config = _example(examples.FRAME_DETAIL)

    run_id: str
    width: int
    height: int
    sequence: SequenceRead | None = Field(description="None: each variant and camera has one frame")
    assignment: dict[str, Any] = Field(description="of the variant, and where things that move are at the frame's time")
    annotations: dict[str, str] = Field(description="kind to product of the annotations that the run asked for")
    persons: list[PersonRead]
    evaluations: list[FrameEvaluation]
    images: dict[str, str] = Field(description="kind of picture to its address, behind the run's first sensor setting")
    previous: str | None = Field(description="frame before this one in the order of variants and cameras")
    next: str | None


class EvaluationRow(BaseModel):
    """One person in one evaluation; further members are the run's varied parameters, named by their paths."""

    model_config = ConfigDict(extra="allow")

    run_id: str
    variant_index: int
    frame_id: str
    camera: str
    time_s: float | None = Field(description="when the frame is taken, seconds")
    character: str | None
    sensor: str
    function: str
    instance_id: int | None = Field(description="None: the frame holds no person")
    pixel_area: int | None
    pixel_area_percent: float | None
    pixel_area_amodal: int | None
    occlusion_rate: float | None
    truncation_rate: float | None
    distance_m: float | None
    depth_m: float | None
    bearing_deg: float | None
    aspect_deg: float | None
    irradiance: float | None
    shadow_share: float | None
    contrast: float | None
    sun_azimuth_deg: float | None = Field(description="clockwise from north, whichever way the sun was given")
    sun_elevation_deg: float | None = Field(description="above the horizon")
    road_friction: float | None = Field(
        description="peak friction of new tyres on this road in this weather, at 50 km/h"
    )
    tp: int
    fn: int
    pacc: float | None
    undefined_reason: str | None
    precision: float | None = Field(description="of the frame, as are iou, pixel_accuracy and fp")
    iou: float | None
    pixel_accuracy: float | None
    fp: int


class EvaluationPage(Read):
    model_config = _example(examples.EVALUATIONS)

    items: list[EvaluationRow]
    total: int = Field(description="rows that the filters let through, at this moment")
    next: str | None = Field(description="cursor of the next page; None on the last")


class PlotAxis(Read):
    column: str = Field(description="of the long table: a fixed one, or the path of a varied parameter")
    title: str
    unit: str = Field(description="behind numbers that were multiplied by `scale`; may be empty")
    scale: float
    group: str = Field(description="person, conditions or varied")


class PointColumns(Read):
    """Points of a scatter plot, column by column: the i-th entries belong together."""

    model_config = _example(examples.POINTS)

    column: str
    functions: list[str]
    sensors: list[str]
    cameras: list[str]
    characters: list[str]
    x: list[float] = Field(description="values of the column")
    pacc: list[float]
    variant: list[int]
    camera: list[int] = Field(description="position in `cameras`; so are the next three in theirs")
    time: list[int]
    sensor: list[int]
    function: list[int]
    character: list[int] = Field(description="-1 where it has none")
    instance: list[int]
    undefined: dict[str, int] = Field(description="person-frames without a pACC, by reason")
    share: float = Field(description="share of the variants that is shown; below 1 it is an even sample")
    axes: list[PlotAxis] = Field(description="what this run's pACC can be plotted over")


class SummaryRead(Read):
    """The table of the paper's section 6.2, and sentences that the numbers wrote."""

    model_config = _example(examples.SUMMARY)

    summary: Summary
    findings: Findings


class Failure(Read):
    variant_index: int
    camera_index: int
    time_index: int
    digest: str
    kind: str
    error: dict[str, Any] | None = Field(description="stage, type, message, attempts; or the cause: a failed input")


class AssetEntry(Read):
    name: str
    title: str
    digest: str
    cameras: list[str]
    problem: str | None = Field(None, description="why it cannot be used; the rest is empty then")


class AssetRead(BaseModel):
    """The asset's manifest without its outlines."""

    model_config = ConfigDict(extra="allow", json_schema_extra={"example": examples.ASSET})

    name: str
    digest: str
    title: str
    description: str
    cameras: list[str]
    persons: list[str]
    movable: list[str]
    parameters: list[dict[str, Any]] = Field(description="name, path, type, bounds, unit, default")


class RendererRead(Read):
    name: str
    numeric_classes: list[str] = Field(description="in which living workers offer it")


class FunctionRead(Read):
    name: str
    digest: str = Field(description="of a registered version 32 characters, of an installed function those of its file")
    architecture: str
    precision: str
    engine: str
    provenance: dict[str, str]
    numeric_classes: list[str] = Field(description="in which living workers offer it")
    problem: str | None = Field(None, description="why it cannot be used; the rest is empty then")
    reference: str | None = Field(None, description="what a spec writes to mean this version; None: installed")
    kind: str | None = Field(
        None, description="network, onnx, huggingface, http or predictions; None: a class of an installed package"
    )
    version: int | None = Field(None, description="counts the versions of a registered name")
    classes: list[str] | None = Field(None, description="Cityscapes classes that it can predict")
    unmapped: list[str] | None = Field(None, description="its own classes that count as void")
    judged_by: list[str] = Field(
        [], description="Cityscapes classes that its all-class figures are over; empty: all 19"
    )
    card: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = Field(
        description="title and text of each row of its card, for people to read"
    )
    created_at: Moment | None = None


class FunctionDetail(FunctionRead):
    model_config = _example(examples.FUNCTION)

    document: dict[str, Any] | None = Field(None, description="of a registered version; see docs/functions.md")
    check: dict[str, Any] | None = Field(None, description="what trying it out said, when it was registered just now")


class PredictionRead(Read):
    model_config = _example(examples.PREDICTION)

    frame_id: str
    new: bool = Field(description="False: the same label map was there already")


class LabelRead(Read):
    name: str
    id: int = Field(description="Cityscapes label id, as in ground truth")
    train_id: int = Field(description="as networks speak; 255 is void")
    category: str
    has_instances: bool
    color: tuple[int, int, int] = Field(description="sRGB, 0…255")


class WorkerRead(Read):
    id: str
    stage: str
    host: str
    pid: int
    offers: list[dict[str, Any]]
    started_at: float
    seen_at: float


class QueueRead(Read):
    route: str = Field(description="stage, engine and numeric class")
    waiting: int = Field(description="products whose inputs are not there yet")
    ready: int
    running: int
    messages: int | None = Field(description="in the broker; None where it does not answer")
    workers: int = Field(description="living workers that serve it")


class Health(Read):
    status: str
    checks: dict[str, str] = Field(default_factory=dict, description="ok, or the reason")
