"""Work without a broker: ask the database for products until there have been none for a while.

Jobs of a batch system or an autoscaler start, take what is ready, and end by themselves.
"""

from __future__ import annotations

import random
import threading
from collections.abc import Sequence
from typing import Final

import psutil
import structlog

from valerie.db import claiming, processes, runs
from valerie.db.engine import database_time, reading
from valerie.errors import MissingDependency, TransientError
from valerie.pipeline.base.context import Context
from valerie.pipeline.work.stages import Maker, serve_queue
from valerie.runs.products.states import EVAL_QUEUE, RunState

log = structlog.get_logger()

#: Pause after the first round in which nothing was ready; each further one doubles it.
_PAUSE_SECONDS: Final = 1.0
#: Bounds of the longest pause. With few workers the first bound is the time until a small run is noticed; with many, one of
#: them looks soon anyway.
_LONGEST_SECONDS: Final = (3.0, 10.0)
#: Between the bounds, all workers together look so often in a second.
_LOOKS_PER_SECOND: Final = 6.0


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
    worked_at, pause, longest = context.elapsed(), _PAUSE_SECONDS, _LONGEST_SECONDS[1]
    while not stop.is_set():
        due, worked, finished = list[str](), list[bool](), False
        try:
            due, longest = _look(context, routes)
            worked = [serve_queue(context, maker, route) for route in due if not stop.is_set()]
            finished = _finish_runs(context) if EVAL_QUEUE in routes else False
        except TransientError as error:
            log.warning("worker.database", reason=str(error))
        if not context.fitness.fit():
            raise MissingDependency("this machine cannot make products any more; the log has the reason")
        if any(worked) or finished:
            worked_at = context.elapsed()
            if process.memory_info().rss > limit:
                log.warning("worker.memory", limit_mb=context.settings.worker_max_memory_mb)
                return
        elif (waited := context.elapsed() - worked_at) >= idle:
            log.info("worker.idle", seconds=idle)
            return
        else:
            # Jobs of one array start together; at random moments, they do not look together.
            stop.wait(min(pause * random.uniform(0.5, 1.0), idle - waited))  # noqa: S311
        pause = _PAUSE_SECONDS if due or finished else min(2 * pause, longest)


def _look(context: Context, routes: Sequence[str]) -> tuple[list[str], float]:
    """Return the queues with ready products, and the longest pause; idle workers only read."""
    with reading(context.engine) as connection:
        now = database_time(connection)
        due = [route for route in routes if claiming.any_due(connection, route, now=now)]
        shortest, longest = _LONGEST_SECONDS
        return due, min(max(processes.count_workers(connection, now=now) / _LOOKS_PER_SECOND, shortest), longest)


def _finish_runs(context: Context) -> bool:
    with reading(context.engine) as connection:
        finishing = runs.in_states(connection, (RunState.FINISHING,))
    if not finishing:
        return False
    # Results need the analysis, which workers otherwise start without.
    from valerie.pipeline.work.finish import finish_run

    ended = [finish_run(context, run.id) for run in finishing]
    return any(ended)
