"""Connections to Postgres that wait for no answer without a limit."""

from __future__ import annotations

import math
from collections.abc import Generator
from time import monotonic
from typing import Any, Final, Self

import psycopg

#: Longest time until a connection is made.
_CONNECT_SECONDS: Final = 10.0
#: With TCP, the kernel reports a lost peer after 25 s; a unix socket ignores this.
_KEEPALIVES: Final = {
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 25_000,  # milliseconds
}
#: Longest wait for a lock. Transactions hold theirs for far less, except those of a migration.
_LOCK_SECONDS: Final = 10.0
#: Time for an answer beyond the server's own limit, so that the server's reason arrives first.
_BEYOND_SECONDS: Final = 5.0


class BoundedConnection(psycopg.Connection[Any]):
    """A connection that closes itself if the server is silent during a statement.

    The server's limits do not help if its processes are stopped, or if the link swallows what it sends; keepalives do not help
    if another program, such as a proxy, holds the other end of the socket.

    Attributes:
        silence: longest time without a byte from the server, seconds.
    """

    silence = _CONNECT_SECONDS

    @classmethod
    def opened(cls, arguments: Any, options: dict[str, Any], *, seconds: float) -> Self:
        """Connect, and limit statements on both sides.

        Args:
            arguments, options: of `psycopg.connect`; the options take precedence over the defaults here.
            seconds: longest time of a statement.
        """
        timeouts = {"connect_timeout": math.ceil(min(_CONNECT_SECONDS, seconds))}
        connection = cls.connect(*arguments, **{**timeouts, **_KEEPALIVES, **options, "autocommit": True})
        milliseconds, lock = math.ceil(1000 * seconds), math.ceil(1000 * min(_LOCK_SECONDS, seconds / 2))
        connection.execute(
            f"SET statement_timeout = {milliseconds}; SET lock_timeout = {lock}; "
            # Else the locks of a client behind a dead link are held until the server's kernel gives it up.
            f"SET idle_in_transaction_session_timeout = {milliseconds}"
        )
        connection.autocommit = False
        connection.silence = seconds + _BEYOND_SECONDS
        return connection

    def wait(self, gen: Any, *arguments: Any, **options: Any) -> Any:
        """See `psycopg.Connection.wait`.

        Raises:
            psycopg.OperationalError: the server was silent for too long; the connection is closed.
        """
        return super().wait(self._watched(gen), *arguments, **options)

    def _watched(self, gen: Generator[Any, Any, Any]) -> Generator[Any, Any, Any]:
        """Pass on what psycopg waits for; psycopg also resumes the generator several times a second while nothing arrives."""
        try:
            wanted = next(gen)
            heard = monotonic()
            while True:
                ready = yield wanted
                if ready:
                    heard = monotonic()
                elif monotonic() - heard > self.silence:
                    self.pgconn.finish()
                    raise psycopg.OperationalError(f"no answer for {self.silence:g} s")
                wanted = gen.send(ready)
        except StopIteration as end:
            return end.value

    def unbound(self) -> float:
        """Let the statements of the current transaction take any time; return the earlier `silence`."""
        self.execute(
            "SET LOCAL statement_timeout = 0; SET LOCAL lock_timeout = 0; SET LOCAL idle_in_transaction_session_timeout = 0"
        )
        earlier, self.silence = self.silence, math.inf
        return earlier
