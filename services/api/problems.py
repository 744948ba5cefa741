"""Errors as RFC 9457 problem documents that name field, value and limit; no stack trace reaches a client."""

from __future__ import annotations

import json
import math
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from valerie.errors import (
    Conflict,
    InvalidInput,
    InvalidInputs,
    MissingDependency,
    NotFound,
    StorageFull,
    TransientError,
    ValerieError,
)
from valerie.pipeline.stages import MissingInput

log = structlog.get_logger()

#: The first class that fits decides.
_STATUS: tuple[tuple[type[ValerieError], HTTPStatus], ...] = (
    (InvalidInput, HTTPStatus.UNPROCESSABLE_ENTITY),
    (NotFound, HTTPStatus.NOT_FOUND),
    (MissingInput, HTTPStatus.NOT_FOUND),
    (Conflict, HTTPStatus.CONFLICT),
    (StorageFull, HTTPStatus.INSUFFICIENT_STORAGE),
    (TransientError, HTTPStatus.SERVICE_UNAVAILABLE),
    (MissingDependency, HTTPStatus.NOT_IMPLEMENTED),
)
MEDIA_TYPE = "application/problem+json"


class FieldProblem(BaseModel):
    """What is wrong with one field of what was given."""

    field: str = Field(description="dotted place in the document, name of the parameter, or empty for all of it")
    message: str
    value: str | float | int | bool | None = Field(None, description="what was given, shortened")
    limit: str | float | int | bool | None = Field(None, description="the bound or the form that would be accepted")


class Problem(BaseModel):
    """A problem document (RFC 9457)."""

    type: str = Field("about:blank", description="always about:blank: title and status say what it is")
    title: str = Field(description="kind of error, e.g. UnknownName")
    status: int
    detail: str = Field(description="what went wrong, in words for people")
    errors: list[FieldProblem] | None = Field(None, description="field by field, where something given was wrong")


class ProblemResponse(JSONResponse):
    """JSON that can always be sent, whatever a client wrote that is shown back to it (half a surrogate pair)."""

    media_type = MEDIA_TYPE

    def render(self, content: Any) -> bytes:
        """Encode; what is no character becomes a question mark."""
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode(
            "utf-8", "replace"
        )


def problem(status: int, title: str, detail: str, **members: Any) -> JSONResponse:
    """One problem document."""
    document = {"type": "about:blank", "title": title, "status": int(status), "detail": detail, **members}
    return ProblemResponse(document, status_code=int(status))


def install(app: FastAPI) -> None:
    """Render every error of ``app`` as a problem document."""

    @app.exception_handler(ValerieError)
    async def ours(_: Request, error: ValerieError) -> JSONResponse:
        status = next((code for kind, code in _STATUS if isinstance(error, kind)), HTTPStatus.INTERNAL_SERVER_ERROR)
        members: dict[str, Any] = {}
        if isinstance(error, InvalidInputs):
            members["errors"] = [_members(one) for one in error.problems]
        elif isinstance(error, InvalidInput):
            members["errors"] = [_members(error)]
        return problem(status, type(error).__name__, str(error), **members)

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, error: RequestValidationError) -> JSONResponse:
        errors = [
            {
                "field": ".".join(str(part) for part in one["loc"][1:]) or str(one["loc"][0]),
                "message": one["msg"],
                "value": _plain(one.get("input")),
                "limit": _limit(one.get("ctx", {})),
            }
            for one in error.errors()
        ]
        detail = "; ".join(f"{one['field']}: {one['message']}" for one in errors)
        return problem(HTTPStatus.UNPROCESSABLE_ENTITY, "InvalidInput", detail, errors=errors)

    @app.exception_handler(HTTPException)
    async def http(_: Request, error: HTTPException) -> JSONResponse:
        response = problem(error.status_code, HTTPStatus(error.status_code).phrase, str(error.detail))
        response.headers.update(error.headers or {})
        return response

    @app.exception_handler(Exception)
    async def defect(request: Request, error: Exception) -> JSONResponse:
        log.error("api.defect", path=request.url.path, exc_info=error)
        return problem(
            HTTPStatus.INTERNAL_SERVER_ERROR, "InternalError", "a defect of the server; its log holds the details"
        )


def _members(error: InvalidInput) -> dict[str, Any]:
    return {
        "field": error.field,
        "message": error.message,
        "value": _plain(error.value),
        "limit": _plain(error.limit),
    }


#: Bounds of pydantic as people write them.
_BOUNDS = {"ge": ">= {}", "gt": "> {}", "le": "<= {}", "lt": "< {}", "max_length": "at most {} characters or items",
           "min_length": "at least {} characters or items", "pattern": "{}", "expected": "{}"}  # fmt: skip


def _limit(context: dict[str, Any]) -> str | None:
    return ", ".join(text.format(context[name]) for name, text in _BOUNDS.items() if name in context) or None


def _plain(value: object) -> object:
    """Something JSON can hold, and not too long to read."""
    if value is None or isinstance(value, bool | int | float):
        return value if not isinstance(value, float) or math.isfinite(value) else str(value)
    text = value if isinstance(value, str) else str(value)
    return text if len(text) <= 200 else text[:199] + "…"
