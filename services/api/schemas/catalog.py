"""Answers about the names that a spec may use, the columns of results, and the running processes."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from services.api.schemas.base import CAMERAS, NUMERIC_CLASS, Digest, Read
from valerie.measures import Source
from valerie.parameters.definitions import ParameterDefinition
from valerie.runs.products.pins import AnyOffer
from valerie.runs.products.states import ProductKind

_PARAMETER = {
    "name": "person-1.pos.x",
    "path": "scene.person-1.pos.x",
    "type": "FLOAT",
    "minimum": -10.0,
    "maximum": 20.0,
    "choices": [],
    "unit": "m",
    "default": 3.0,
    "affects": "geometry",
    "description": "",
}
_PERSONS = ["scene.person-1", "scene.person-2"]


class AssetEntry(Read):
    name: str = Field(examples=["urban-street"])
    title: str = Field(examples=["Urban street"])
    digest: Digest
    cameras: list[str] = Field(examples=[CAMERAS])
    problem: str | None = Field(None, description="why it cannot be used; all other fields but the name are empty then")


class AssetRead(Read):
    """The asset's manifest without its outlines."""

    model_config = ConfigDict(extra="allow")

    name: str = Field(examples=["urban-street"])
    digest: Digest
    title: str = Field(examples=["Urban street"])
    description: str = Field(examples=["A generated street of 165 m with houses, trees, vehicles and pedestrians."])
    cameras: list[str] = Field(examples=[CAMERAS])
    persons: list[str] = Field(examples=[_PERSONS])
    movable: list[str] = Field(examples=[_PERSONS])
    parameters: list[ParameterDefinition] = Field(examples=[[_PARAMETER]])


class MeasureRead(Read):
    """One column of the long table, and how to show its values."""

    name: str = Field(description="of the column", examples=["distance_m"])
    source: Source = Field(examples=["place"])
    title: str = Field(examples=["distance"])
    description: str = Field(examples=["Euclidean distance from the optical centre to the person"])
    unit: str = Field(description="shown after a number that was multiplied by `scale`", examples=["m"])
    scale: float = Field(examples=[1.0])
    digits: int = Field(description="decimals of a shown number", examples=[2])


class RendererRead(Read):
    name: str = Field(examples=["raster"])
    numeric_classes: list[str] = Field(description="in which living workers offer it", examples=[[NUMERIC_CLASS]])


class LabelRead(Read):
    name: str = Field(examples=["person"])
    id: int = Field(description="Cityscapes label id, as in ground truth", examples=[24])
    train_id: int = Field(description="Cityscapes train id, as networks use it; 255 is void", examples=[11])
    category: str = Field(examples=["human"])
    has_instances: bool = Field(examples=[True])
    color: tuple[int, int, int] = Field(description="sRGB, 0…255", examples=[[220, 20, 60]])


class WorkerRead(Read):
    id: str = Field(examples=["workstation-4711-1f2e3d4c"])
    stage: str = Field(examples=["infer"])
    host: str = Field(examples=["workstation"])
    pid: int = Field(examples=[4711])
    offers: list[AnyOffer] = Field(
        description="engines and functions that it runs",
        examples=[
            [
                {
                    "stage": "infer",
                    "name": "openvino/fp32",
                    "numeric_class": "openvino-2026.4.1-cpu-fp32-amx-t2",
                    "revision": 1,
                    "route": "infer.openvino-2026.4.1-cpu-fp32-amx-t2",
                }
            ]
        ],
    )
    makes: dict[ProductKind, int] = Field(
        description="products that it makes at this moment, by kind", examples=[{"layer": 12}]
    )
    started_at: float = Field(description="Unix seconds", examples=[1764000000.0])
    seen_at: float = Field(description="time of its last heartbeat, Unix seconds", examples=[1764000042.0])
    resting: str | None = Field(
        description="why it was put aside: its last products failed, and so did the test of its machine; null if it works",
        examples=[None],
    )
    clock: str | None = Field(
        description="by how much its clock differs from the database's, and what that does; null up to 5 s",
        examples=["7,200 s ahead of the database's: results are right, but times in its log are wrong"],
    )


class QueueRead(Read):
    route: str = Field(description="stage, engine and numeric class", examples=["infer.torch-2.9.0-cpu-fp32"])
    waiting: int | None = Field(
        description="products whose inputs are missing; null, as all numbers here, if not known in time", examples=[6]
    )
    ready: int | None = Field(examples=[12])
    running: int | None = Field(examples=[6])
    messages: int | None = Field(description="messages in the broker", examples=[2])
    workers: int | None = Field(description="living workers that serve it and are not put aside", examples=[1])
    per_minute: float | None = Field(description="products done in the last two minutes, per minute", examples=[36.5])


class DemandRead(Read):
    """Products that are ready or leased, and runs that wait for a worker or for their results."""

    render: dict[str, int] = Field(
        description="by engine, and truth", examples=[{"raster": 12, "pyrender": 0, "cycles": 0, "truth": 4}]
    )
    infer: int = Field(examples=[30])
    eval: int = Field(examples=[5])


class CostSeriesRead(Read):
    kind: ProductKind = Field(examples=["layer"])
    products: list[int] = Field(description="done in each span", examples=[[0, 24]])
    cpu_seconds: list[float | None] = Field(description="mean of these; null for none", examples=[[None, 0.34]])


class FailureReasonRead(Read):
    kind: ProductKind = Field(examples=["layer"])
    type: str = Field(description="class of the error", examples=["RenderingError"])
    products: int = Field(examples=[3])
    message: str = Field(description="of the latest", examples=["raster: the image is constant"])
    latest: float = Field(description="Unix seconds", examples=[1764000000.0])


class WorkRead(Read):
    """The recent products of a deployment, and the space left."""

    since: float = Field(description="beginning of the first span of time, Unix seconds", examples=[1764000000.0])
    span_s: float = Field(description="length of a span", examples=[60.0])
    costs: list[CostSeriesRead]
    failures: list[FailureReasonRead] = Field(
        description="reasons of products that failed for good, the most frequent first"
    )
    free_bytes: int | None = Field(description="of the artifact folder; null for a bucket", examples=[50000000000])
    min_free_bytes: int = Field(description="free space below which runs pause", examples=[209715200])


class Health(Read):
    status: str = Field(examples=["ok"])
    checks: dict[str, str] = Field(
        default_factory=dict,
        description="ok or the reason, by part of the system",
        examples=[{"database": "ok", "broker": "ok", "artifacts": "ok"}],
    )
