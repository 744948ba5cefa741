"""Messages through a real RabbitMQ, in quorum queues."""

from __future__ import annotations

from math import ceil
from pathlib import Path

import pytest

from tests.acceptance.system import System
from tests.cluster.conftest import DOCUMENT, Outcome
from tests.cluster.rabbitmq import free_port
from valerie.broker import Broker
from valerie.errors import TransientError
from valerie.runs.products.ready import Ready
from valerie.runs.products.states import ProductKind
from valerie.runs.products.turns import packet_size
from valerie.settings import load_settings

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]

READY = [Ready(f"{number:032x}", ProductKind.LAYER, "render.test", "group", 0.0) for number in range(100)]


def test_a_message_waits_for_every_packet(rabbitmq_url: str) -> None:
    broker = Broker(load_settings({}, broker_url=rabbitmq_url))
    broker.send_products(READY)
    waiting = ceil(len(READY) / packet_size(ProductKind.LAYER))
    assert broker.queue_lengths(["render.test", "unknown"]) == {"render.test": waiting, "unknown": 0}


def test_a_server_that_is_away_is_a_transient_fault() -> None:
    broker = Broker(load_settings({}, broker_url=f"amqp://guest:guest@127.0.0.1:{free_port()}//"))
    for call in (
        lambda: broker.send_products(READY),
        lambda: broker.send_finish("r"),
        lambda: broker.queue_lengths(["q"]),
    ):
        with pytest.raises(TransientError, match="the broker does not answer"):
            call()


def test_a_run_through_rabbitmq_ends_as_one_through_redis(
    rabbitmq_url: str, assets: Path, tmp_path: Path, calm: Outcome
) -> None:
    with System(tmp_path, assets, broker_url=rabbitmq_url) as system:
        run = system.submit(DOCUMENT)
        assert system.wait(run) == "completed"
        assert (system.rows(run), system.objects()) == calm
