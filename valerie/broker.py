"""All messages of the system: the Celery app, the queues and the tasks.

The database is the queue of record. A message only announces work: a short list of product digests that share a warm
cache. A message may be lost, repeated or late without harm, since workers claim products by compare-and-set and the
sweeper announces them again.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final

# A plain SIGTERM makes Celery wait for the running task, however long; remapped, the soft shutdown below applies. Celery
# reads this when it is imported.
os.environ.setdefault("REMAP_SIGTERM", "SIGQUIT")

from celery import Celery, Task
from kombu.exceptions import BatchPublishError, OperationalError
from redis.exceptions import RedisError

from valerie.errors import TransientError
from valerie.settings import Settings

RENDER: Final = "valerie.render"
INFER: Final = "valerie.infer"
EVALUATE: Final = "valerie.evaluate"
FINISH: Final = "valerie.finish"

#: Queue of evaluation and finishing. It has no numeric class, since counting integers is the same on every machine.
EVAL_QUEUE: Final = "eval"

_TASK_OF_STAGE: Final = {"render": RENDER, "infer": INFER, "eval": EVALUATE}

#: Products per message, by kind: large enough to spread overhead, small enough that a killed worker loses little.
#: Predictions: two batches of a GPU.
CHUNK: Final = {"background": 1, "layer": 24, "truth": 24, "prediction": 8, "evaluation": 24}
_OTHERS: Final = 24


def route_of(stage: str, name: str, numeric_class: str) -> str:
    """Return the queue of the workers of one numeric class, e.g. ``render.raster.llvmpipe-15``."""
    return f"{stage}.{name}.{numeric_class}"


class WatchfulTask(Task):  # type: ignore[misc]  # Celery has no types
    """Base class of all tasks: a worker that cannot acknowledge a message ends (`valerie.pipeline.base.requests`)."""

    abstract = True
    Request = "valerie.pipeline.base.requests:WatchfulRequest"


def create_app(settings: Settings) -> Celery:
    """Build the Celery app of one process; there is no global app."""
    app = Celery("valerie", broker=settings.broker_url, set_as_current=False, task_cls=WatchfulTask)
    app.conf.update(
        accept_content=["json"],
        task_serializer="json",
        result_backend=None,
        task_ignore_result=True,
        task_store_errors_even_if_ignored=False,
        # A message is acknowledged when its work is done, and returned to the queue if its process dies.
        task_acks_late=True,
        task_reject_on_worker_lost=True,
        task_default_queue=EVAL_QUEUE,
        task_create_missing_queues=True,
        worker_prefetch_multiplier=1,
        worker_concurrency=1,
        worker_soft_shutdown_timeout=settings.shutdown_seconds,
        worker_enable_soft_shutdown_on_idle=False,
        worker_max_tasks_per_child=settings.worker_max_tasks,
        worker_max_memory_per_child=settings.worker_max_memory_mb * 1024,
        worker_enable_remote_control=False,
        worker_send_task_events=False,
        worker_hijack_root_logger=False,
        # A worker that loses the broker ends and is started again (see `valerie.pipeline.work.workers.serve`).
        broker_connection_retry=False,
        broker_connection_retry_on_startup=True,
        broker_connection_max_retries=None,
        worker_cancel_long_running_tasks_on_connection_loss=False,
        broker_transport_options={
            # Longer than any task: an older message is delivered again, which is harmless since products are claimed.
            "visibility_timeout": settings.visibility_timeout_seconds,
            # By default, kombu restores about every 100 s; the messages of a killed worker must be back in seconds.
            "unacked_restore_interval": 1,
            "unacked_restore_throttle": 1,
            "unacked_restore_limit": 1000,
            "socket_timeout": 30,
            "socket_connect_timeout": 5,
            # No "retry_on_timeout": with it kombu sends one message at a time (see `send_products`).
            "socket_keepalive": True,
        },
        broker_transport="redis" if settings.broker_url.startswith("redis") else None,
        timezone="UTC",
    )
    return app


#: Options of every message. The representation of the arguments is fixed, since computing it doubles the cost.
_SENDING: Final[dict[str, Any]] = {
    "ignore_result": True,
    "kwargsrepr": "{}",
    "retry_policy": {"max_retries": 1, "interval_start": 0.1, "interval_max": 0.2},
}


@contextmanager
def _answering() -> Iterator[None]:
    """Convert the errors of an unreachable broker.

    Raises:
        TransientError: the broker does not answer.
    """
    try:
        yield
    except (OperationalError, BatchPublishError, RedisError, OSError) as error:
        raise TransientError(f"the broker does not answer: {error}") from error


class Broker:
    """Sends messages and inspects queues; one per process."""

    def __init__(self, app: Celery) -> None:
        self._app = app

    def send_products(self, ready: Iterable[tuple[str, str, str, str]]) -> None:
        """Announce products that are ready.

        Args:
            ready: (digest, kind, route, cache group). A message holds products of one route, kind and group.

        Raises:
            TransientError: the broker does not answer; the sweeper will announce the products again.
        """
        groups: dict[tuple[str, str, str], list[str]] = {}
        for digest, kind, route, group in ready:
            groups.setdefault((route, kind, group), []).append(digest)
        messages = [
            (_TASK_OF_STAGE[route.partition(".")[0]], digests[start : start + CHUNK.get(kind, _OTHERS)], route)
            for (route, kind, _), digests in groups.items()
            for start in range(0, len(digests), CHUNK.get(kind, _OTHERS))
        ]
        if not messages:
            return
        try:
            self._send_together(messages)
        except TransientError:
            # Only now is it noticed that a restarted broker closed the connection. Messages may repeat without harm.
            self._send_together(messages)

    def _send_together(self, messages: Iterable[tuple[str, list[str], str]]) -> None:
        """Send (task, digests, queue) in one round trip for a thousand messages instead of one each."""
        with _answering(), self._app.producer_or_acquire() as producer, producer.batch():
            for task, digests, queue in messages:
                self._app.send_task(
                    task,
                    args=[digests],
                    queue=queue,
                    producer=producer,
                    argsrepr=f"{len(digests)} products",
                    **_SENDING,
                )

    def send_finish(self, run_id: str) -> None:
        """Ask an evaluation worker to finish a run."""
        with _answering():
            self._app.send_task(FINISH, args=[run_id], queue=EVAL_QUEUE, argsrepr=run_id, **_SENDING)

    def queue_length(self, route: str) -> int:
        """Return the number of messages that wait in a queue, without those that a worker holds.

        Raises:
            TransientError: the broker does not answer.
        """
        with _answering(), self._app.connection_for_read() as connection:
            return int(connection.default_channel.client.llen(route))
