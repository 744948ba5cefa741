"""The tasks of the evaluation queue."""

from __future__ import annotations

from celery import Celery

from valerie.broker import EVALUATE, FINISH
from valerie.pipeline.work.child import Child, declare_task


def register(app: Celery) -> Child:
    """Declare the tasks on ``app``, and return the holder of the child's context."""
    child = declare_task(EVALUATE, app)

    @app.task(name=FINISH)  # type: ignore[untyped-decorator]
    def finish(run_id: str) -> None:
        # The analysis takes as long to import as all else here, and no product waits for it.
        from valerie.pipeline.work.finish import finish_run

        finish_run(child.context, run_id)

    return child
