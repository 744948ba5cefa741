"""Messages through a real Redis."""

from __future__ import annotations

import json
import socket
from base64 import b64decode
from collections.abc import Iterator
from math import ceil
from pathlib import Path

import pytest
import redis

from valerie.broker import Broker
from valerie.errors import TransientError
from valerie.runs.products.ready import Ready
from valerie.runs.products.states import ProductKind
from valerie.runs.products.turns import packet_size
from valerie.settings import load_settings

pytestmark = pytest.mark.processes

READY = [Ready(f"{number:032x}", ProductKind.LAYER, "render.test", "group", 0.0) for number in range(100)]


@pytest.fixture
def client(redis_url: str) -> Iterator[redis.Redis]:
    with redis.Redis(unix_socket_path=redis_url.partition("//")[2].partition("?")[0]) as client:
        yield client
        client.delete("render.test")


@pytest.fixture
def broker(redis_url: str) -> Broker:
    return Broker(load_settings({}, broker_url=redis_url))


def received(client: redis.Redis) -> list[str]:
    """The argument of each message, oldest first."""
    messages = [json.loads(text) for text in reversed(client.lrange("render.test", 0, -1))]
    return [json.loads(b64decode(message["body"]))[0][0] for message in messages]


def test_a_message_is_sent_for_every_packet(broker: Broker, client: redis.Redis) -> None:
    broker.send_products(READY)
    messages = received(client)
    assert messages == ["render.test"] * ceil(len(READY) / packet_size(ProductKind.LAYER))
    assert broker.queue_lengths(["render.test", "none"]) == {"render.test": 5, "none": 0}


def test_the_messages_of_one_call_travel_together(broker: Broker, client: redis.Redis) -> None:
    broker.send_products(READY[:1])  # connects, and declares the queue
    before = client.info("commandstats")["cmdstat_lpush"]["calls"]
    reads = client.info("stats")["total_reads_processed"]
    broker.send_products(READY)
    assert client.info("commandstats")["cmdstat_lpush"]["calls"] - before == 5
    assert client.info("stats")["total_reads_processed"] - reads <= 4  # two of them are these questions


def test_a_connection_that_was_closed_meanwhile_is_made_anew(broker: Broker, client: redis.Redis) -> None:
    broker.send_products(READY[:1])
    client.client_kill_filter(_type="normal", skipme=True)
    broker.send_products(READY[1:2])
    assert len(received(client)) == 2


def test_a_broker_that_is_away_is_a_transient_fault(tmp_path: Path) -> None:
    absent = f"redis+socket://{tmp_path / 'nobody.sock'}?virtual_host=0"
    broker = Broker(load_settings({}, broker_url=absent))
    for call in (
        lambda: broker.send_products(READY),
        lambda: broker.send_finish("r"),
        lambda: broker.queue_lengths(["q"]),
    ):
        with pytest.raises(TransientError, match="the broker does not answer"):
            call()


@pytest.mark.timeout(60)  # two minutes without a bound
def test_a_broker_that_hangs_is_asked_once_and_then_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "hung.sock"
    with socket.socket(socket.AF_UNIX) as hung:
        hung.bind(str(path))
        hung.listen()  # takes connections, as a stopped process does, and never answers
        broker = Broker(load_settings({}, broker_url=f"redis+socket://{path}?virtual_host=0"))
        for _ in range(2):
            for call in (
                lambda: broker.queue_lengths(["q"]),
                lambda: broker.send_products(READY),
                lambda: broker.send_finish("r"),
            ):
                with pytest.raises(TransientError, match="the broker does not answer"):
                    call()
