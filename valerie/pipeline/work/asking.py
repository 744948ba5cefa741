"""Work without a broker: ask the database for products until there have been none for a while.

Jobs of a batch system or an autoscaler start, take what is ready, and end by themselves.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final

import psutil
import structlog

from valerie.db import runs
from valerie.db.engine import reading
from valerie.errors import MissingDependency, TransientError
from valerie.pipeline.base.context import Context
from valerie.pipeline.work.stages import Maker, serve_queue
from valerie.runs.products.states import EVAL_QUEUE, RunState

log = structlog.get_logger()

#: Pause after a round in which nothing was ready, seconds.
_PAUSE_SECONDS: Final = 1.0


def ask_for_work(context: Context, maker: Maker, routes: Sequence[str], stop: threading.Event) -> None:
    """Make the products of some queues until ``stop`` is set or nothing was ready for `Settings.worker_idle_seconds`.

    Whoever serves the evaluation queue also finishes runs. The process also ends above `Settings.worker_max_memory_mb`,
    so that its batch system starts a fresh one.

    Raises:
        MissingDependency: this machine cannot make products any more.
    """
    limit = context.settings.worker_max_memory_mb * 2**20
    idle = context.settings.worker_idle_seconds or 0.0
    process = psutil.Process()
    worked_at = context.elapsed()
    while not stop.is_set():
        try:
            worked = [serve_queue(context, maker, route) for route in routes if not stop.is_set()]
            finished = _finish_runs(context) if EVAL_QUEUE in routes else False
        except TransientError as error:
            log.warning("worker.database", reason=str(error))
            worked, finished = [], False
        if not context.fitness.fit():
            raise MissingDependency("this machine cannot make products any more; the log has the reason")
        if any(worked) or finished:
            worked_at = context.elapsed()
            if process.memory_info().rss > limit:
                log.warning("worker.memory", limit_mb=context.settings.worker_max_memory_mb)
                return
        elif context.elapsed() - worked_at > idle:
            log.info("worker.idle", seconds=idle)
            return
        else:
            stop.wait(_PAUSE_SECONDS)


def _finish_runs(context: Context) -> bool:
    with reading(context.engine) as connection:
        finishing = runs.in_states(connection, (RunState.FINISHING,))
    if not finishing:
        return False
    # Results need the analysis, which workers otherwise start without.
    from valerie.pipeline.work.finish import finish_run

    ended = [finish_run(context, run.id) for run in finishing]
    return any(ended)
