"""Read models: what the API answers with. Requests are the documents of `valerie.runs` themselves."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Read(BaseModel):
    """Base of all read models: built from rows by attribute."""

    model_config = ConfigDict(from_attributes=True)


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
    state: str
    reason: str | None = None
    variants: VariantProgress
    stages: dict[str, StageProgress] = Field(description="render counts frames; infer and eval count evaluations")
    updated_at: float | None = Field(description="Unix seconds of the count; None before the first")

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "state": "running",
                "reason": None,
                "variants": {"total": 48, "fed": 48, "rejected": 2},
                "stages": {
                    "render": {"done": 80, "total": 138, "failed": 0, "running": 12, "rate_per_s": 6.1, "eta_s": 9.5},
                    "infer": {"done": 120, "total": 276, "failed": 0, "running": 6, "rate_per_s": 4.0, "eta_s": 39.0},
                    "eval": {"done": 118, "total": 276, "failed": 0, "running": 1, "rate_per_s": 4.0, "eta_s": 39.5},
                },
                "updated_at": 1764000000.0,
            }
        }
    )


class RunRead(Read):
    id: str
    name: str
    state: str
    reason: str | None
    spec_digest: str
    asset_digest: str
    parent_run: str | None
    iteration: int
    variant_count: int
    rejected_count: int
    pins: dict[str, Any] | None = Field(description="numeric classes that make the run's pixels")
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None


class RunDetail(RunRead):
    spec: dict[str, Any]


class RunPage(Read):
    items: list[RunRead]
    next: str | None = Field(description="cursor of the next page; None on the last")


class VariantRead(Read):
    index: int
    block: int
    assignment: dict[str, Any] = Field(description="path to value; angles in degrees")
    rejection: str | None = Field(description="why no frame was made of it")


class VariantPage(Read):
    items: list[VariantRead]
    next: str | None


class FrameRead(Read):
    id: str
    variant_index: int
    camera: str
    time_index: int
    background: str
    layer: str
    truth: str
    state: str = Field(description="done, failed, or the state of the slowest of its products")


class FramePage(Read):
    items: list[FrameRead]
    next: str | None


class PersonRead(Read):
    instance_id: int
    pixel_area: int
    pixel_area_percent: float
    pixel_area_amodal: int
    occlusion_rate: float | None
    truncation_rate: float | None
    distance_m: float | None
    depth_m: float | None
    box: list[int] | None
    amodal_box: list[int] | None
    undefined_reason: str | None


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


class FrameDetail(FrameRead):
    assignment: dict[str, Any]
    persons: list[PersonRead]
    evaluations: list[FrameEvaluation]
    images: dict[str, str] = Field(description="kind of picture to its address")


class EvaluationPage(Read):
    items: list[dict[str, Any]]
    total: int
    offset: int
    limit: int


class Failure(Read):
    variant_index: int
    camera_index: int
    time_index: int
    digest: str
    kind: str
    error: dict[str, Any] | None


class WorkerRead(Read):
    id: str
    stage: str
    host: str
    pid: int
    offers: list[dict[str, Any]]
    started_at: float
    seen_at: float


class Health(Read):
    status: str
    checks: dict[str, str] = Field(default_factory=dict)
