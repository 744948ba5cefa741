"""The OpenAPI document: problem documents of every endpoint, the bearer token, one example per answer."""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from typing import Any, Final

from fastapi import APIRouter, FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute

from services.api import schemas
from services.api.problems import INVALID_INPUT, MEDIA_TYPE, Problem

#: Status to what it means here and an example of its detail.
_MEANINGS: Final[dict[int, tuple[str, str, str]]] = {
    401: ("The bearer token is missing or wrong", "Unauthorized", "a bearer token is needed (Authorization header)"),
    403: (
        "Another site's page asks, or under another name",
        "Forbidden",
        "requests of another site's pages are refused",
    ),
    404: ("There is no such thing (any more)", "Not found", "there is no run r1ng219w3v1ks"),
    409: (
        "Its state does not allow this",
        "Conflict",
        "run r1ng219w3v1ks is completed; this is possible when it is running",
    ),
    413: ("The body is too long", INVALID_INPUT, "the request body is too large: 10000000 bytes; limit: 2000000"),
    416: (
        "The range begins beyond the end",
        INVALID_INPUT,
        "range: it begins beyond the end; limit: 2190 bytes",
    ),
    422: ("Something that was given is wrong: field, value and limit", INVALID_INPUT, "step: must be above 0; got 0"),
    501: (
        "This needs a library that is not installed where the server runs",
        "Missing library",
        "converting a checkpoint needs torch, which is not installed here",
    ),
    503: (
        "Database, broker or artifact store do not answer; try again",
        "Temporarily unavailable",
        "the broker does not answer",
    ),
    507: (
        "No space is left for artifacts or database",
        "No space left",
        "no space left for artifact runs/r1/report.html",
    ),
}
_ALWAYS: Final = (401, 403, 503)


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """``responses=`` of a router or an endpoint: those of every endpoint, and ``statuses``."""
    return {status: _response(status) for status in sorted({*_ALWAYS, *statuses})}


def example(value: Any, *, media_type: str = "application/json", status: int = 200) -> dict[int | str, dict[str, Any]]:
    """``responses=`` entry with an example of the answer."""
    return {status: {"content": {media_type: {"example": value}}}}


def binary(media_type: str, description: str) -> dict[int | str, dict[str, Any]]:
    """``responses=`` of bytes that can be asked for in part and again."""
    content = {media_type: {"schema": {"type": "string", "format": "binary"}}}
    return {
        200: {"description": description, "content": content},
        206: {"description": "The part that Range asked for", "content": content},
        304: {"description": "What If-None-Match names still holds"},
        416: _response(416),
    }


def install(app: FastAPI, routers: Sequence[APIRouter]) -> None:
    """Replace the generated document's weak points; it is built once, at the first request."""

    def build() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app, routers)
        return app.openapi_schema

    app.openapi = build  # type: ignore[method-assign]


def _document(app: FastAPI, routers: Sequence[APIRouter]) -> dict[str, Any]:
    document = get_openapi(
        title=app.title, version=app.version, summary=app.summary, description=app.description, routes=app.routes
    )
    components = document.setdefault("components", {})
    models = components.setdefault("schemas", {})
    models["Problem"] = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    models.update(models["Problem"].pop("$defs", {}))
    for unused in ("HTTPValidationError", "ValidationError"):
        models.pop(unused, None)
    components["securitySchemes"] = {
        "token": {
            "type": "http",
            "scheme": "bearer",
            "description": "The value of VALERIE_API_TOKEN; a server that listens to its own machine only may have none.",
        }
    }
    open_paths = ("/healthz", "/readyz")
    for path, item in document["paths"].items():
        for operation in item.values():
            operation["security"] = [] if path in open_paths else [{"token": []}, {}]
    _restore_examples(document, routers)
    return document


def _restore_examples(document: dict[str, Any], routers: Sequence[APIRouter]) -> None:
    """Put the examples back as they were written: the generator drops every null, which the schemas require."""
    for name, schema in document["components"]["schemas"].items():
        extra = getattr(getattr(schemas, name, None), "model_config", {}).get("json_schema_extra")
        if isinstance(extra, dict) and "example" in extra:
            schema["example"] = extra["example"]
    for route in (route for router in routers for route in router.routes if isinstance(route, APIRoute)):
        for method in route.methods or ():
            responses = document["paths"][route.path][method.lower()]["responses"]
            for status, response in route.responses.items():
                for media_type, content in response.get("content", {}).items():
                    if "example" in content:
                        responses[str(status)]["content"][media_type]["example"] = content["example"]


def _response(status: int) -> dict[str, Any]:
    meaning, title, detail = _MEANINGS[status]
    shown: dict[str, Any] = {"type": "about:blank", "title": title, "status": status, "detail": detail}
    if status == HTTPStatus.UNPROCESSABLE_ENTITY:
        shown["errors"] = [{"field": "step", "message": "must be above 0", "value": 0, "limit": "> 0"}]
    return {
        "description": meaning,
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}, "example": shown}},
    }
