"""All messages of the system: the Celery app, the names of the tasks, and the sender.

The database is the queue of record. A message only notifies workers that a packet of products became ready in a queue; the
worker that takes it claims the packet whose turn it is. A message may be lost, duplicated or late without harm: workers claim
products by compare-and-set, and the sweep sends it again.
"""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

from valerie.errors import TransientError
from valerie.plain import JsonObject
from valerie.runs.products.ready import Ready
from valerie.runs.products.states import EVAL_QUEUE, Stage, stage_of
from valerie.runs.products.turns import packet_size
from valerie.settings import NO_BROKER, Settings

if TYPE_CHECKING:
    from celery import Celery
    from kombu.connection import Connection

# On a plain SIGTERM, Celery would wait for the running task without limit. Remapped, the soft shutdown below applies. Celery
# reads this when it is imported, which commands that send nothing never do.
os.environ.setdefault("REMAP_SIGTERM", "SIGQUIT")

RENDER: Final = "valerie.render"
INFER: Final = "valerie.infer"
EVALUATE: Final = "valerie.evaluate"
FINISH: Final = "valerie.finish"

_TASK_OF_STAGE: Final = {Stage.RENDER: RENDER, Stage.INFER: INFER, Stage.EVAL: EVALUATE}

#: Time limit for an answer of the broker, seconds. Redis needs milliseconds.
_ANSWER_SECONDS: Final = 2.0
_QUIET_SECONDS: Final = 5.0


def create_celery(settings: Settings, *, answer_seconds: float = 30.0) -> Celery:
    """Build the Celery app of one process from its settings.

    Args:
        answer_seconds: time limit for an answer of the broker. It is long for consumers, since losing the broker ends them.
    """
    from celery import Celery

    task = "valerie.pipeline.base.requests:WatchfulTask"
    app = Celery("valerie", broker=settings.broker_url, set_as_current=False, task_cls=task)
    app.conf.update(
        accept_content=["json"],
        task_serializer="json",
        result_backend=None,
        task_ignore_result=True,
        task_store_errors_even_if_ignored=False,
        # A message is acknowledged when its work is done, and requeued when the process dies.
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
        # A worker that loses the broker ends and is restarted (see `valerie.pipeline.work.workers.serve`).
        broker_connection_retry=False,
        broker_connection_retry_on_startup=True,
        broker_connection_max_retries=None,
        worker_cancel_long_running_tasks_on_connection_loss=False,
        **(_rabbitmq(answer_seconds) if _is_rabbitmq(settings) else _redis(settings, answer_seconds)),
        timezone="UTC",
    )
    return app


def _is_rabbitmq(settings: Settings) -> bool:
    return settings.broker_url.startswith(("amqp", "pyamqp"))


def _redis(settings: Settings, answer_seconds: float) -> JsonObject:
    """Return the options of Redis and Valkey."""
    return {
        "broker_transport": "redis" if settings.broker_url.startswith("redis") else None,
        "broker_transport_options": {
            # Longer than any task. A message that outlives it is delivered twice, which the claim makes harmless.
            "visibility_timeout": settings.visibility_timeout_seconds,
            # By default, kombu would restore a killed worker's messages after about 100 s instead of within seconds.
            "unacked_restore_interval": 1,
            "unacked_restore_throttle": 1,
            "unacked_restore_limit": 1000,
            "socket_timeout": answer_seconds,
            "socket_connect_timeout": min(answer_seconds, 5.0),
            # No "retry_on_timeout": with it, kombu would send one message at a time (see `send_products`).
            "socket_keepalive": True,
        },
    }


def _rabbitmq(answer_seconds: float) -> JsonObject:
    """Return the options of RabbitMQ: queues are replicated (quorum queues), messages are confirmed."""
    return {
        "task_default_queue_type": "quorum",
        "task_create_missing_queue_type": "quorum",
        "broker_connection_timeout": min(answer_seconds, 5.0),
        "broker_heartbeat": 10,
        "broker_transport_options": {
            "confirm_publish": True,
            "read_timeout": answer_seconds,
            "write_timeout": answer_seconds,
        },
    }


#: Options of every message. The readable texts in its header are constant, since building them would double the cost.
_SENDING: Final = {
    "ignore_result": True,
    "kwargsrepr": "{}",
    "retry_policy": {"max_retries": 1, "interval_start": 0.1, "interval_max": 0.2},
}


class TaskMessage(NamedTuple):
    """A message: a task, its argument (a queue, or the run to finish), and the queue that it is sent to."""

    task: str
    argument: str
    queue: str


def messages_of(ready: Iterable[Ready]) -> list[TaskMessage]:
    """Return one message per packet, so that workers that answer them all leave no ready product behind."""
    packets = Counter((product.route, product.kind, product.cache_group, product.turn) for product in ready)
    return [
        TaskMessage(_TASK_OF_STAGE[stage_of(route)], route, route)
        for (route, kind, _, _), count in packets.items()
        for _ in range(0, count, packet_size(kind))
    ]


class Broker:
    """Sends messages and measures queues; one per process. Without a broker (`Settings.broker_url` is ``none``) it does nothing.

    If a broker keeps its connections open but does not answer within `_ANSWER_SECONDS`, callers are refused at once for
    `_QUIET_SECONDS`, so that no thread waits for long.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._absent = settings.broker_url == NO_BROKER
        self._rabbitmq = _is_rabbitmq(settings)
        self._quiet_until = -math.inf

    @cached_property
    def _app(self) -> Celery:
        return create_celery(self._settings, answer_seconds=_ANSWER_SECONDS)

    def send_products(self, ready: Iterable[Ready]) -> None:
        """Notify workers of ready products.

        Raises:
            TransientError: the broker does not answer.
        """
        messages = messages_of(ready)
        if self._absent or not messages:
            return
        with self._answering():
            try:
                self._send_together(messages)
            except _silence() as error:
                if _timed_out(error):
                    raise
                # Only sending reveals that a restarted broker has closed the connection. Messages may arrive twice, which is
                # harmless.
                self._send_together(messages)

    def _send_together(self, messages: Iterable[TaskMessage]) -> None:
        """Send messages, a thousand per round trip."""
        with self._app.producer_or_acquire() as producer, producer.batch():
            for task, argument, queue in messages:
                self._app.send_task(
                    task, args=[argument], queue=queue, producer=producer, argsrepr=argument, **_SENDING
                )

    def send_finish(self, run_id: str) -> None:
        """Ask an evaluation worker to finish a run."""
        if self._absent:
            return
        with self._answering():
            self._send_together([TaskMessage(FINISH, run_id, EVAL_QUEUE)])

    def queue_lengths(self, routes: Collection[str]) -> dict[str, int]:
        """Return the number of messages that wait in each queue, without those that a worker holds; nothing without a broker.

        Raises:
            TransientError: the broker does not answer.
        """
        if self._absent:
            return {}
        with self._answering(), self._app.connection_for_read() as connection:
            if self._rabbitmq:
                return {route: _length(connection, route) for route in routes}
            pipeline = connection.channel().client.pipeline(transaction=False)
            for route in routes:
                pipeline.llen(route)
            return dict(zip(routes, map(int, pipeline.execute()), strict=True))

    @contextmanager
    def _answering(self) -> Iterator[None]:
        """Convert the errors of a stopped broker to ours."""
        if time.monotonic() < self._quiet_until:
            raise TransientError("the broker does not answer: a request timed out a moment ago")
        try:
            yield
        except _silence() as error:
            if _timed_out(error):
                self._quiet_until = time.monotonic() + _QUIET_SECONDS
            raise TransientError(f"the broker does not answer: {error}") from error


def _length(connection: Connection, queue: str) -> int:
    """Return the number of messages in a queue of RabbitMQ."""
    from amqp.exceptions import NotFound

    # A question about an unknown queue closes its channel, so each has its own.
    channel = connection.channel()  # type: ignore[no-untyped-call]  # kombu
    try:
        return int(channel.queue_declare(queue, passive=True).message_count)
    except NotFound:
        return 0
    finally:
        channel.close()


def _silence() -> tuple[type[BaseException], ...]:
    """Return the errors that the libraries raise when the broker does not answer."""
    from amqp.exceptions import AMQPError
    from kombu.exceptions import BatchPublishError, OperationalError
    from redis.exceptions import RedisError

    return OperationalError, BatchPublishError, RedisError, AMQPError, OSError


def _timed_out(error: BaseException | None) -> bool:
    """Return True if a time-out caused an error."""
    from redis.exceptions import TimeoutError as RedisTimeout

    while error is not None:
        if isinstance(error, TimeoutError | RedisTimeout):
            return True
        error = error.__cause__ or error.__context__
    return False
