"""One HTTP request to a checked address: bounded in time and bytes, without redirects or a second look-up of the name."""

from __future__ import annotations

import http.client
import socket
import ssl
import threading
from collections.abc import Container, Mapping
from typing import Final, NamedTuple

from valerie.addresses import Endpoint
from valerie.errors import NoAnswer

_PIECE: Final = 65_536


class HttpAnswer(NamedTuple):
    """An answer with one of the expected statuses."""

    headers: http.client.HTTPMessage
    body: bytes


def post(
    target: Endpoint,
    body: bytes,
    headers: Mapping[str, str],
    *,
    timeout_s: float,
    limit: int,
    statuses: Container[int] = (http.client.OK,),
) -> HttpAnswer:
    """Send a POST request and return its answer.

    Args:
        target: from `valerie.addresses`.
        timeout_s: time for the whole exchange, seconds.
        limit: largest body of an answer, bytes; 0: the body is not read.
        statuses: statuses of a good answer.

    Raises:
        NoAnswer: the answer is late, too long, incomplete, or has another status. Redirects are such, since nobody checked
            their target.
    """
    connection = _Connection(target, timeout_s)
    late = threading.Event()

    def end() -> None:
        late.set()
        connection.cut()

    # The socket's time-out restarts with every byte; this one does not.
    timer = threading.Timer(timeout_s, end)
    timer.daemon = True
    timer.start()
    try:
        connection.request("POST", target.path, body=body, headers={**headers, "Connection": "close"})
        response = connection.getresponse()
        if response.status not in statuses:
            raise NoAnswer(f"it answered with status {response.status}")
        return HttpAnswer(response.headers, _body(response, limit) if limit else b"")
    except (OSError, http.client.HTTPException, ValueError, NoAnswer) as error:
        if late.is_set() or isinstance(error, TimeoutError):
            reason = f"no answer within {timeout_s:g} s"
        else:
            reason = str(error) if isinstance(error, NoAnswer) else repr(error)
        raise NoAnswer(f"{target.host}:{target.port}: {reason}") from None
    finally:
        timer.cancel()
        connection.close()


def _body(response: http.client.HTTPResponse, limit: int) -> bytes:
    pieces: list[bytes] = []
    size = 0
    while piece := response.read1(_PIECE):
        size += len(piece)
        if size > limit:
            raise NoAnswer(f"it answered with more than {limit} bytes")
        pieces.append(piece)
    if response.length:
        raise NoAnswer(f"it ended {response.length} bytes early")
    return b"".join(pieces)


class _Connection(http.client.HTTPConnection):
    """A connection to the checked address, with a check of the named host's certificate."""

    def __init__(self, target: Endpoint, timeout_s: float) -> None:
        super().__init__(target.host, target.port, timeout=timeout_s)
        self._target = target
        self._ended = False

    def connect(self) -> None:
        plain = socket.create_connection((self._target.address, self.port), self.timeout)
        if self._target.secure:
            context = ssl.create_default_context()
            self.sock = context.wrap_socket(plain, server_hostname=self.host)
        else:
            self.sock = plain
        if self._ended:
            raise TimeoutError

    def cut(self) -> None:
        """End the connection from another thread, even while it waits, or as soon as it is made."""
        self._ended = True
        sock = self.sock
        if sock is not None:
            try:
                sock.shutdown(socket.SHUT_RDWR)
            except OSError:
                return
