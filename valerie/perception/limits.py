"""Bounds for a process that runs a network which someone brought: memory, and time per picture.

A network is data, but data can ask for a terabyte or for a year. The operating system holds the first bound: an allocation
beyond it fails, which is an error of that picture. Nothing can stop compiled code from within, so the second bound ends the
process; the worker starts another, and the picture's product fails when its attempts are used up.
"""

from __future__ import annotations

import os
import resource
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

#: Exit status of a process that took too long; as `timeout` of coreutils has it.
TIMED_OUT: Final = 124


def limit_memory(megabytes: int) -> None:
    """Let allocations of this process fail when its private memory passes a size.

    Args:
        megabytes: of everything private that the process holds (RLIMIT_DATA; mapped files do not count); 0 sets no limit.
    """
    if megabytes == 0:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = megabytes << 20
    soft = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def time_limit(seconds: float, *, what: str) -> Iterator[None]:
    """End this process when the body takes longer.

    Args:
        seconds: wall time; 0 sets no limit.
        what: for the last words on standard error.
    """
    if seconds == 0:
        yield
        return

    def end() -> None:
        os.write(sys.stderr.fileno(), f"valerie: {what} took longer than {seconds:g} s\n".encode())
        os._exit(TIMED_OUT)

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
