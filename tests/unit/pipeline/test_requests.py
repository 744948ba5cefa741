"""Messages that a worker cannot answer because the broker is gone."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from celery import Celery
from celery.worker import state
from celery.worker.request import Request
from kombu.message import Message

from valerie.pipeline.base.requests import BROKER_LOST, WatchfulRequest


class _Gone:
    """The channel of a broker that has ended."""

    no_ack_consumers = None

    def basic_ack(self, tag: str, multiple: bool) -> None:
        raise ConnectionError

    def basic_reject(self, tag: str, requeue: bool) -> None:
        raise ConnectionError


@pytest.mark.parametrize(
    "answer",
    [
        pytest.param(lambda request: request.acknowledge(), id="acknowledged"),
        pytest.param(lambda request: request.reject(requeue=True), id="rejected, since the child was killed"),
    ],
)
def test_a_worker_ends_that_cannot_answer_a_message(
    answer: Callable[[Request], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(state, "should_stop", None)
    app = Celery(set_as_current=False)
    message = Message(
        "[[], {}, {}]", "tag", channel=_Gone(), content_type="application/json", headers={"id": "1", "task": "t"}
    )
    request = WatchfulRequest(
        message,
        app=app,
        task=app.Task(),
        on_ack=message.ack_log_error,
        on_reject=message.reject_log_error,
        connection_errors=(ConnectionError,),
    )
    answer(request)
    assert state.should_stop == BROKER_LOST
