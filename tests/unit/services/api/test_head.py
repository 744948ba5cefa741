"""HEAD gives the answer to GET without its body."""

from __future__ import annotations

import httpx
import pytest
from sketch.fixtures import Sketch

PATHS = [
    "/v1/runs",
    "/v1/runs/RUN/summary",
    "/v1/runs/RUN/report",
    "/v1/frames/RUN.0.0.0/image?kind=truth",
    "/v1/functions",
    "/healthz",
    "/openapi.json",
    "/dashboard/",
    "/",
]


@pytest.mark.parametrize("path", PATHS)
def test_head_has_status_and_headers_of_get_and_no_body(api: httpx.Client, sketch: Sketch, path: str) -> None:
    path = path.replace("RUN", sketch.finished)
    get, head = api.get(path), api.head(path)
    assert head.status_code == get.status_code < 400
    assert head.content == b""
    for name in ("Content-Length", "Content-Type", "ETag", "Location", "X-Content-Type-Options"):
        assert head.headers.get(name) == get.headers.get(name), name


def test_head_of_a_missing_address_is_404_without_a_body(api: httpx.Client) -> None:
    answer = api.head("/v1/runs/nope")
    assert (answer.status_code, answer.content) == (404, b"")
    assert answer.headers["Content-Type"] == "application/problem+json"


def test_head_where_there_is_no_get_is_refused(api: httpx.Client) -> None:
    assert api.head("/v1/plan").status_code == 405
