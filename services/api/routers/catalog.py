"""Assets with their parameters, render engines, classes, columns of results, and the processes at work."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query

from services.api.dependencies import ContextDependency, ProjectDependency
from services.api.openapi import gives, problems
from services.api.problems import named_by_address
from services.api.schemas.catalog import (
    AssetEntry,
    AssetRead,
    DemandRead,
    LabelRead,
    MeasureRead,
    QueueRead,
    RendererRead,
    WorkerRead,
    WorkRead,
)
from valerie.labels import CITYSCAPES
from valerie.measures import MEASURES
from valerie.pipeline.control import monitoring
from valerie.pipeline.functions import catalog

router = APIRouter(prefix="/v1", tags=["catalog"])

#: For tokens of one project, in place of a message.
_OF_ALL = "shown to tokens of no project, since it may be another project's"
Name = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$", examples=["urban-street"])]


@router.get(
    "/assets",
    responses={**problems(422), **gives(200, ("name", "/v1/assets", "/0/name"))},
    summary="Assets that a spec may name",
)
def assets(context: ContextDependency) -> list[AssetEntry]:
    return [AssetEntry.model_validate(entry) for entry in catalog.assets(context.settings)]


@router.get("/assets/{name}", responses=problems(404, 422), summary="An asset with its parameters")
def asset(name: Name, context: ContextDependency) -> AssetRead:
    with named_by_address():
        return AssetRead.model_validate(catalog.asset(context.settings, name))


@router.get(
    "/renderers",
    responses=problems(422),
    summary="Render engines, and the numeric classes in which living workers offer them",
)
def renderers(context: ContextDependency) -> list[RendererRead]:
    return [RendererRead.model_validate(entry) for entry in catalog.renderers(context)]


@router.get(
    "/labels",
    responses=problems(422),
    summary="Classes of ground truth and predictions, with the colours of their pictures",
)
def labels() -> list[LabelRead]:
    return [LabelRead.model_validate(label) for label in CITYSCAPES]


@router.get("/measures", responses=problems(422), summary="Columns of the long table, and how to show their values")
def measures() -> list[MeasureRead]:
    return [MeasureRead.model_validate(measure) for measure in MEASURES]


@router.get("/workers", responses=problems(422), summary="Living worker processes, and what they do")
def workers(context: ContextDependency) -> list[WorkerRead]:
    return [WorkerRead.model_validate(worker) for worker in monitoring.workers(context)]


@router.get(
    "/queues",
    responses=problems(422),
    summary="Queues: unfinished products in the database, messages in the broker, living workers",
)
def queues(context: ContextDependency) -> list[QueueRead]:
    return [QueueRead.model_validate(entry) for entry in monitoring.queues(context)]


@router.get(
    "/demand",
    responses=problems(422),
    summary="Work for each pool of workers, for autoscalers",
)
def demand(context: ContextDependency) -> DemandRead:
    return DemandRead.model_validate(monitoring.demand(context))


@router.get(
    "/work",
    responses=problems(422),
    summary="Cost of products over time, reasons of failures, and the space left",
)
def work(
    context: ContextDependency,
    project: ProjectDependency,
    hours: Annotated[int, Query(ge=1, le=720, description="how far back", examples=[24])] = 24,
) -> WorkRead:
    read = WorkRead.model_validate(monitoring.work(context, hours))
    for reason in read.failures if project else ():
        reason.message = _OF_ALL  # it may name what other projects have
    return read
