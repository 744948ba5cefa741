"""Lines about the progress of a command, on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Final

from valerie.cli.shell import say

#: Shortest time between two lines of progress.
LINE_SECONDS: Final = 5.0


class ProgressLines:
    """Prints progress as one line every few seconds: how many, how fast, how long."""

    def __init__(self, what: str) -> None:
        self._what, self._shown_at = what, time.monotonic()

    def tell(self, done: int, total: int, per_s: float, note: str = "") -> None:
        """Print a line if the last one is a few seconds old, or everything is done."""
        if time.monotonic() - self._shown_at < LINE_SECONDS and done < total:
            return
        self._shown_at = time.monotonic()
        from valerie.runs.moments import duration

        text = f"{done:,} of {total:,} {self._what}" + (f" ({note})" if note else "")
        if per_s:
            text += f", {per_s:.1f}/s" if per_s >= 1 else f", {1 / per_s:.1f} s each"
            if done < total:
                text += f", {duration((total - done) / per_s)} left"
        say(text)


def on_terminal() -> bool:
    """Return True if people see standard error."""
    return sys.stderr.isatty()


def counting(what: str) -> Callable[[int, int], None]:
    """Return a function that is told how many are done, of how many, and shows it if somebody sees it."""
    shown = on_terminal()
    lines, began = ProgressLines(what), time.monotonic()

    def tell(done: int, total: int) -> None:
        if shown and done < total:  # the result follows at once
            lines.tell(done, total, done / max(time.monotonic() - began, 1e-9))

    return tell
