"""Functions under test over REST: registered once, read back, removed, refused with reasons; predictions uploaded."""

from __future__ import annotations

import http.client
import json
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from services.api.app import create_app
from tests.world.drawn import DrawnRuns, DrawnWorld
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.perception.running.label_png import encode_png
from valerie.perception.running.small_network import small_onnx

SIDE = "output: {classes: [road, person]}\nengine: onnxruntime\n"


@pytest.fixture(scope="module")
def onnx(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_onnx(tmp_path_factory.mktemp("onnx"))[1]


def post(client: httpx.Client, payload: Path | None = None, *, filename: str = "", **texts: str) -> httpx.Response:
    files: list[tuple[str, Any]] = [(name, (None, text)) for name, text in texts.items()]
    if payload is not None:
        files.append(("payload", (filename or payload.name, payload.read_bytes())))
    return client.post("/v1/functions", files=files)


def test_an_onnx_file_with_its_document_is_registered_once(fresh: httpx.Client, onnx: Path) -> None:
    first = post(fresh, onnx, document=SIDE)
    assert first.status_code == 201, first.text
    function = first.json()
    assert first.headers["Location"] == f"/v1/functions/{function['reference']}"
    assert function["classes"] == ["road", "person"]
    assert function["check"]["numeric_class"].startswith("onnxruntime-")
    again = post(fresh, onnx, document=SIDE)
    assert (again.status_code, again.json()["digest"]) == (200, function["digest"])
    listed = [one for one in fresh.get("/v1/functions").json() if one["name"] == "small"]
    assert [(function["version"], function["digest"]) for function in listed] == [(1, function["digest"])]


def test_a_version_is_read_by_name_or_digest_and_its_file_is_unchanged(fresh: httpx.Client, onnx: Path) -> None:
    version = post(fresh, onnx, document=SIDE, name="mine").json()
    two = post(fresh, onnx, document=SIDE + "provenance: {note: second}", name="mine").json()
    assert fresh.get("/v1/functions/mine").json()["digest"] == two["digest"]
    read = fresh.get(f"/v1/functions/mine@{version['digest'][:8]}").json()
    assert (read["digest"], read["version"]) == (version["digest"], 1)
    payload = fresh.get(f"/v1/functions/{version['reference']}/payload")
    assert payload.content == onnx.read_bytes()
    assert payload.headers["ETag"]


def test_a_version_is_removed_only_by_its_digest(fresh: httpx.Client, onnx: Path) -> None:
    reference = post(fresh, onnx, document=SIDE).json()["reference"]
    assert fresh.delete("/v1/functions/small").status_code == 422
    assert fresh.delete(f"/v1/functions/{reference}").status_code == 204
    assert fresh.get("/v1/functions/small").status_code == 404
    assert fresh.delete(f"/v1/functions/{reference}").status_code == 404


def test_a_version_that_a_waiting_run_would_take_cannot_be_removed(fresh: httpx.Client, onnx: Path) -> None:
    reference = post(fresh, onnx, document=SIDE).json()["reference"]
    spec = {"name": "r", "asset": "drawn-street", "vary": [["person-1.pos.x", "HOMOGENEOUS", 1.5, 5.5, 1.0]]}
    run = fresh.post("/v1/runs", json={**spec, "functions": ["small"]}).json()["id"]
    answer = fresh.delete(f"/v1/functions/{reference}")
    assert answer.status_code == 409
    assert run in answer.json()["detail"]


@pytest.mark.parametrize(
    ("filename", "texts", "detail"),
    [
        ("model.pt2", {}, "runs code when it is loaded and is not accepted; export the network as ONNX"),
        ("model.py", {}, "a Python program runs code"),
        ("model.xyz", {}, "not a known kind of file"),
        ("model.onnx", {"document": "output: {classes: [road, walrus]}", "name": "Bad Name"}, "name: "),
        ("model.onnx", {"document": "output: {classes: [road, person], class_map: {road: raod}}"}, "did you mean road"),
        ("model.onnx", {"document": "kind: http\noptions: {url: 'http://a:1/'}"}, "kind http takes no file"),
        ("model.onnx", {"document": "just text"}, "document"),
        ("model.onnx", {"nonsense": "x"}, "unknown part of the form"),
        ("../../escape.onnx", {"document": "output: {classes: [a, b]}"}, "no class leads to a Cityscapes class"),
    ],
)
def test_a_wrong_registration_is_refused_with_the_reason(
    fresh: httpx.Client, onnx: Path, filename: str, texts: dict[str, str], detail: str
) -> None:
    answer = post(fresh, onnx, filename=filename, **texts)
    assert answer.status_code == 422, answer.text
    assert detail in answer.json()["detail"]
    assert answer.headers["Content-Type"] == "application/problem+json"


def test_a_document_without_its_file_is_refused(fresh: httpx.Client) -> None:
    answer = post(fresh, None, document="name: a\nkind: onnx\noutput: {classes: [road, person]}")
    assert answer.status_code == 422


def test_a_body_that_is_no_form_is_refused(fresh: httpx.Client) -> None:
    assert fresh.post("/v1/functions", json={"name": "a"}).status_code == 422
    broken = fresh.post("/v1/functions", content=b"--x\r\n", headers={"Content-Type": "multipart/form-data"})
    assert broken.status_code == 422


@pytest.mark.parametrize("name", ["engine", "payload"])
def test_a_part_of_the_form_that_is_given_twice_is_refused(fresh: httpx.Client, onnx: Path, name: str) -> None:
    part = ("a.onnx", onnx.read_bytes()) if name == "payload" else (None, "torch")
    other = ("b.onnx", b"another file") if name == "payload" else (None, "openvino")
    answer = fresh.post("/v1/functions", files=[(name, part), (name, other)])
    assert answer.status_code == 422
    assert answer.json()["errors"][0] == {"field": name, "message": "given twice", "value": None, "limit": None}


def test_names_of_installed_functions_are_taken(fresh: httpx.Client, onnx: Path) -> None:
    assert post(fresh, onnx, document=SIDE, name="semantic-fpn-small").status_code == 409


def test_a_file_that_is_too_large_is_refused_before_it_is_read(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path, max_function_mb=1))
    world.context.engine.dispose()
    with served(create_app(world.settings, control=False)) as client:
        url = client.base_url
        connection = http.client.HTTPConnection(url.host, url.port, timeout=30)
        connection.putrequest("POST", "/v1/functions")
        connection.putheader("Content-Type", "multipart/form-data; boundary=x")
        connection.putheader("Content-Length", str(10 << 20))
        connection.endheaders()  # not one byte of the body is sent
        answer = connection.getresponse()
        assert answer.status == 413
        assert json.loads(answer.read())["errors"][0]["limit"] == (1 << 20) + 2_000_000
        connection.close()

        def pieces() -> Any:
            yield b"--x\r\nContent-Disposition: form-data; name=payload; filename=a.onnx\r\n\r\n"
            for _ in range(40):
                yield b"\0" * 100_000

        streamed = client.post(
            "/v1/functions", content=pieces(), headers={"Content-Type": "multipart/form-data; boundary=x"}
        )
        assert streamed.status_code == 413, "a stream that declares no length is cut off"


def test_predictions_are_uploaded_by_frame(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    """The finished run has no function of kind predictions, so the upload is refused."""
    frame = fresh.get(f"/v1/runs/{drawn.finished}/frames").json()["items"][0]["id"]
    data = encode_png(np.zeros((54, 96), np.uint8))
    answer = fresh.put(f"/v1/frames/{frame}/prediction", content=data, headers={"Content-Type": "image/png"})
    assert answer.status_code == 409
    assert "is not waiting for predictions" in answer.json()["detail"]
    assert fresh.put("/v1/frames/none.0.0.0/prediction", content=data).status_code == 404
