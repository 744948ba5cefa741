"""Sending bytes: entity tags and one range (RFC 9110, sections 8.8.3, 13 and 14), reading no more than is sent."""

from __future__ import annotations

import re
from collections.abc import Callable
from http import HTTPStatus
from typing import Annotated, Final

from fastapi import Depends, Header, Response, status

from services.api.problems import INVALID_INPUT, problem
from services.api.schemas.base import DIGEST

_RANGE: Final = re.compile(r"bytes=(?:([0-9]{1,18})-([0-9]{0,18})|-([0-9]{1,18}))", re.ASCII)
#: Must be asked again each time, which costs a 304 and no picture; never kept by anybody in between.
_CACHE: Final = "private, no-cache"

_ETAG: Final = f'"{DIGEST}"'


class Conditions:
    """What a request says about what it has already, and which part it wants."""

    def __init__(
        self,
        range_: Annotated[str | None, Header(alias="range", description="one range", examples=["bytes=0-99"])] = None,
        if_none_match: Annotated[
            str | None,
            Header(description="ETag of what is there already: 304 if it still holds", examples=[_ETAG]),
        ] = None,
        if_range: Annotated[str | None, Header(description="ETag that the range belongs to", examples=[_ETAG])] = None,
    ) -> None:
        self.range, self._known, self._if_range = range_, if_none_match, if_range

    def holds(self, etag: str) -> bool:
        """Whether the client has this already."""
        known = [] if self._known is None else [one.strip().removeprefix("W/") for one in self._known.split(",")]
        return etag in known or known == ["*"]

    def part(self, etag: str, size: int) -> tuple[int, int] | None:
        """First byte and length of the wanted part, length 0 where there is no such part; None: all of it.

        What is malformed, or several ranges, is ignored, as the RFC allows.
        """
        found = _RANGE.fullmatch(self.range.strip()) if self.range else None
        if found is None or (self._if_range is not None and self._if_range.strip() != etag):
            return None
        first, last, suffix = found.groups()
        if suffix is not None:
            start, end = max(size - int(suffix), 0), size - 1
            return start, (end - start + 1 if int(suffix) else 0)
        start, end = int(first), min(int(last), size - 1) if last else size - 1
        if last and int(last) < start:
            return None  # not a range at all
        return start, max(end - start + 1, 0)


ConditionsDependency = Annotated[Conditions, Depends()]


def send(
    conditions: Conditions,
    *,
    tag: str,
    media_type: str,
    size: Callable[[], int],
    read: Callable[[int, int], bytes],
    headers: dict[str, str] | None = None,
) -> Response:
    """Answer with the whole, a part, or the news that nothing changed.

    Args:
        conditions: of the request.
        tag: stands for the content; no two contents share one.
        media_type: of the content.
        size: its bytes; called unless the client has it.
        read: (first, length) → bytes; called for what is sent.
        headers: further ones.
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
            f"range: it begins beyond the end; limit: {whole} bytes",
            errors=[
                {"field": "range", "message": "it begins beyond the end", "value": conditions.range, "limit": whole}
            ],
        )
        refusal.headers.update({**common, "Content-Range": f"bytes */{whole}"})
        return refusal
    return Response(
        read(start, length),
        status_code=status.HTTP_206_PARTIAL_CONTENT,
        media_type=media_type,
        headers={**common, "Content-Range": f"bytes {start}-{start + length - 1}/{whole}"},
    )
