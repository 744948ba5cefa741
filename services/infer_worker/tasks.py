"""The task of the inference queues."""

from __future__ import annotations

from celery import Celery

from valerie.broker import INFER
from valerie.pipeline.work.child import Child


def register(app: Celery) -> Child:
    """Declare the task on ``app``, and return the holder of the child's context."""
    child = Child()

    @app.task(name=INFER)  # type: ignore[untyped-decorator]
    def infer(route: str) -> None:
        child.serve(route)

    return child
