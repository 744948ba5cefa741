"""Bounds for a process that runs an untrusted network: memory, and time per picture.

A network is data, but it can request a terabyte of memory or a year of computing. The operating system enforces the memory
limit: an allocation beyond it fails, which is an error of that picture. Compiled code cannot be stopped from within, so the
time limit ends the process after recording the reason. `valerie.pipeline.functions.bounded` applies both to every function.
"""

from __future__ import annotations

import os
import resource
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

#: Exit status of a process that took too long, as of `timeout` in coreutils.
TIMED_OUT: Final = 124
#: The descriptor itself, since `sys.stderr` of a worker's process is Celery's and has none.
_STANDARD_ERROR: Final = 2
#: Time for recording the reason: a database that does not answer must not keep the process alive.
_LAST_WORDS_SECONDS: Final = 30.0


def limit_memory(megabytes: int) -> Callable[[], None]:
    """Let allocations of this process fail when its private memory exceeds a size.

    Args:
        megabytes: limit of the private memory of the process (RLIMIT_DATA; mapped files do not count); 0 sets no limit. A
            stricter limit of the process stays.

    Returns:
        A function that restores the previous limit.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    bounds = [bound for bound in (megabytes << 20, soft, hard) if bound not in (0, resource.RLIM_INFINITY)]
    if megabytes == 0 or not bounds:
        return lambda: None
    resource.setrlimit(resource.RLIMIT_DATA, (min(bounds), hard))
    return lambda: resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def time_limit(seconds: float, *, what: str, before_end: Callable[[str], None] | None = None) -> Iterator[None]:
    """End this process if the body takes longer.

    Args:
        seconds: wall time; 0 sets no limit.
        what: name of the work in the reason, which is written to standard error.
        before_end: called with the reason, in another thread, before the process ends with `TIMED_OUT`.
    """
    if seconds == 0:
        yield
        return

    def end() -> None:
        reason = f"{what} took longer than {seconds:g} s"
        try:
            with suppress(OSError):
                os.write(_STANDARD_ERROR, f"valerie: {reason}\n".encode())
            if before_end is not None:
                keeper = threading.Thread(target=before_end, args=(reason,), daemon=True)
                keeper.start()
                keeper.join(_LAST_WORDS_SECONDS)
        finally:
            os._exit(TIMED_OUT)

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
