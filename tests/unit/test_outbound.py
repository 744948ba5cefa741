import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from valerie.addresses import Endpoint
from valerie.errors import NoAnswer
from valerie.outbound import post

_SECONDS = 0.4


@pytest.fixture
def dripping() -> Iterator[int]:
    """The port of a server that never ends its answer, and is never silent."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def drip() -> None:
            connection, _ = server.accept()
            with connection:
                try:
                    connection.sendall(b"HTTP/1.1 200 OK\r\nX-Long: ")
                    for _ in range(100):
                        connection.sendall(b"x")
                        time.sleep(0.1)
                except OSError:
                    return  # it was cut off

        thread = threading.Thread(target=drip)
        thread.start()
        yield server.getsockname()[1]
        thread.join()


def test_a_connection_that_is_made_late_gives_no_further_time(dripping: int, monkeypatch: pytest.MonkeyPatch) -> None:
    connect = socket.create_connection

    def late(*arguments: Any) -> socket.socket:
        """Connect as a peer permits that delays each step of connection and handshake for nearly the whole time."""
        time.sleep(1.5 * _SECONDS)
        return connect(*arguments)

    monkeypatch.setattr(socket, "create_connection", late)
    started = time.monotonic()
    with pytest.raises(NoAnswer, match=r"no answer within 0\.4 s"):
        post(Endpoint("127.0.0.1", dripping, "/", "127.0.0.1", False), b"", {}, timeout_s=_SECONDS, limit=0)
    assert time.monotonic() - started < 5.0
