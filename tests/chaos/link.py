"""A link between the system and its database or broker, through which all their bytes pass: it can be cut, slow or silent."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Self

_CHUNK = 1 << 16


class Link:
    """Context manager that passes on what connects to a socket.

    Args:
        listening: path of the unix socket that the system connects to; None: a free port of this machine.
        target: path of the server's own.
    """

    def __init__(self, listening: Path | None, target: Path) -> None:
        self._target = target
        self._whole = threading.Event()
        self._whole.set()
        self._delay = 0.0
        self._hanging = False
        self._open: set[socket.socket] = set()
        self._silent: set[socket.socket] = set()
        self._lock = threading.Lock()
        if listening is None:
            self._server = socket.create_server(("127.0.0.1", 0))
            return
        self._server = socket.socket(socket.AF_UNIX)
        self._server.bind(str(listening))
        listening.chmod(0o777)
        self._server.listen(128)

    @property
    def port(self) -> int:
        return int(self._server.getsockname()[1])

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, name="link", daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.close()
        self._close()

    def cut(self, seconds: float) -> None:
        """End all connections, and let none be made for a time."""
        self._whole.clear()
        self._close()
        time.sleep(seconds)
        self._whole.set()

    def slow(self, delay: float, seconds: float) -> None:
        """Delay what passes in either direction for a time."""
        self._delay = delay
        time.sleep(seconds)
        self._delay = 0.0

    def hang(self, seconds: float) -> None:
        """Pass nothing on for a time, without a sign; connections that were open or begun meanwhile stay so for ever."""
        with self._lock:
            self._hanging = True
            self._silent |= self._open
        time.sleep(seconds)
        self._hanging = False

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:  # closed
                return
            server = socket.socket(socket.AF_UNIX)
            with self._lock:
                self._open |= {client, server}
                if hanging := self._hanging:
                    self._silent |= {client, server}
            if hanging:
                threading.Thread(target=self._pass, args=(client, server), name="link", daemon=True).start()
                continue
            try:
                if not self._whole.is_set():
                    raise ConnectionRefusedError
                server.connect(str(self._target))
            except OSError:
                self._end(client, server)
                continue
            for ends in ((client, server), (server, client)):
                threading.Thread(target=self._pass, args=ends, name="link", daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(_CHUNK):
                if self._delay:
                    time.sleep(self._delay)
                if source not in self._silent:
                    sink.sendall(data)
        # The other end of a silent connection does not learn that this one has gone.
        self._end(*({source} if source in self._silent else {source, sink}))

    def _end(self, *ends: socket.socket) -> None:
        with self._lock:
            self._open -= set(ends)
        for end in ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _close(self) -> None:
        with self._lock:
            ends = tuple(self._open)
        self._end(*ends)
