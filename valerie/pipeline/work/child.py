"""The forked process in which a worker's tasks run."""

from __future__ import annotations

import time
from typing import Final

from celery import Celery

from valerie.pipeline.base.context import Context
from valerie.pipeline.work.stages import Maker, serve_queue

#: Pause before an unfit worker tests itself again, seconds.
_REST_SECONDS: Final = 60.0


class Child:
    """The context and the maker of a worker's child process; empty in the parent."""

    def __init__(self) -> None:
        self._opened: tuple[Context, Maker] | None = None

    def open(self, context: Context, maker: Maker) -> None:
        """Set the context and the maker, which were opened after the fork; call once, in the child, before its first task."""
        self._opened = (context, maker)

    @property
    def context(self) -> Context:
        """Context that the child opened.

        Raises:
            RuntimeError: called in the parent.
        """
        return self._both[0]

    def serve(self, route: str) -> None:
        """Make products; see `valerie.pipeline.work.stages.serve_queue`. An unfit worker rests, and takes no other message."""
        context, maker = self._both
        while not context.fitness.fit():
            time.sleep(_REST_SECONDS)
        serve_queue(context, maker, route)

    @property
    def _both(self) -> tuple[Context, Maker]:
        if self._opened is None:
            raise RuntimeError("the worker's child process was not opened")
        return self._opened


def declare_task(name: str, app: Celery) -> Child:
    """Declare the task of a name that makes the products of a queue, and return the child that makes them."""
    child = Child()

    @app.task(name=name)  # type: ignore[untyped-decorator]
    def make(route: str) -> None:
        child.serve(route)

    return child
