"""Dependencies that endpoints share: the context of the process, path and query parameters, cursors."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from typing import Annotated, Any, Protocol

import orjson
from fastapi import Depends, Path, Query, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute

from services.api.schemas.base import FRAME_ID, RUN_ID
from valerie.access import OPERATOR, Caller
from valerie.db.statements import Seen
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.pipeline.base.context import Context
from valerie.runs.products.frame_keys import FRAME_ID as FRAME_ID_PATTERN
from valerie.runs.products.frame_keys import ID, FrameKey


def _context(request: Request) -> Context:
    context: Context = request.app.state.context if request.method == "GET" else request.app.state.patient
    return context


def _patient(request: Request) -> Context:
    context: Context = request.app.state.patient
    return context


def wake_control(request: Request) -> None:
    """Wake the control loop of this process; a loop in another process polls."""
    loop = request.app.state.control
    if loop is not None:
        loop.wake()


def only_declared_queries(request: Request) -> None:
    """Refuse query parameters that the endpoint does not have; a misspelt filter would otherwise select everything.

    Raises:
        InvalidInputs: one `UnknownName` for each unknown parameter.
    """
    route: APIRoute = request.scope["route"]
    known = frozenset(_declared(route.dependant))
    unknown = [name for name in request.query_params if name not in known]
    if unknown:
        raise InvalidInputs([UnknownName("query parameter", name, known, field=name) for name in unknown])


def _declared(dependant: Dependant) -> Iterator[str]:
    """Yield the names of all query parameters, including those of dependencies."""
    yield from (field.alias for field in dependant.query_params)
    for inner in dependant.dependencies:
        yield from _declared(inner)


def _owner(request: Request) -> str | None:
    caller: Caller = request.state.caller
    return None if caller is OPERATOR else caller.owner


def _project(request: Request) -> str:
    caller: Caller = request.state.caller
    return caller.project


#: Its database soon answers a request that only reads, or fails.
ContextDependency = Annotated[Context, Depends(_context)]
#: For what reads much, such as downloads of whole tables.
PatientDependency = Annotated[Context, Depends(_patient)]
#: Owner of the request's token; None: the operator.
OwnerDependency = Annotated[str | None, Depends(_owner)]
#: The only project that exists for the request's token; empty: all do.
ProjectDependency = Annotated[str, Depends(_project)]
RunId = Annotated[str, Path(pattern=ID, description="id of a run", examples=[RUN_ID])]


def _frame_key(
    frame_id: Annotated[
        str, Path(pattern=FRAME_ID_PATTERN, description="run.variant.camera.time", examples=[FRAME_ID])
    ],
) -> FrameKey:
    return FrameKey.parse(frame_id)


async def _body(request: Request) -> bytes:
    return await request.body()


Body = Annotated[bytes, Depends(_body)]
FrameDependency = Annotated[FrameKey, Depends(_frame_key)]
Limit = Annotated[int, Query(ge=1, le=1000, description="rows per page")]
Cursor = Annotated[str | None, Query(max_length=400, description="`next` of the previous page", examples=["WzVd"])]


def encode_cursor(*values: Any) -> str:
    """Return an opaque cursor that holds ``values``."""
    return base64.urlsafe_b64encode(orjson.dumps(values)).decode().rstrip("=")


def decode_cursor(cursor: str | None, *parts: Part) -> tuple[Any, ...] | None:
    """Return the values of a cursor from `encode_cursor`; None without a cursor.

    Args:
        cursor: cursor of the request.
        parts: one check per value: `index`, `text`, `moment` or `value_of_column`.

    Raises:
        InvalidInput: not a cursor of this list.
    """
    if cursor is None:
        return None
    try:
        values = orjson.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
        if isinstance(values, list) and len(values) == len(parts):
            return tuple(part(value) for part, value in zip(parts, values, strict=True))
    except (binascii.Error, ValueError):
        pass
    raise InvalidInput("not a cursor of this list", field="cursor", value=cursor)


#: Checks one value of a cursor; raises ValueError.
Part = Callable[[Any], Any]


def index(value: Any) -> int:
    """Check a non-negative integer that a database can hold."""
    if type(value) is not int or not 0 <= value < 2**62:
        raise ValueError(value)
    return value


def text(value: Any) -> str:
    """Check a short text."""
    if not isinstance(value, str) or len(value) > 200 or "\0" in value:
        raise ValueError(value)
    return value


def moment(value: Any) -> datetime:
    """Return the time of an ISO 8601 text."""
    return datetime.fromisoformat(text(value))


def value_of_column(value: Any) -> float | str | None:
    """Check a value of a column: a number, text or null."""
    return value if value is None or type(value) in (int, float) else text(value)


class Created(Protocol):
    """A row of a list that begins with the newest."""

    @property
    def id(self) -> str: ...

    @property
    def created_at(self) -> datetime: ...


def _oldest_seen(cursor: Cursor = None) -> Seen | None:
    values = decode_cursor(cursor, moment, text)
    return None if values is None else Seen(*values)


#: The last row that a client has seen of a list that begins with the newest.
SeenDependency = Annotated[Seen | None, Depends(_oldest_seen)]


def next_page(rows: Sequence[Created], limit: int) -> str | None:
    """Return the cursor behind the first ``limit`` rows; None where there are no more."""
    last = rows[limit - 1] if len(rows) > limit else None
    return None if last is None else encode_cursor(last.created_at.isoformat(), last.id)
