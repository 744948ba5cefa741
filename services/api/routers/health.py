"""For machines that watch: alive, ready, metrics."""

from __future__ import annotations

from fastapi import APIRouter, Response, status

from services.api.dependencies import ContextDependency
from services.api.schemas import Health
from valerie.errors import ValerieError
from valerie.pipeline import monitoring

router = APIRouter(tags=["health"])


@router.get("/healthz", summary="The process answers")
def alive() -> Health:
    return Health(status="ok")


@router.get("/readyz", summary="Database, broker and artifact store answer", responses={503: {"model": Health}})
def ready(context: ContextDependency, response: Response) -> Health:
    checks = monitoring.check(context)
    if any(value != "ok" for value in checks.values()):
        response.status_code = status.HTTP_503_SERVICE_UNAVAILABLE
        return Health(status="unavailable", checks=checks)
    return Health(status="ok", checks=checks)


@router.get("/metrics", response_class=Response, summary="Prometheus metrics: queues, stages, failures, workers")
def metrics(context: ContextDependency) -> Response:
    try:
        text = monitoring.metrics(context)
    except ValerieError as error:
        return Response(f"# {error}\n", status_code=status.HTTP_503_SERVICE_UNAVAILABLE, media_type="text/plain")
    return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")
