"""Connections of the API's server, which no client can hold by sending slowly or by not reading."""

from __future__ import annotations

import asyncio
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

#: Seconds until a connection without a complete request is closed; some clients reuse connections for a few seconds.
HEAD_SECONDS: Final = 30

#: Bytes of an answer that a client must at least take in each `Connection.unread_seconds`; uvicorn keeps that many unsent.
_LEAST_TAKEN: Final = 1 << 14


class Connection(H11Protocol):
    """uvicorn's protocol with a time limit for what it waits for without one.

    uvicorn closes a connection that is silent between two requests for ``timeout_keep_alive`` seconds. Here the same limit
    holds for the first request, for a head that has begun, and for the rest of a body whose request was answered already.
    `services.api.protection` limits the other bodies.

    Attributes:
        unread_seconds: time in which a client must take a little of a waiting answer.
    """

    unread_seconds: float = 30.0
    _limit: asyncio.TimerHandle | None = None
    _unread: asyncio.TimerHandle | None = None

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
        self._stop_watching()

    def pause_writing(self) -> None:
        """Watch the client take what waits."""
        super().pause_writing()
        self._stop_watching()
        self._watch(self.transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """Stop watching, since the client has taken nearly all."""
        super().resume_writing()
        self._stop_watching()

    def _watch(self, waiting: int) -> None:
        def look() -> None:
            left = self.transport.get_write_buffer_size()
            if waiting - left < _LEAST_TAKEN:
                self.transport.abort()
            else:
                self._watch(left)

        self._unread = self.loop.call_later(self.unread_seconds, look)

    def _stop_watching(self) -> None:
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None

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


def limited(unread_seconds: float) -> type[Connection]:
    """Return the protocol with another limit of `Connection.unread_seconds`."""
    return type("Connection", (Connection,), {"unread_seconds": unread_seconds})
