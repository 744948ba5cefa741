"""Answers about runs and their progress."""

from __future__ import annotations

from typing import Final

from pydantic import Field, JsonValue

from services.api.schemas.base import DIGEST, NUMERIC_CLASS, RUN_ID, Digest, NextCursor, Read
from valerie.runs.moments import Moment
from valerie.runs.products.pins import AnyPins
from valerie.runs.products.ready import ProductError
from valerie.runs.products.states import Priority, RunState, Stage

#: The paper's two lists (section 4) in its own notation.
SPEC: Final[dict[str, JsonValue]] = {
    "name": "two lists of the paper",
    "asset": "urban-street",
    "parameters": [
        ["p1", "scene.person-1.pos.x", "FLOAT", 0.0, 20.0],
        ["p2", "scene.person-1.pos.y", "FLOAT", 0.0, 10.0],
    ],
    "vary": [["p1", "HOMOGENEOUS", 1.5, 5.5, 1.0], ["p2", "HOMOGENEOUS", 4.0, 5.0, 1.0]],
    "functions": ["deeplabv3plus-small"],
}

_OFFER: Final = {
    "stage": "render",
    "name": "raster",
    "numeric_class": NUMERIC_CLASS,
    "revision": 1,
    "route": f"render.raster.{NUMERIC_CLASS}",
}


class StageProgress(Read):
    done: int = Field(examples=[24])
    total: int = Field(description="exact once every variant is fed, an extrapolation before", examples=[30])
    failed: int = Field(examples=[0])
    running: int = Field(description="products of this stage that workers hold now, of all runs", examples=[6])
    rate_per_s: float = Field(description="finished per second", examples=[6.1])
    eta_s: float | None = Field(description="seconds that remain; null until ten have finished", examples=[1.0])


class VariantProgress(Read):
    total: int = Field(examples=[10])
    fed: int = Field(description="variants that have rows in the database", examples=[10])
    rejected: int = Field(examples=[0])


class Progress(Read):
    state: RunState = Field(examples=["running"])
    reason: str | None = Field(None, description="why the run waits, is paused or failed")
    variants: VariantProgress
    stages: dict[Stage, StageProgress] = Field(description="render counts frames; infer and eval count evaluations")
    outlook: str | None = Field(
        None,
        description="whether it will be done by its deadline at the present rate; null without one, and after its end",
        examples=["deadline in 3 h 0 min, done in about 2 h 10 min"],
    )
    updated_at: float | None = Field(
        description="time of the count, Unix seconds; null before the first", examples=[1764000000.0]
    )


class RunRead(Read):
    id: str = Field(examples=[RUN_ID])
    name: str = Field(examples=["two lists of the paper"])
    state: RunState = Field(examples=["running"])
    reason: str | None = Field(description="why the run waits, is paused or failed")
    spec_digest: Digest
    asset_digest: Digest
    parent_run: str | None
    iteration: int = Field(examples=[0])
    variant_count: int = Field(examples=[10])
    rejected_count: int = Field(examples=[0])
    priority: Priority = Field(examples=["normal"])
    deadline: Moment | None = Field(description="when it should be done", examples=["2026-12-01T06:00:00Z"])
    project: str = Field(description="of the token that submitted it; empty: none", examples=["radar"])
    pins: AnyPins | None = Field(
        description="engines and functions in the numeric classes that the run keeps from its start; null before",
        examples=[{"engine": _OFFER, "truth": {**_OFFER, "name": "truth"}, "functions": {}}],
    )
    stages: dict[Stage, StageProgress] = Field(description="at the latest count; empty before the first")
    tags: list[str] = Field(description="that people put on it", examples=[["night"]])
    archived: bool = Field(
        description="whether its rows are in the artifact store; `unarchive` makes it changeable", examples=[False]
    )
    created_at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
    started_at: Moment | None = Field(examples=["2026-11-21T02:43:09Z"])
    finished_at: Moment | None


class RunDetail(RunRead):
    spec: dict[str, JsonValue] = Field(examples=[SPEC])


class RunPage(Read):
    items: list[RunRead]
    next: NextCursor


class RelativeRead(Read):
    id: str = Field(examples=[RUN_ID])
    name: str = Field(examples=["two lists of the paper"])
    state: RunState = Field(examples=["completed"])
    parent_run: str | None = Field(description="the run that it goes on from")
    iteration: int = Field(examples=[0])
    created_at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
    study: str | None = Field(description="id of the study that made it as a batch")


class Failure(Read):
    variant_index: int = Field(examples=[4])
    camera_index: int = Field(examples=[0])
    time_index: int = Field(examples=[0])
    digest: str = Field(description="of the product", examples=[DIGEST])
    kind: str = Field(description="of the product", examples=["layer"])
    error: ProductError = Field(
        description="stage, type, message and attempts; or the digest of the failed input as cause",
        examples=[
            {"stage": "layer", "type": "RenderingError", "message": "raster: the image is constant", "attempts": 1}
        ],
    )
