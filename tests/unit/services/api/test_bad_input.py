"""Bad input is a problem document that names field, value and limit; nothing is stored."""

from __future__ import annotations

import base64
import json
from typing import Any

import httpx
import pytest

from tests.world.drawn import DrawnRuns, spec

X, Y = "person-1.pos.x", "person-1.pos.y"


def problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["Content-Type"] == "application/problem+json"
    document: dict[str, Any] = answer.json()
    assert document["status"] == status
    assert document["type"] == "about:blank"
    assert document["title"]
    assert document["detail"]
    return document


@pytest.mark.parametrize(
    ("changes", "field", "said"),
    [
        ({"asset": "drawn-stret"}, "asset", "did you mean drawn-street"),
        ({"renderer": "rastr"}, "renderer", "did you mean raster"),
        ({"renderer": "blender"}, "renderer", "did you mean cycles?"),
        ({"functions": ["net.onnx"]}, "functions.0", "`valerie function import FILE`"),
        (
            {"vary": [["focal_length_mm", "UNIFORM", 20, 30]]},
            "vary.0",
            "did you mean camera-1.focal_length_mm, camera-2",
        ),
        ({"varry": []}, "varry", "did you mean vary"),
        (
            {"resolution": "960x540"},
            "resolution",
            "a mapping is needed here; got 960x540; limit: {width: 960, height: 540}",
        ),
        ({"functions": ["semantic-fpn"]}, "functions.0", "did you mean semantic-fpn-small"),
        ({"cameras": ["camera-9"]}, "cameras.0", "camera-1"),
        ({"vary": [["person-1.pos.z", "UNIFORM"]]}, "vary.0", "person-1.pos"),
        ({"vary": [[X, "HOMOGENEOUS", 5.0, 1.0, 1.0]]}, "vary.0", "minimum"),
        ({"vary": [[X, "HOMOGENEOUS", 1.0, 5.0, 0]]}, "vary.0", "step"),
        ({"vary": [[X, "HOMOGENEOUS", 1.0, 5.0, -1]]}, "vary.0", "step"),
        ({"vary": [[X, "HOMOGENEOUS", 0, 5.0, 1e-9]]}, "vary", "1,000,000"),
        ({"vary": [[X, "HOMOGENEOUS", -1000, 5.0, 1.0]]}, "vary.0", "-10"),
        ({"vary": [[X, "HOMOGENEOUS", "a", 5.0, 1.0]]}, "vary.0", "a"),
        ({"vary": [[X, "HOMOGENEOUS", 1, 2, 1], [X, "HOMOGENEOUS", 1, 2, 1]]}, "vary.1", "twice"),
        ({"functions": ["semantic-fpn-small", "semantic-fpn-small"]}, "functions.1", "twice"),
        ({"seed": -1}, "seed", "0"),
        ({"seed": "one"}, "seed", "whole number"),
        ({"nmae": "x"}, "nmae", "did you mean name"),
        ({"renderer": {"name": "cycles", "quality": "drft"}}, "renderer.quality", "did you mean draft"),
        ({"sensors": [{"name": "a", "curve": "filmc"}]}, "sensors.0.curve", "did you mean filmic"),
        ({"constraints": ["import os"]}, "constraints.0", "< <= > >= == !="),
        ({"parameters": {"p": {"path": X, "type": "FLOT"}}}, "parameters.p.type", "did you mean FLOAT"),
        ({"parameters": {"p": {"path": X, "type": "FLOAT", "from": 9, "to": 1}}}, "parameters.p.from", "minimum"),
        ({"vary": {X: {"homogeneous": {"from": -99, "to": 1, "step": 1}}}}, f"vary.{X}.from", "-15"),
        ({"resolution": {"width": 100_000, "height": 10}}, "resolution", "8192"),
        ({"detection_threshold": 0}, "detection_threshold", "0"),
        ({"parent_run": "r0"}, None, "parent run"),
    ],
)
def test_a_wrong_spec_is_refused_naming_the_field(
    api: httpx.Client, changes: dict[str, Any], field: str | None, said: str
) -> None:
    before = api.get("/v1/runs").json()
    answer = api.post("/v1/runs", json=spec("bad", **changes))
    document = problem(answer, 422 if field else 404)
    if field is not None:
        assert any(error["field"].startswith(field) for error in document["errors"]), document["errors"]
    assert said in document["detail"]
    assert api.get("/v1/runs").json() == before


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "1" * 400])
def test_nan_and_infinity_are_refused(api: httpx.Client, number: str) -> None:
    text = f'{{"name": "n", "asset": "drawn-street", "vary": [["{X}", "HOMOGENEOUS", {number}, 5.0, 1.0]]}}'
    document = problem(api.post("/v1/runs", content=text), 422)
    assert any(error["field"].startswith("vary.0") for error in document["errors"])


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b"", "empty"),
        (b"[1, 2]", "mapping"),
        (b"\xff\xfe\x00bad", "UTF-8"),
        (b"name: \xc3\x28", "UTF-8"),
        (b"[" * 100_000, "nested"),
        (b'{"a":' * 5_000 + b"1" + b"}" * 5_000, "nested"),
        (b"- " * 5_000, "nested"),
        (b"a: &x [1]\nb: *x", "alias"),
        (b"!!python/object/apply:os.system ['true']", "tags"),
        (b"name: a\nname: b", "twice"),
        (b"name: [unclosed", "not YAML or JSON"),
        (b'{"name": "\\ud800", "asset": "drawn-street"}', "unicode"),
        (b'{"name": "a\\u0000b", "asset": "drawn-street"}', "null"),
        (b" " * 1_500_000, "1048576 bytes"),
    ],
)
def test_a_body_that_is_no_document_is_refused(api: httpx.Client, body: bytes, said: str) -> None:
    for path in ("/v1/runs", "/v1/plan"):
        assert said in problem(api.post(path, content=body), 422)["detail"]


def test_several_mistakes_are_reported_at_once(api: httpx.Client) -> None:
    document = problem(api.post("/v1/runs", json=spec("bad", seed=-1, detection_threshold=7)), 422)
    assert {error["field"] for error in document["errors"]} >= {"seed", "detection_threshold"}


def test_a_mapping_shows_value_and_limit(api: httpx.Client) -> None:
    error = problem(api.post("/v1/runs", json=spec("bad", seed=-1)), 422)["errors"][0]
    assert (error["field"], error["value"], error["limit"]) == ("seed", -1, ">= 0")


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/v1/runs/nope", 404),
        ("/v1/runs/..%2Fsecret", 404),
        ("/v1/runs/-x", 422),
        ("/v1/frames/nope", 422),
        ("/v1/frames/nope.0.0.0", 404),
        ("/v1/frames/RUN.999.0.0", 404),
        ("/v1/frames/RUN.0.9.0", 404),
        ("/v1/frames/RUN.999999999999999999.0.0", 404),
        ("/v1/frames/RUN.0.9.0/image", 404),
        ("/v1/artifacts/truth/" + "0" * 32, 404),
        ("/v1/artifacts/truth/xyz", 422),
        ("/v1/artifacts/secrets/" + "0" * 32, 422),
        ("/v1/assets/nope", 404),
        ("/v1/assets/..", 404),
        ("/v1/nothing", 404),
    ],
)
def test_malformed_and_missing_addresses_differ_in_status(
    api: httpx.Client, drawn: DrawnRuns, path: str, status: int
) -> None:
    problem(api.get(path.replace("RUN", drawn.finished)), status)


@pytest.mark.parametrize(
    ("query", "field", "said"),
    [
        ("limit=0", "limit", ">= 1"),
        ("limit=1001", "limit", "<= 1000"),
        ("limit=ten", "limit", "integer"),
        ("sort=distanz_m", "sort", "did you mean distance_m"),
        ("filter=distance_m:gt:far", "filter.distance_m", "far"),
        ("filter=distance_m:gt:nan", "filter.distance_m", "finite"),
        ("filter=distance_m:gt:1e999", "filter.distance_m", "finite"),
        ("filter=distans:gt:1", "filter", "distance_m"),
        ("filter=nonsense", "filter.0", "pattern"),
        ("filter=function:eq:semantic", "filter.function", "semantic-fpn-small"),
        ("filter=camera:lt:camera-1", "filter.camera", "eq or ne"),
        ("filter=undefined_reason:eq:%00", "filter.0", "pattern"),
        ("filter=pacc:null:maybe", "filter.pacc", "true or false"),
        ("format=xlsx", "format", "parquet"),
        ("cursor=!!!", "cursor", "not a cursor"),
        ("cursor=WzFd", "cursor", "not a cursor"),
        ("cursor=Wy0xXQ", "cursor", "not a cursor"),
        ("format=csv&filter=pacc:gt:0", "filter", "whole table"),
    ],
)
def test_wrong_queries_of_results_are_refused(
    api: httpx.Client, drawn: DrawnRuns, query: str, field: str, said: str
) -> None:
    document = problem(api.get(f"/v1/runs/{drawn.finished}/evaluations?{query}"), 422)
    assert document["errors"][0]["field"] == field
    assert said in str(document)


def test_a_cursor_of_another_list_or_out_of_bounds_is_refused(api: httpx.Client, drawn: DrawnRuns) -> None:
    run = f"/v1/runs/{drawn.finished}"
    for path, values in (
        ("/v1/runs", ("not a time", "r1")),
        ("/v1/runs", (5, 6)),
        (f"{run}/variants", (2**63,)),
        (f"{run}/variants", (True,)),
        (f"{run}/frames", (0, 0, -5)),
        (f"{run}/frames", (0, 0, 2**64)),
        (f"{run}/evaluations", ("text", 0, 0, 0, 0, 0, 0)),
        (f"{run}/evaluations", (1.0, 0, 0, 0, 0, 0, "x")),
    ):
        cursor = base64.urlsafe_b64encode(json.dumps(values).encode()).decode().rstrip("=")
        document = problem(api.get(path, params={"cursor": cursor}), 422)
        assert document["errors"][0]["field"] == "cursor"


@pytest.mark.parametrize(
    ("path", "field", "near", "allowed"),
    [
        ("/v1/runs?stat=failed", "stat", "did you mean state, tag?", "cursor, limit, state, tag"),
        ("/v1/runs/RUN/evaluations?filtre=pacc:gt:0", "filtre", "did you mean filter?", "cursor, filter, format, limit, sort"),
        ("/v1/runs/RUN?limit=3", "limit", "known: none", ""),
        ("/v1/frames/RUN.0.0.0/image?kind=truth&zoom=2", "zoom", "known: function, kind, sensor", "function, kind, sensor"),
        ("/v1/frames/RUN.0.0.0/image?Kind=truth", "Kind", "did you mean kind?", "function, kind, sensor"),
    ],
)  # fmt: skip
def test_an_unknown_query_parameter_is_refused_with_near_matches_and_the_allowed_ones(
    api: httpx.Client, drawn: DrawnRuns, path: str, field: str, near: str, allowed: str
) -> None:
    document = problem(api.get(path.replace("RUN", drawn.finished)), 422)
    assert near in document["detail"]
    assert [(error["field"], error["value"], error["limit"]) for error in document["errors"]] == [
        (field, field, allowed)
    ]


def test_an_unknown_query_parameter_of_a_change_is_refused_and_nothing_changes(
    api: httpx.Client, drawn: DrawnRuns
) -> None:
    before = api.get("/v1/runs").json()
    assert problem(api.post("/v1/runs?limit=1", json=spec("asked")), 422)["errors"][0]["field"] == "limit"
    assert problem(api.delete(f"/v1/runs/{drawn.finished}?force=1"), 422)["errors"][0]["field"] == "force"
    assert api.get("/v1/runs").json() == before


def test_pages_and_probes_take_any_query(api: httpx.Client) -> None:
    for path in ("/dashboard/", "/openapi.json", "/healthz", "/metrics"):
        assert api.get(path, params={"at": "now"}).status_code == 200, path


def test_a_method_that_is_not_allowed_is_refused_with_the_allowed_ones(api: httpx.Client) -> None:
    answer = api.put("/v1/runs")
    problem(answer, 405)
    assert "GET" in answer.headers["Allow"] or "POST" in answer.headers["Allow"]


@pytest.mark.parametrize("key", ["", "x" * 201])
def test_a_malformed_key_is_refused(api: httpx.Client, key: str) -> None:
    document = problem(api.post("/v1/runs", json=spec("k"), headers={"Idempotency-Key": key}), 422)
    assert document["errors"][0]["field"].lower() == "idempotency-key"
