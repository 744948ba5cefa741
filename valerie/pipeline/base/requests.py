"""Requests that end a worker which lost the broker between taking a message and acknowledging it."""

from __future__ import annotations

from typing import Any, Final

from celery import Task
from celery.worker import state
from celery.worker.request import Request

#: Exit code of a worker that lost the broker; Celery uses the same where it notices the loss.
BROKER_LOST: Final = 1


class WatchfulRequest(Request):  # type: ignore[misc]  # Celery has no types
    """A request that ends the worker when its acknowledgement fails.

    Celery 5.7 logs the failure and counts the message as unacknowledged. With a prefetch window of one it then takes no
    further message, so it never notices that the connection is gone.
    """

    def __init__(self, message: Any, *arguments: Any, **keywords: Any) -> None:
        super().__init__(message, *arguments, **keywords)
        acknowledge = message.ack

        def acknowledge_or_stop(multiple: bool = False) -> None:
            # Celery calls this later, from its event loop, and only logs exceptions.
            try:
                acknowledge(multiple=multiple)
            except Exception:
                state.should_stop = BROKER_LOST
                raise

        message.ack = acknowledge_or_stop


class WatchfulTask(Task):  # type: ignore[misc]  # Celery has no types
    """Base of all tasks: a worker that cannot acknowledge a message ends."""

    abstract = True
    Request = WatchfulRequest
