"""The forked process in which a worker's tasks run: holds the context and the maker that were opened after the fork."""

from __future__ import annotations

from collections.abc import Sequence

from valerie.pipeline.base.context import Context
from valerie.pipeline.work.stages import Maker, run_stage


class Child:
    """Filled by `open` in the child; in the parent it stays empty."""

    def __init__(self) -> None:
        self._opened: tuple[Context, Maker] | None = None

    def open(self, context: Context, maker: Maker) -> None:
        """Called once, in the child, before its first task."""
        self._opened = (context, maker)

    @property
    def context(self) -> Context:
        """The child's context.

        Raises:
            RuntimeError: called in the parent.
        """
        if self._opened is None:
            raise RuntimeError("the worker's child process was not opened")
        return self._opened[0]

    def run(self, digests: Sequence[str]) -> None:
        """Make products; see `valerie.pipeline.work.stages`."""
        if self._opened is None:
            raise RuntimeError("the worker's child process was not opened")
        run_stage(*self._opened, digests)
