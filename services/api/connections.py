"""Connections of the API's server, which no client can hold by sending slowly."""

from __future__ import annotations

import asyncio
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

#: Seconds until a connection without a complete request is closed; some clients reuse connections for a few seconds.
HEAD_SECONDS: Final = 30


class Connection(H11Protocol):
    """uvicorn's protocol with a time limit for what it waits for without one.

    uvicorn closes a connection that is silent between two requests for ``timeout_keep_alive`` seconds. Here the same limit
    holds for the first request, for a head that has begun, and for the rest of a body whose request was answered already.
    `services.api.protection` limits the other bodies.
    """

    _limit: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as in uvicorn
        """Wait for the first request."""
        super().connection_made(transport)
        self._limit_wait()

    def data_received(self, data: bytes) -> None:
        """Handle bytes; those of an incomplete head do not extend the limit."""
        super().data_received(data)
        self._limit_wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        super().connection_lost(exc)
        self._stop_waiting()

    def _limit_wait(self) -> None:
        answered = self.cycle is not None and self.cycle.response_complete
        if self.conn.their_state is not h11.IDLE and not answered:
            self._stop_waiting()
        elif self._limit is None:
            self._limit = self.loop.call_later(self.timeout_keep_alive, self.transport.close)

    def _stop_waiting(self) -> None:
        if self._limit is not None:
            self._limit.cancel()
            self._limit = None
