"""Errors as problem documents (RFC 9457) that name field, value and limit; no stack trace reaches a client."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http import HTTPStatus
from typing import Annotated, Any, Final

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from typing_extensions import TypedDict  # pydantic reads no other before Python 3.12

from valerie.errors import (
    Conflict,
    CorruptArtifact,
    InferenceError,
    InvalidInput,
    InvalidInputs,
    MissingDependency,
    MissingInput,
    NotFound,
    RenderingError,
    StorageFull,
    TransientError,
    UnknownName,
    ValerieError,
)
from valerie.plain import JsonObject

log = structlog.get_logger()

INVALID_INPUT: Final = "Invalid input"
#: Class of error to status and title; the first match counts.
_KINDS: Final[tuple[tuple[type[ValerieError], HTTPStatus, str], ...]] = (
    (UnknownName, HTTPStatus.UNPROCESSABLE_ENTITY, "Unknown name"),
    (InvalidInput, HTTPStatus.UNPROCESSABLE_ENTITY, INVALID_INPUT),
    (NotFound, HTTPStatus.NOT_FOUND, "Not found"),
    (MissingInput, HTTPStatus.NOT_FOUND, "Not found"),
    (Conflict, HTTPStatus.CONFLICT, "Conflict"),
    (StorageFull, HTTPStatus.INSUFFICIENT_STORAGE, "No space left"),
    (TransientError, HTTPStatus.SERVICE_UNAVAILABLE, "Temporarily unavailable"),
    (MissingDependency, HTTPStatus.NOT_IMPLEMENTED, "Missing library"),
    (CorruptArtifact, HTTPStatus.INTERNAL_SERVER_ERROR, "Broken artifact"),
    (RenderingError, HTTPStatus.INTERNAL_SERVER_ERROR, "Rendering failed"),
    (InferenceError, HTTPStatus.INTERNAL_SERVER_ERROR, "Inference failed"),
    (ValerieError, HTTPStatus.INTERNAL_SERVER_ERROR, "Failed"),
)
#: When to try again after a failure that may not occur again.
_RETRY_SECONDS: Final = "5"
MEDIA_TYPE: Final = "application/problem+json"


#: A JSON value that is neither list nor object.
_Scalar = str | float | int | bool | None


class FieldProblem(TypedDict):
    """Error in one field of the request."""

    field: Annotated[
        str,
        Field(description="dotted path in the document or name of the parameter; empty for the whole request"),
    ]
    message: str
    value: Annotated[_Scalar, Field(description="rejected value, shortened")]
    limit: Annotated[_Scalar, Field(description="bound or form that would be accepted")]


class Problem(BaseModel):
    """A problem document (RFC 9457)."""

    type: str = Field("about:blank", description="always about:blank; title and status identify the problem")
    title: str = Field(description="kind of error, for example Unknown name")
    status: int
    detail: str = Field(description="explanation for people")
    errors: list[FieldProblem] | None = Field(None, description="errors by field, where the request was wrong")


class ProblemResponse(JSONResponse):
    """JSON that can quote any text of a request, even half a surrogate pair."""

    media_type = MEDIA_TYPE

    def render(self, content: Any) -> bytes:
        """Encode the content; invalid characters become question marks."""
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode(
            "utf-8", "replace"
        )


def problem(status: int, title: str, detail: str, *, errors: Sequence[FieldProblem] | None = None) -> JSONResponse:
    """Return one problem document; ``errors`` is a member unless it is None. A 503 says when to try again."""
    document = {"type": "about:blank", "title": title, "status": int(status), "detail": detail}
    headers = {"Retry-After": _RETRY_SECONDS} if status == HTTPStatus.SERVICE_UNAVAILABLE else None
    content = document | ({} if errors is None else {"errors": errors})
    return ProblemResponse(content, status_code=int(status), headers=headers)


def install(app: FastAPI) -> None:
    """Render every error of ``app`` as a problem document."""

    @app.exception_handler(ValerieError)
    async def valerie_error(_: Request, error: ValerieError) -> JSONResponse:
        errors: list[FieldProblem] | None = None
        deciding: ValerieError = error
        if isinstance(error, InvalidInput):
            problems = error.problems if isinstance(error, InvalidInputs) else (error,)
            errors = [_field_problem(entry) for entry in problems]
            deciding = problems[0] if len(problems) == 1 else error
        status, title = next((status, title) for kind, status, title in _KINDS if isinstance(deciding, kind))
        return problem(status, title, str(error), errors=errors)

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, error: RequestValidationError) -> JSONResponse:
        errors = [
            FieldProblem(
                field=".".join(str(part) for part in entry["loc"][1:]) or str(entry["loc"][0]),
                message=entry["msg"],
                value=_plain(entry.get("input")),
                limit=_limit(entry.get("ctx", {})),
            )
            for entry in error.errors()
        ]
        detail = "; ".join(f"{entry['field']}: {entry['message']}" for entry in errors)
        return problem(HTTPStatus.UNPROCESSABLE_ENTITY, INVALID_INPUT, detail, errors=errors)

    @app.exception_handler(HTTPException)
    async def http(request: Request, error: HTTPException) -> JSONResponse:
        if error.status_code == HTTPStatus.BAD_REQUEST:
            # FastAPI reports a body that is not UTF-8, or nested too deeply, in this way.
            return await valerie_error(request, InvalidInput("not readable as JSON", field="body"))
        response = problem(error.status_code, HTTPStatus(error.status_code).phrase.capitalize(), str(error.detail))
        response.headers.update(error.headers or {})
        return response

    @app.exception_handler(Exception)
    async def defect(request: Request, error: Exception) -> JSONResponse:
        log.error("api.defect", path=request.url.path, exc_info=error)
        return problem(HTTPStatus.INTERNAL_SERVER_ERROR, "Internal error", "internal error of the server; see its log")


@contextmanager
def named_by_address() -> Iterator[None]:
    """Answer 404 to an unknown name: the address is wrong, not a field of a document."""
    try:
        yield
    except UnknownName as error:
        raise HTTPException(HTTPStatus.NOT_FOUND, str(error)) from None


def _field_problem(error: InvalidInput) -> FieldProblem:
    value, limit = error.value, error.limit
    if isinstance(error, UnknownName):
        value, limit = error.name, limit or ", ".join(error.known)
    return FieldProblem(field=error.field, message=error.message, value=_plain(value), limit=_plain(limit))


#: Bound of pydantic to its text.
_BOUNDS = {"ge": ">= {}", "gt": "> {}", "le": "<= {}", "lt": "< {}", "max_length": "at most {} characters or items",
           "min_length": "at least {} characters or items", "pattern": "{}", "expected": "{}"}  # fmt: skip


def _limit(context: JsonObject) -> str | None:
    return ", ".join(text.format(context[name]) for name, text in _BOUNDS.items() if name in context) or None


def _plain(value: object) -> _Scalar:
    """Return a JSON value that is short enough to read."""
    if value is None or isinstance(value, bool | int | float):
        return value if not isinstance(value, float) or math.isfinite(value) else str(value)
    text = value if isinstance(value, str) else str(value)
    return text if len(text) <= 200 else text[:199] + "…"
