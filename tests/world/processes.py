"""Processes that tests kill."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

import psutil


def kill(processes: Iterable[psutil.Process]) -> None:
    """Kill -9 of processes that may have ended."""
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.kill()
