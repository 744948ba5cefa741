"""The audit log of the API: who asked for which change, and what came of it."""

from __future__ import annotations

import secrets
import threading
from time import monotonic
from typing import Final

import structlog
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.api.roles import changes_nothing
from valerie.access import Caller
from valerie.db import audit
from valerie.db.engine import database_moment, writing
from valerie.errors import ValerieError

log = structlog.get_logger()

_REFUSED: Final = (401, 403)
#: Refusals that are kept per minute and process; others are counted, so that a flood of them does not fill the disk.
KEPT_PER_MINUTE: Final = 60


class Audit:
    """Writes a row before every change that a request asks for and one with its outcome, and one for every refusal."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._minute = self._kept = self._left_out = 0

    async def watched(self, app: ASGIApp, scope: Scope, receive: Receive, send: Send, caller: Caller | None) -> None:
        """Pass a request on to ``app``.

        Raises:
            TransientError: the database does not take the first row; the request is not passed on.
        """
        request = Request(scope)
        changes = not changes_nothing(request.method, request.url.path)
        mark = secrets.token_hex(8)
        if changes:
            await run_in_threadpool(self._append, request, caller, mark, None)
        recorded = False

        async def record(status: int) -> None:
            nonlocal recorded
            recorded = True
            if changes:
                await run_in_threadpool(self._outcome, request, caller, mark, status)
            elif status in _REFUSED:
                await run_in_threadpool(self.refused, request, caller, status)

        async def recording(message: Message) -> None:
            if message["type"] == "http.response.start":  # a caller that has its answer finds its outcome in the log
                await record(message["status"])
            await send(message)

        try:
            await app(scope, receive, recording)
        finally:
            if not recorded:
                await record(500)

    def refused(self, request: Request, caller: Caller | None, status: int) -> None:
        """Write the row of a request that was refused, unless too many were."""
        with self._lock:
            minute = int(monotonic() // 60)
            if minute != self._minute:
                self._minute, self._kept = minute, 0
            self._kept += 1
            if self._kept > KEPT_PER_MINUTE:
                self._left_out += 1
                return
            left_out, self._left_out = self._left_out, 0
        self._outcome(request, caller, secrets.token_hex(8), status, left_out)

    def _outcome(self, request: Request, caller: Caller | None, mark: str, status: int, left_out: int = 0) -> None:
        try:
            self._append(request, caller, mark, status, left_out)
        except ValerieError as error:  # the change is made; the row before it stays
            log.warning("audit.outcome_not_recorded", request=mark, status=status, reason=str(error))

    def _append(
        self, request: Request, caller: Caller | None, mark: str, status: int | None, left_out: int = 0
    ) -> None:
        with writing(request.app.state.context.engine) as connection:
            entry = audit.Entry(
                request=mark,
                at=database_moment(connection),
                caller=caller.name if caller else None,
                owner=caller.owner if caller else None,
                role=caller.role if caller else None,
                address=(request.client.host if request.client else "")[:64],
                method=request.method[:16],
                path=request.url.path.replace("\0", "")[:1000],
                status=status,
                left_out=left_out,
            )
            audit.append(connection, entry)
