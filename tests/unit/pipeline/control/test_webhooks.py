"""Webhooks, against a real server on this machine that does what each test wants."""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple

import pytest

from tests.world.blank import Pipeline
from valerie.errors import InvalidInput
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.diagnosis import diagnose
from valerie.pipeline.control.webhooks import signature_headers
from valerie.settings import load_settings

KEY = bytes(range(32))
SECRET = base64.b64encode(KEY).decode()
Make = Callable[..., Pipeline]


class Request(NamedTuple):
    headers: dict[str, str]
    body: bytes


class Receiver:
    """Keeps all requests and answers each with the next of ``statuses``, then with 204."""

    def __init__(self) -> None:
        self.requests: list[Request] = []
        self.statuses: list[int] = []
        self.headers: dict[str, str] = {}
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                outer.requests.append(Request({name.lower(): value for name, value in self.headers.items()}, body))
                self.send_response(outer.statuses.pop(0) if outer.statuses else 204)
                for name, value in outer.headers.items():
                    self.send_header(name, value)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}/ended"
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    receiver = Receiver()
    yield receiver
    receiver.close()


@pytest.fixture
def make(pipelines: Make, receiver: Receiver) -> Make:
    """Makes a pipeline with the receiver."""

    def made(**settings: Any) -> Pipeline:
        values = {"webhooks": receiver.url, "webhook_secret": SECRET, "webhook_networks": "127.0.0.0/8"}
        return pipelines(**{**values, **settings})

    return made


def later(pipeline: Pipeline, seconds: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Move the database's clock, as deliveries see it, and sweep."""
    from valerie.pipeline.control import webhooks

    real = webhooks.database_time
    monkeypatch.setattr(webhooks, "database_time", lambda connection: real(connection) + seconds)
    pipeline.loop.tick(everything=True)
    monkeypatch.setattr(webhooks, "database_time", real)


def problem(pipeline: Pipeline) -> str:
    (check,) = [check for check in diagnose(pipeline.context) if check.part == "webhook 127.0.0.1"]
    return check.problem


def test_the_signature_is_that_of_the_standards_example() -> None:
    key = base64.b64decode("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw")
    headers = signature_headers(key, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}')
    assert headers["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def test_a_run_that_ends_is_told_once(make: Make, receiver: Receiver) -> None:
    pipeline = make()
    run = pipeline.submit(owner="Ada")
    pipeline.loop.tick(everything=True)
    assert receiver.requests == []
    assert pipeline.run(run) == "completed"
    for _ in range(2):
        pipeline.loop.tick(everything=True)
    (request,) = receiver.requests
    message = json.loads(request.body)
    assert message["type"] == "run.ended"
    row = pipeline.row(run)
    assert message["data"] == {"run": run, "name": row.name, "state": "completed", "reason": None, "owner": "Ada"}
    assert problem(pipeline) == ""


def test_a_request_is_signed_as_the_standard_says(make: Make, receiver: Receiver) -> None:
    pipeline = make()
    lifecycle.cancel(pipeline.context, pipeline.submit())
    pipeline.loop.tick(everything=True)
    (request,) = receiver.requests
    signed = b".".join(
        (request.headers["webhook-id"].encode(), request.headers["webhook-timestamp"].encode(), request.body)
    )
    expected = base64.b64encode(hmac.new(KEY, signed, hashlib.sha256).digest()).decode()
    assert request.headers["webhook-signature"] == f"v1,{expected}"
    assert request.headers["content-type"] == "application/json"


def test_a_failed_request_is_repeated_later_with_the_same_id_and_body(
    make: Make, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = make()
    receiver.statuses = [503]
    lifecycle.cancel(pipeline.context, pipeline.submit())
    pipeline.loop.tick(everything=True)
    assert problem(pipeline).endswith("it answered with status 503")
    pipeline.loop.tick(everything=True)
    assert len(receiver.requests) == 1
    later(pipeline, 6.0, monkeypatch)
    first, second = receiver.requests
    assert (first.headers["webhook-id"], first.body) == (second.headers["webhook-id"], second.body)
    assert problem(pipeline) == ""


def test_it_is_given_up_after_a_day(make: Make, receiver: Receiver, monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline = make()
    receiver.statuses = [500]
    lifecycle.cancel(pipeline.context, pipeline.submit())
    pipeline.loop.tick(everything=True)
    later(pipeline, 86_401.0, monkeypatch)
    assert len(receiver.requests) == 1


def test_a_redirect_is_not_followed(make: Make, receiver: Receiver) -> None:
    pipeline = make()
    elsewhere = Receiver()
    receiver.statuses, receiver.headers = [307], {"Location": elsewhere.url}
    lifecycle.cancel(pipeline.context, pipeline.submit())
    pipeline.loop.tick(everything=True)
    elsewhere.close()
    assert elsewhere.requests == []
    assert problem(pipeline).endswith("it answered with status 307")


def test_a_private_address_that_is_not_listed_is_not_asked(make: Make, receiver: Receiver) -> None:
    pipeline = make(webhook_networks="10.0.0.0/8")
    lifecycle.cancel(pipeline.context, pipeline.submit())
    pipeline.loop.tick(everything=True)
    assert receiver.requests == []
    assert "limit: VALERIE_WEBHOOK_NETWORKS" in problem(pipeline)


def test_each_receiver_is_told_though_another_one_fails(make: Make, receiver: Receiver) -> None:
    broken = Receiver()
    broken.statuses = [500]
    pipeline = make(webhooks=f"{broken.url},{receiver.url}")
    lifecycle.cancel(pipeline.context, pipeline.submit())
    pipeline.loop.tick(everything=True)
    broken.close()
    assert (len(broken.requests), len(receiver.requests)) == (1, 1)


def test_a_resumed_run_ends_twice(make: Make, receiver: Receiver) -> None:
    pipeline = make()
    run = pipeline.submit()
    lifecycle.cancel(pipeline.context, run)
    pipeline.loop.tick(everything=True)
    lifecycle.resume(pipeline.context, run)
    assert pipeline.run(run) == "completed"
    pipeline.loop.tick(everything=True)
    assert [json.loads(request.body)["data"]["state"] for request in receiver.requests] == ["cancelled", "completed"]
    assert len({request.headers["webhook-id"] for request in receiver.requests}) == 2


def test_a_told_run_can_be_deleted(make: Make) -> None:
    pipeline = make()
    run = pipeline.submit()
    lifecycle.cancel(pipeline.context, run)
    pipeline.loop.tick(everything=True)
    lifecycle.delete(pipeline.context, run)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"webhooks": "https://ci.example/"}, "VALERIE_WEBHOOK_SECRET.*at least 24 bytes"),
        ({"webhooks": "https://ci.example/", "webhook_secret": "c2hvcnQ="}, "VALERIE_WEBHOOK_SECRET"),
        ({"webhooks": "https://ci.example/", "webhook_secret": "no base64!"}, "VALERIE_WEBHOOK_SECRET"),
        ({"webhooks": "ftp://ci.example/", "webhook_secret": SECRET}, "VALERIE_WEBHOOKS.*not a usable URL"),
        ({"webhook_networks": "intranet"}, "VALERIE_WEBHOOK_NETWORKS"),
    ],
)
def test_unusable_settings_are_refused_without_the_secret(settings: dict[str, str], message: str) -> None:
    with pytest.raises(InvalidInput, match=message) as error:
        load_settings({}, **settings)
    assert settings.get("webhook_secret", SECRET) not in str(error.value)
