"""The tie between a process and the one that started it: its end, its environment, and messages over two pipes."""

from __future__ import annotations

import ctypes
import os
import select
import signal
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Final

_PR_SET_PDEATHSIG = 1
#: Variables that a child needs; everything else in the environment, such as tokens and settings, is hidden from it.
_ENVIRONMENT: Final = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "LD_LIBRARY_PATH", "OMP_NUM_THREADS", "PYTHONPATH")
#: Time between two looks at a child that does not answer, seconds.
_LOOK_SECONDS: Final = 0.5
#: Length in front of each message, bytes.
_LENGTH: Final = struct.Struct("<I")


def end_with_parent(signum: int = signal.SIGTERM) -> None:
    """Ask the kernel for ``signum`` when the parent of this process ends, however it ends (Linux)."""
    parent = os.getppid()
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signum, 0, 0, 0)
    if os.getppid() != parent:  # the parent ended before the request
        os.kill(os.getpid(), signum)


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of VALERIE in a child process."""
    return [sys.executable, "-P", "-m", module, *arguments]


def module_environment(*names: str) -> dict[str, str]:
    """Return the environment of a child that runs a module of VALERIE: without settings and secrets, but with ``names``."""
    environment = {name: os.environ[name] for name in (*_ENVIRONMENT, *names) if name in os.environ}
    source = str(Path(__file__).parents[1])
    return {
        **environment,
        "PYTHONPATH": os.pathsep.join(filter(None, [source, environment.get("PYTHONPATH")])),
    }


def read_message(stream: IO[bytes]) -> bytes | None:
    """Return the next message that `Wire.send_message` sent; None at the end of the stream."""
    length = stream.read(_LENGTH.size)
    return stream.read(_LENGTH.unpack(length)[0]) if len(length) == _LENGTH.size else None


def write_message(stream: IO[bytes], message: bytes) -> None:
    """Write a message for `Wire.receive_message`."""
    stream.write(_LENGTH.pack(len(message)) + message)
    stream.flush()


class Wire:
    """Two pipes with a time limit.

    Args:
        watch: called about twice a second while a pipe is not ready; its errors pass through.
        silence: seconds without a byte in either direction before TimeoutError.
    """

    def __init__(
        self, requests: IO[bytes], answers: IO[bytes] | None, watch: Callable[[], None], silence: float
    ) -> None:
        assert answers is not None
        self._requests, self._answers = requests.fileno(), answers.fileno()
        os.set_blocking(self._requests, False)
        self._watch = watch
        self._silence = silence

    def send(self, data: bytes | memoryview) -> None:
        """Send all bytes. Raises EOFError if the pipe has no reader."""
        view = memoryview(data)
        while view:
            self._wait(self._requests, writing=True)
            try:
                view = view[os.write(self._requests, view[: 1 << 20]) :]
            except BlockingIOError:
                continue
            except BrokenPipeError:
                raise EOFError from None

    def receive(self, size: int) -> bytes:
        """Return exactly ``size`` bytes. Raises EOFError when the pipe ends earlier."""
        parts: list[bytes] = []
        while size:
            self._wait(self._answers)
            part = os.read(self._answers, min(size, 1 << 20))
            if not part:
                raise EOFError
            parts.append(part)
            size -= len(part)
        return b"".join(parts)

    def send_message(self, message: bytes) -> None:
        """Send a message with its length in front. Raises EOFError if the pipe has no reader."""
        self.send(_LENGTH.pack(len(message)) + message)

    def receive_message(self) -> bytes:
        """Return the next message of `write_message`. Raises EOFError when the pipe ends earlier."""
        return self.receive(_LENGTH.unpack(self.receive(_LENGTH.size))[0])

    def _wait(self, pipe: int, *, writing: bool = False) -> None:
        until = time.monotonic() + self._silence
        while True:
            ready = select.select([] if writing else [pipe], [pipe] if writing else [], [], _LOOK_SECONDS)
            if ready[0] or ready[1]:
                return
            self._watch()
            if time.monotonic() > until:
                raise TimeoutError
