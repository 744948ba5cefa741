"""Against a real server on this machine that does what each test wants, and remembers what it was asked."""

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.label_server import Server, dark_is_one
from valerie.errors import InferenceError, InvalidInput
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import parse_function
from valerie.perception.running.label_png import encode_png, max_label_bytes
from valerie.perception.running.opening import open_function
from valerie.testing.perception import PerceptionContract

ALLOWED = ("127.0.0.0/8",)


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()


def opened(url: str, allowed: tuple[str, ...] = ALLOWED, **options: Any) -> PerceptionFunction:
    document = {
        "name": "remote",
        "kind": "http",
        "options": {"url": url, "timeout_s": 5, **options},
        "output": {"kind": "labels", "classes": ["not", "human"], "class_map": {"human": "person"}},
    }
    return open_function(parse_function(document), None, addresses=allowed)


PICTURE = np.zeros((20, 30, 3), np.uint8)
PICTURE[:, 10:] = 200
EXPECTED = np.where(np.arange(30) < 10, 11, 255)[None].repeat(20, axis=0)


class TestHttpFunction(PerceptionContract):
    @pytest.fixture
    def function(self, server: Server) -> PerceptionFunction:
        return opened(server.url)


def test_the_answer_is_mapped_to_train_ids(server: Server) -> None:
    np.testing.assert_array_equal(opened(server.url).predict(PICTURE), EXPECTED)


def test_the_request_follows_the_contract(server: Server) -> None:
    opened(server.url).predict(PICTURE)
    ((path, headers),) = server.requests
    assert path == "/predict?m=1"
    assert headers["Content-Type"] == headers["Accept"] == "image/png"
    assert headers["Valerie-Function"] == "remote"
    assert headers["Host"] == server.url.split("/")[2]


def test_the_picture_arrives_bit_for_bit(server: Server) -> None:
    requests = []

    def remember(handler: BaseHTTPRequestHandler, picture: NDArray[np.uint8]) -> None:
        requests.append(picture.copy())
        server.good(handler, picture)

    server.answer = remember
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    opened(server.url).predict(picture)
    np.testing.assert_array_equal(requests[0], picture)


def test_no_connection_is_made_to_an_address_that_the_operator_did_not_list(server: Server) -> None:
    with pytest.raises(InvalidInput, match="not on the operator's list"):
        opened(server.url, allowed=("10.0.0.0/8",))
    assert server.requests == []


def test_redirects_are_not_followed(server: Server) -> None:
    elsewhere = Server()
    server.answer = lambda handler, _: server.send(handler, b"", 302, Location=elsewhere.url)
    with pytest.raises(InferenceError, match="status 302"):
        opened(server.url).predict(PICTURE)
    elsewhere.close()
    assert elsewhere.requests == []


def test_a_missing_answer_is_a_failure_and_the_picture_is_sent_once(server: Server) -> None:
    server.answer = lambda *_: time.sleep(2)
    with pytest.raises(InferenceError, match=r"no answer within 0\.3 s"):
        opened(server.url, timeout_s=0.3).predict(PICTURE)
    assert len(server.requests) == 1


def test_an_answer_that_drips_is_cut_off_in_time(server: Server) -> None:
    cut = threading.Event()

    def drip(handler: BaseHTTPRequestHandler, _: NDArray[np.uint8]) -> None:
        handler.send_response(200)
        handler.send_header("Content-Length", "1000")
        handler.end_headers()
        try:
            for _ in range(1000):
                handler.wfile.write(b"x")
                handler.wfile.flush()
                time.sleep(0.05)
        except OSError:
            cut.set()

    server.answer = drip
    with pytest.raises(InferenceError, match=r"no answer within 0\.4 s"):
        opened(server.url, timeout_s=0.4).predict(PICTURE)
    assert cut.wait(60)  # the connection ends before the last byte


@pytest.mark.parametrize("status", [404, 500, 503, 204])
def test_any_other_status_is_a_failure(server: Server, status: int) -> None:
    server.answer = lambda handler, _: server.send(handler, b"", status)
    with pytest.raises(InferenceError, match=f"status {status}"):
        opened(server.url).predict(PICTURE)
    assert len(server.requests) == 1


def test_an_endless_answer_is_abandoned(server: Server) -> None:
    def endless(handler: BaseHTTPRequestHandler, _: NDArray[np.uint8]) -> None:
        handler.send_response(200)
        handler.send_header("Connection", "close")
        handler.end_headers()
        try:
            while True:
                handler.wfile.write(b"\0" * 65_536)
        except OSError:
            pass

    server.answer = endless
    with pytest.raises(InferenceError, match=f"more than {max_label_bytes(20, 30)} bytes"):
        opened(server.url).predict(PICTURE)


def test_an_answer_that_ends_early_is_a_failure(server: Server) -> None:
    def short(handler: BaseHTTPRequestHandler, picture: NDArray[np.uint8]) -> None:
        body = encode_png(dark_is_one(picture))
        server.send(handler, body[:-5], Content_Length=str(len(body)))
        handler.close_connection = True

    server.answer = short
    with pytest.raises(InferenceError, match="5 bytes early"):
        opened(server.url).predict(PICTURE)


@pytest.mark.parametrize("body", [b"", b"{}", encode_png(np.zeros((20, 31), np.uint8)), encode_png(PICTURE)])
def test_an_answer_that_is_not_a_label_map_of_the_frame_is_a_failure(server: Server, body: bytes) -> None:
    server.answer = lambda handler, _: server.send(handler, body)
    with pytest.raises(InferenceError, match="remote: answer"):
        opened(server.url).predict(PICTURE)


def test_another_version_than_the_registered_one_is_a_failure(server: Server) -> None:
    server.answer = lambda handler, picture: server.send(
        handler, encode_png(dark_is_one(picture)), Function_Version="2026-11"
    )
    np.testing.assert_array_equal(opened(server.url, version="2026-11").predict(PICTURE), EXPECTED)
    with pytest.raises(InferenceError, match="has version '2026-11'; '2026-12' is registered"):
        opened(server.url, version="2026-12").predict(PICTURE)


def test_a_missing_server_is_a_failure(server: Server) -> None:
    function = opened(server.url)
    server.close()
    with pytest.raises(InferenceError, match=r"remote: 127\.0\.0\.1:\d+: ConnectionRefusedError"):
        function.predict(PICTURE)


def test_the_card_states_nothing_about_the_endpoints_hardware(server: Server) -> None:
    function = opened(server.url)
    assert (function.card.engine, function.card.precision, function.numeric_class) == ("http", "remote", "http")
