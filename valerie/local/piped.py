"""Human-readable output that goes to a file or a pipe."""

from __future__ import annotations

from typing import Any, Final

from rich.console import Console

#: Wider than any line, so that nothing is folded or cut.
_ANY_WIDTH: Final = 10_000


class PipedConsole(Console):
    """A console that drops the trailing spaces with which rich pads tables and paragraphs."""

    def __init__(self, *, stderr: bool) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, width=_ANY_WIDTH)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, without spaces at the ends of lines."""
        with self.capture() as captured:
            super().print(*objects, **options)
        self.file.write("\n".join(line.rstrip(" ") for line in captured.get().split("\n")))
        self.file.flush()
