"""The REST client: typed answers, problems as readable errors."""

import json
from collections.abc import Callable
from datetime import UTC, datetime

import httpx
import pytest

from valerie.client import Client, ServerProblemError, ServerUnavailableError
from valerie.errors import InvalidInput
from valerie.runs.products.states import Priority

RUN = {
    "id": "r1",
    "name": "first",
    "state": "running",
    "reason": None,
    "variant_count": 12,
    "rejected_count": 1,
    "created_at": "2026-01-02T03:04:05Z",
    "started_at": None,
    "finished_at": None,
    "something_new": 1,
}


def _client(answer: Callable[[httpx.Request], httpx.Response], token: str | None = None) -> Client:
    return Client("http://127.0.0.1:8700/", token=token, transport=httpx.MockTransport(answer))


def _problem(status: int, **members: object) -> Client:
    return _client(lambda _: httpx.Response(status, json=members, headers={"content-type": "application/problem+json"}))


def test_a_spec_is_posted_as_it_was_written_with_its_idempotency_key() -> None:
    requests: list[httpx.Request] = []

    def answer(request: httpx.Request) -> httpx.Response:
        requests.append(request)
        return httpx.Response(202, json=RUN)

    run = _client(answer).submit(b"name: first\n", idempotency_key="k1", priority=Priority.HIGH)
    assert (run.id, run.variant_count) == ("r1", 12)
    assert (requests[0].method, requests[0].url.path) == ("POST", "/v1/runs")
    assert dict(requests[0].url.params) == {"priority": "high"}
    _client(answer).submit(b"name: first\n", deadline=datetime(2026, 12, 1, 6, tzinfo=UTC))
    assert dict(requests[1].url.params) == {"priority": "normal", "deadline": "2026-12-01T06:00:00+00:00"}
    assert requests[0].content == b"name: first\n"
    assert requests[0].headers["idempotency-key"] == "k1"
    assert requests[0].headers["content-type"] == "application/yaml"


def test_the_token_goes_with_every_request() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        assert request.headers["authorization"] == "Bearer opensesame"
        return httpx.Response(200, json=RUN)

    assert _client(answer, token="opensesame").run("r1").name == "first"


def test_pages_are_followed_until_enough_runs_are_there() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        cursor = int(request.url.params.get("cursor", 0))
        items = [{**RUN, "id": f"r{cursor + i}"} for i in range(int(request.url.params["limit"]))]
        return httpx.Response(200, json={"items": items, "next": str(cursor + len(items))})

    assert [run.id for run in _client(answer).runs(limit=120)] == [f"r{i}" for i in range(120)]


def test_the_last_page_ends_the_list() -> None:
    client = _client(lambda _: httpx.Response(200, json={"items": [RUN], "next": None}))
    assert len(list(client.runs(limit=50))) == 1


def test_a_problem_is_shown_by_its_detail() -> None:
    client = _problem(422, title="UnknownName", detail="functions.0: unknown function 'deeplab'; did you mean …?")
    with pytest.raises(ServerProblemError, match=r"functions\.0: unknown function") as caught:
        client.submit(b"x")
    assert caught.value.status == 422
    assert caught.value.is_callers_fault


@pytest.mark.parametrize("url", ["foo", "foo:8700", "127.0.0.1:8700", "ftp://host", "http://", "", "http://[::1"])
def test_what_is_no_address_is_refused_with_the_right_form(url: str) -> None:
    with pytest.raises(InvalidInput, match="not the address of a server") as caught:
        Client(url)
    assert caught.value.field == "url"
    assert "http://HOST:PORT" in str(caught.value)


def test_a_missing_token_is_explained() -> None:
    with pytest.raises(ServerProblemError, match="VALERIE_API_TOKEN"):
        _problem(401, title="Unauthorized", detail="a bearer token is needed").run("r1")


def test_a_fault_of_the_server_is_not_the_callers() -> None:
    with pytest.raises(ServerProblemError) as caught:
        _problem(507, title="StorageFull", detail="no space left").submit(b"x")
    assert not caught.value.is_callers_fault


def test_an_error_page_of_something_else_is_shown_as_text() -> None:
    client = _client(lambda _: httpx.Response(502, text="<h1>Bad Gateway</h1>"))
    with pytest.raises(ServerProblemError, match="Bad Gateway"):
        client.run("r1")


def test_an_answer_of_another_kind_is_named_by_its_first_fault() -> None:
    client = _client(lambda _: httpx.Response(200, json={**RUN, "variant_count": "many"}))
    with pytest.raises(ServerProblemError, match="variant_count"):
        client.run("r1")


def test_no_server_is_explained_with_what_to_do() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("Connection refused", request=request)

    with pytest.raises(ServerUnavailableError, match=r"no server answers at http://127\.0\.0\.1:8700.*valerie up"):
        _client(answer).run("r1")


def test_a_report_is_bytes() -> None:
    assert _client(lambda _: httpx.Response(200, content=b"<html>")).report("r1") == b"<html>"


def test_progress_is_read_with_all_its_stages() -> None:
    stage = {"done": 1, "total": 2, "failed": 0, "running": 1, "rate_per_s": 0.5, "eta_s": None}
    document = {"state": "running", "variants": {"total": 3, "fed": 2, "rejected": 0}, "stages": {"render": stage}}
    client = _client(lambda _: httpx.Response(200, text=json.dumps(document)))
    assert client.progress("r1").stages["render"].total == 2
