"""How a worker notices that the broker went away between taking a message and acknowledging it."""

from __future__ import annotations

from typing import Final

from celery.worker import state
from celery.worker.request import Request

#: Exit code of a worker that lost the broker; Celery uses the same where it notices by itself.
BROKER_LOST: Final = 1


class WatchfulRequest(Request):  # type: ignore[misc]  # Celery has no types
    """Ends the worker when an acknowledgement fails.

    Celery 5.7 logs the failure and goes on with the message counted as unacknowledged: with a prefetch window of one it
    then takes no message any more, not even to find out that the connection is gone.
    """

    def acknowledge(self) -> None:
        """As Celery's, and ask the worker to stop when it did not reach the broker."""
        super().acknowledge()
        if not self.message.acknowledged:
            state.should_stop = BROKER_LOST
