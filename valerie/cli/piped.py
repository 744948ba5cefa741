"""What people read where nobody looks at a screen: in a file, or behind a pipe."""

from __future__ import annotations

from typing import Any, Final

from rich.console import Console

#: Wider than anything: no path is folded and nothing is cut to a screen that nobody looks at.
_ANY_WIDTH: Final = 10_000


class PipedConsole(Console):
    """A console whose lines are as long as what they say: rich fills tables and paragraphs with spaces."""

    def __init__(self, *, stderr: bool) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, width=_ANY_WIDTH)

    def print(self, *objects: Any, **options: Any) -> None:
        """As rich's, without spaces at the ends of lines."""
        with self.capture() as captured:
            super().print(*objects, **options)
        self.file.write("\n".join(line.rstrip(" ") for line in captured.get().split("\n")))
        self.file.flush()
