"""Protection of the endpoints: the token, pages of other sites, sizes of bodies."""

from __future__ import annotations

import asyncio
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from services.api import protection
from services.api.app import create_app
from tests.world.drawn import DrawnRuns
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.errors import InvalidInput, TransientError

TOKEN = "correct-horse-battery"


@pytest.fixture(scope="module")
def guarded(drawn: DrawnRuns) -> Iterator[httpx.Client]:
    """A server with a token, and a client that does not send it."""
    with served(create_app(settings_of(drawn.folder, api_token=TOKEN), control=False)) as client:
        yield client


def raw(client: httpx.Client, head: bytes) -> bytes:
    """Send raw bytes and return the answer."""
    with socket.create_connection((client.base_url.host, client.base_url.port or 80), timeout=20) as connection:
        connection.sendall(head)
        parts = []
        while part := connection.recv(65536):
            parts.append(part)
    return b"".join(parts)


def status_of(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


@pytest.mark.parametrize(
    "header", [None, "", "Bearer", "Bearer wrong", f"Basic {TOKEN}", f"Bearer {TOKEN}x", f"Bearer {TOKEN[:-1]}"]
)
def test_without_the_token_everything_is_refused(guarded: httpx.Client, header: str | None) -> None:
    headers = {} if header is None else {"Authorization": header}
    for path in ("/v1/runs", "/metrics", "/openapi.json", "/v1/nothing", "/v1/workers"):
        answer = guarded.get(path, headers=headers)
        assert answer.status_code == 401, path
        assert answer.headers["WWW-Authenticate"] == "Bearer"
        assert answer.headers["Content-Type"] == "application/problem+json"
        assert TOKEN not in answer.text
        assert guarded.head(path, headers=headers).status_code == 401, path


def test_the_token_gives_access_to_everything(guarded: httpx.Client) -> None:
    for scheme in ("Bearer", "bearer"):
        assert guarded.get("/v1/runs", headers={"Authorization": f"{scheme} {TOKEN}"}).status_code == 200


def test_a_token_that_is_not_ascii_is_refused_without_an_internal_error(guarded: httpx.Client) -> None:
    answer = raw(
        guarded, b"GET /v1/runs HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer \xff\xfe\r\nConnection: close\r\n\r\n"
    )
    assert status_of(answer) == 401


def test_health_and_the_dashboards_files_need_no_token(guarded: httpx.Client) -> None:
    for path in ("/healthz", "/dashboard/", "/dashboard/main.js", "/"):
        assert guarded.get(path).status_code in (200, 307), path


def test_open_paths_do_not_bypass_the_token(guarded: httpx.Client) -> None:
    for path in (
        b"/dashboard/../v1/runs",
        b"/dashboard/%2e%2e/v1/runs",
        b"//v1/runs",
        b"/healthz/../v1/runs",
        b"/dashboard/..%2f..%2fapp.py",
    ):
        answer = raw(guarded, b"GET " + path + b" HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        assert status_of(answer) in (401, 404), path


def test_the_token_is_compared_in_constant_time() -> None:
    source = (Path(__file__).parents[4] / "services/api/protection.py").read_text()
    assert "hmac.compare_digest(" in source
    assert not re.search(r"[!=]= *self\._token|self\._token *[!=]=", source)


def test_an_exposed_server_without_a_token_does_not_start(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="VALERIE_API_TOKEN"):
        create_app(settings_of(tmp_path, api_host="0.0.0.0"), control=False)


def test_an_exposed_server_with_a_short_token_does_not_start(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="16 characters"):
        create_app(settings_of(tmp_path, api_host="0.0.0.0", api_token="short"), control=False)


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "attacker.example"},
        {"Host": "127.0.0.1.attacker.example"},
        {"Host": "["},
        {"Origin": "https://attacker.example"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "http://["},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"},
        {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "cors"},
    ],
)
def test_other_sites_and_rebound_host_names_are_refused(api: httpx.Client, headers: dict[str, str]) -> None:
    for method, path in (("GET", "/v1/runs"), ("POST", "/v1/runs"), ("DELETE", "/v1/runs/r1")):
        answer = api.request(method, path, headers=headers)
        assert answer.status_code == 403
        assert answer.headers["Content-Type"] == "application/problem+json"


def test_the_servers_own_page_is_allowed(api: httpx.Client) -> None:
    origin = str(api.base_url).rstrip("/")
    assert api.get("/v1/runs", headers={"Origin": origin}).status_code == 200


def test_a_link_from_another_site_may_be_followed_but_changes_nothing(api: httpx.Client) -> None:
    headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    assert api.get("/v1/runs", headers=headers).status_code == 200
    assert api.post("/v1/runs", headers=headers).status_code == 403


def test_no_answer_allows_other_origins(api: httpx.Client) -> None:
    assert not [name for name in api.get("/v1/runs").headers if name.startswith("access-control")]


def test_every_answer_has_the_headers_for_browsers(api: httpx.Client, guarded: httpx.Client) -> None:
    answers = [
        api.get("/v1/runs"),
        api.get("/v1/runs/nope"),
        api.get("/dashboard/"),
        guarded.get("/v1/runs"),
        api.get("/v1/x"),
    ]
    for answer in answers:
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert "X-Frame-Options" in answer.headers
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"


def test_a_body_of_ten_megabytes_is_refused_by_its_length(api: httpx.Client) -> None:
    answer = api.post("/v1/runs", content=b" " * 10_000_000)
    assert answer.status_code == 413
    assert answer.json()["errors"] == [
        {"field": "body", "message": "too large", "value": "10000000", "limit": 2_000_000}
    ]


def test_a_stream_of_ten_megabytes_is_refused_when_it_passes_the_limit(api: httpx.Client) -> None:
    answer = api.post("/v1/runs", content=(b" " * 100_000 for _ in range(100)))
    assert answer.status_code == 413


@pytest.mark.parametrize("length", [b"\xb2", b"-1", b"99999999999999999999999", b"1e3"])
def test_an_unusable_length_is_refused(api: httpx.Client, length: bytes) -> None:
    head = b"POST /v1/plan HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\nContent-Length: " + length + b"\r\n\r\n"
    assert status_of(raw(api, head)) in (400, 413)


@pytest.mark.parametrize("path", [b"/v1/plan", b"/v1/functions"])
def test_a_body_that_does_not_arrive_is_given_up(drawn: DrawnRuns, path: bytes) -> None:
    with served(create_app(settings_of(drawn.folder, body_seconds=0.2), control=False)) as client:
        head = b"POST " + path + b" HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\nContent-Length: 100\r\n"
        answer = raw(client, head + b"Content-Type: multipart/form-data; boundary=b\r\n\r\n--b")
    assert status_of(answer) == 408
    assert b"limit: 0.2 s" in answer


def trickled(client: httpx.Client, begin: bytes) -> tuple[int, bytes]:
    """Send a byte every tenth of a second behind ``begin``; return the number of bytes until the end, and the answer."""
    answer = b""
    with socket.create_connection((client.base_url.host, client.base_url.port or 80), timeout=0.1) as connection:
        connection.sendall(begin)
        for sent in range(200):
            try:
                part = connection.recv(65536)
                if not part:
                    return sent, answer
                answer += part
            except TimeoutError:
                connection.sendall(b"x")
            except ConnectionError:
                return sent, answer
    return 200, answer


@pytest.mark.parametrize(
    ("begin", "status"),
    [
        (b"", b""),
        (b"GET /v1/runs HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ", b""),
        (b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET /healthz HTTP/1.1\r\nX-Slow: ", b"HTTP/1.1 200"),
        (b"POST /v1/runs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9999\r\n\r\n", b"HTTP/1.1 401"),
    ],
    ids=["first byte", "head", "second head", "body of a refused request"],
)
def test_a_stranger_who_sends_slowly_loses_the_connection(drawn: DrawnRuns, begin: bytes, status: bytes) -> None:
    with served(create_app(settings_of(drawn.folder, api_token=TOKEN), control=False), head_seconds=1) as client:
        sent, answer = trickled(client, begin)
        assert sent < 200
        assert answer.startswith(status)
        assert client.get("/healthz").status_code == 200


def test_a_stranger_who_sends_nothing_loses_the_connection(drawn: DrawnRuns) -> None:
    with served(create_app(settings_of(drawn.folder), control=False), head_seconds=1) as client:
        assert raw(client, b"") == b""


def test_an_answer_may_take_longer_than_a_request() -> None:
    async def late(_request: Request) -> PlainTextResponse:
        await asyncio.sleep(1.5)
        return PlainTextResponse("late")

    with served(Starlette(routes=[Route("/", late)]), head_seconds=1) as client:
        assert client.get("/").text == "late"


class LargeAnswer(Response):
    """Sends ``size`` bytes, more than the kernel holds, and notes when the client has gone."""

    def __init__(self, size: int, gone: threading.Event) -> None:
        super().__init__()
        self._size, self._gone = size, gone

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = [(b"content-length", str(self._size).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": bytes(self._size), "more_body": True})
        while (await receive())["type"] != "http.disconnect":
            continue
        self._gone.set()


def test_a_client_that_never_reads_its_answer_loses_the_connection() -> None:
    gone = threading.Event()
    routes = [
        Route("/", lambda _request: LargeAnswer(1 << 25, gone)),
        Route("/small", lambda _: PlainTextResponse("-")),
    ]
    with served(Starlette(routes=routes), unread_seconds=1.0) as client:
        with socket.create_connection((client.base_url.host, client.base_url.port or 80)) as end:
            end.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert gone.wait(60)
        assert client.get("/small").text == "-"


def test_a_client_that_reads_slowly_has_the_whole_answer() -> None:
    size, gone = 1 << 23, threading.Event()
    with (
        served(Starlette(routes=[Route("/", lambda _request: LargeAnswer(size, gone))]), unread_seconds=3.0) as client,
        socket.socket() as end,
    ):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        end.connect((client.base_url.host, client.base_url.port or 80))
        end.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        taken = 0
        while taken < size and (data := end.recv(1 << 18)):  # in more than the limit
            taken += len(data)
            time.sleep(0.05)
    assert taken >= size


def test_a_database_that_does_not_answer_is_said_when_it_should_know_the_token(
    drawn: DrawnRuns, monkeypatch: pytest.MonkeyPatch
) -> None:
    def silent(_context: object, _secret: str) -> None:
        raise TransientError("the database does not answer")

    monkeypatch.setattr(protection, "caller_of", silent)
    with served(create_app(settings_of(drawn.folder, api_token=TOKEN), control=False)) as client:
        answer = client.get("/v1/runs", headers={"Authorization": "Bearer valerie_secret"})
        assert (answer.status_code, answer.json()["detail"]) == (503, "the database does not answer")
        assert client.get("/healthz").status_code == 200
