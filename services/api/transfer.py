"""Byte responses with entity tags and ranges (RFC 9110, sections 8.8.3, 13 and 14), which read only the bytes they send."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from http import HTTPStatus
from typing import Annotated, Final

from fastapi import Depends, Header, Response, status
from pydantic import BaseModel

from services.api.problems import INVALID_INPUT, problem
from services.api.schemas.base import DIGEST

_RANGE: Final = re.compile(r"bytes=(?:([0-9]{1,18})-([0-9]{0,18})|-([0-9]{1,18}))", re.ASCII)
_GZIP: Final = re.compile(r"\bgzip\b(?!\s*;\s*q=0(?:\.0*)?\s*(?:,|$))", re.ASCII | re.IGNORECASE)
#: Clients revalidate each time, which costs a 304 and no picture; proxies store nothing.
_CACHE: Final = "private, no-cache"

_ETAG: Final = f'"{DIGEST}"'
#: Form of a table to its media type.
TABLES: Final = {
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
    "arrow": "application/vnd.apache.arrow.stream",
}


IfNoneMatch = Annotated[
    str | None, Header(description="ETag of the client's version; 304 if it is still current", examples=[_ETAG])
]


def _holds(known: str | None, etag: str) -> bool:
    """Return True if ``If-None-Match`` names a version. Weak and strong tags are compared alike."""
    tags = [] if known is None else [tag.strip().removeprefix("W/") for tag in known.split(",")]
    return etag.removeprefix("W/") in tags or tags == ["*"]


class RequestConditions:
    """Conditions of a request: the client's version, and the part that it requests."""

    def __init__(
        self,
        range_: Annotated[str | None, Header(alias="range", description="one range", examples=["bytes=0-99"])] = None,
        if_none_match: IfNoneMatch = None,
        if_range: Annotated[str | None, Header(description="ETag that the range belongs to", examples=[_ETAG])] = None,
    ) -> None:
        self.range, self._known, self._if_range = range_, if_none_match, if_range

    def holds(self, etag: str) -> bool:
        """Return True if the client has this version."""
        return _holds(self._known, etag)

    def part(self, etag: str, size: int) -> tuple[int, int] | None:
        """Return first byte and length of the requested part; length 0 if it begins beyond the end; None for everything.

        Malformed ranges and several ranges are ignored, as the RFC allows.
        """
        match = _RANGE.fullmatch(self.range.strip()) if self.range else None
        if match is None or (self._if_range is not None and self._if_range.strip() != etag):
            return None
        first, last, suffix = match.groups()
        if suffix is not None:
            start, end = max(size - int(suffix), 0), size - 1
            return start, (end - start + 1 if int(suffix) else 0)
        start, end = int(first), min(int(last), size - 1) if last else size - 1
        if last and int(last) < start:
            return None  # malformed
        return start, max(end - start + 1, 0)


ConditionsDependency = Annotated[RequestConditions, Depends()]


def as_file(name: str) -> dict[str, str]:
    """Return the header by which a browser saves an answer as a file."""
    return {"Content-Disposition": f'attachment; filename="{name}"'}


def send_table(content: bytes, stem: str, form: str) -> Response:
    """Return a table as a file; ``form`` is one of `TABLES`, and the suffix."""
    return Response(content, media_type=TABLES[form], headers=as_file(f"{stem}.{form}"))


def send_page(page: BaseModel, *, known: str | None, encodings: str | None) -> Response:
    """Return a page of a list that clients poll: 304 Not Modified, or JSON, compressed if possible.

    Args:
        page: the page.
        known: ``If-None-Match`` of the request.
        encodings: ``Accept-Encoding`` of the request.
    """
    body = page.model_dump_json().encode()
    # Weak, since the same page may be sent compressed or not.
    etag = f'W/"{blake2b(body, digest_size=16).hexdigest()}"'
    headers = {"ETag": etag, "Cache-Control": _CACHE, "Vary": "Accept-Encoding"}
    if _holds(known, etag):
        return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=headers)
    if _GZIP.search(encodings or ""):
        body, headers = gzip.compress(body, compresslevel=5, mtime=0), {**headers, "Content-Encoding": "gzip"}
    return Response(body, media_type="application/json", headers=headers)


def send(
    conditions: RequestConditions,
    *,
    tag: str,
    media_type: str,
    content: Callable[[], bytes],
    headers: dict[str, str] | None = None,
) -> Response:
    """Return content that is made in one piece, unless the client has it; see `send_parts`."""
    made = cache(content)
    return send_parts(
        conditions,
        tag=tag,
        media_type=media_type,
        size=lambda: len(made()),
        read=lambda start, length: made()[start : start + length],
        headers=headers,
    )


def send_parts(
    conditions: RequestConditions,
    *,
    tag: str,
    media_type: str,
    size: Callable[[], int],
    read: Callable[[int, int], bytes],
    headers: dict[str, str] | None = None,
) -> Response:
    """Return the whole content, the requested part, or 304 Not Modified.

    Args:
        conditions: conditions of the request.
        tag: entity tag; different contents have different tags.
        media_type: media type of the content.
        size: returns the number of bytes; called unless the client has the content.
        read: (first, length) → bytes; called for the bytes that are sent.
        headers: further headers.
    """
    etag = f'"{tag}"'
    common = {"ETag": etag, "Accept-Ranges": "bytes", "Cache-Control": _CACHE, **(headers or {})}
    if conditions.holds(etag):
        return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=common)
    whole = size()
    part = conditions.part(etag, whole)
    if part is None:
        return Response(read(0, whole), media_type=media_type, headers=common)
    start, length = part
    if length == 0:
        refusal = problem(
            HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE,
            INVALID_INPUT,
            f"range: begins beyond the end; limit: {whole} bytes",
            errors=[{"field": "range", "message": "begins beyond the end", "value": conditions.range, "limit": whole}],
        )
        refusal.headers.update({**common, "Content-Range": f"bytes */{whole}"})
        return refusal
    return Response(
        read(start, length),
        status_code=status.HTTP_206_PARTIAL_CONTENT,
        media_type=media_type,
        headers={**common, "Content-Range": f"bytes {start}-{start + length - 1}/{whole}"},
    )
