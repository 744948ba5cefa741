"""Requests that end a worker which lost the broker between taking a message and answering it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from celery import Task
from celery.worker import state
from celery.worker.request import Request

#: Exit code of a worker that lost the broker; Celery uses the same where it notices the loss.
BROKER_LOST: Final = 1


class WatchfulRequest(Request):  # type: ignore[misc]  # Celery has no types
    """A request that ends the worker when its message can neither be acknowledged nor, after the child died, be given back.

    Celery 5.7 logs the failure and counts the message as unacknowledged. With a prefetch window of one it then takes no
    further message, so it never notices that the connection is gone.
    """

    def __init__(self, message: Any, *arguments: Any, **keywords: Any) -> None:
        super().__init__(message, *arguments, **keywords)
        message.ack = _or_stop(message.ack)
        message.reject = _or_stop(message.reject)


def _or_stop(answer: Callable[..., None]) -> Callable[..., None]:
    def answer_or_stop(**options: bool) -> None:
        # Celery calls this later, from its event loop, and only logs exceptions.
        try:
            answer(**options)
        except Exception:
            state.should_stop = BROKER_LOST
            raise

    return answer_or_stop


class WatchfulTask(Task):  # type: ignore[misc]  # Celery has no types
    """Base of all tasks: a worker that cannot answer a message ends."""

    abstract = True
    Request = WatchfulRequest
