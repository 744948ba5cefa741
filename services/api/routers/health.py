"""Probes and metrics for monitoring."""

from __future__ import annotations

from fastapi import APIRouter, Response, status
from fastapi.responses import PlainTextResponse

from services.api.dependencies import ContextDependency
from services.api.openapi import example, problems
from services.api.schemas.catalog import Health
from valerie.pipeline.control import monitoring

router = APIRouter(tags=["metrics"])


_UNAVAILABLE = {
    "status": "unavailable",
    "checks": {"database": "ok", "broker": "the broker does not answer", "artifacts": "ok"},
}
_METRICS = '# HELP valerie_products Unfinished products\nvalerie_products{route="eval",state="ready"} 3.0\n'


@router.get("/healthz", responses=example({"status": "ok", "checks": {}}), summary="Whether the process is alive")
def alive() -> Health:
    return Health(status="ok")


@router.get(
    "/readyz",
    responses={
        503: {
            "model": Health,
            "description": "One of them does not answer",
            "content": {"application/json": {"example": _UNAVAILABLE}},
        },
    },
    summary="Whether database, broker and artifact store answer",
)
def ready(context: ContextDependency, response: Response) -> Health:
    checks = monitoring.check(context)
    if any(value != "ok" for value in checks.values()):
        response.status_code = status.HTTP_503_SERVICE_UNAVAILABLE
        return Health(status="unavailable", checks=checks)
    return Health(status="ok", checks=checks)


@router.get(
    "/metrics",
    response_class=PlainTextResponse,
    responses={**problems(), **example(_METRICS, media_type="text/plain")},
    summary="Prometheus metrics: queues, stages, failures, workers",
)
def metrics(context: ContextDependency) -> PlainTextResponse:
    return PlainTextResponse(monitoring.metrics(context), media_type="text/plain; version=0.0.4; charset=utf-8")
