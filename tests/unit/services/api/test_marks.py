"""Tags and notes on runs, frames and findings."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from tests.world.drawn import DrawnRuns


def put(client: httpx.Client, run: str, **mark: Any) -> httpx.Response:
    return client.put(f"/v1/runs/{run}/marks", json=mark)


def sentence_of(client: httpx.Client, run: str) -> str:
    findings = client.get(f"/v1/runs/{run}/summary").json()["findings"]
    return str((findings["items"] + findings["candidates"])[0]["sentence"])


def test_marks_of_a_run_a_frame_and_a_finding_are_kept_apart(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    run = drawn.finished
    put(fresh, run, tags=["night", "for Anna", "night"], note="all of it")
    put(fresh, run, kind="frame", name="0.1.0", note="odd shadow")
    put(fresh, run, kind="finding", name=sentence_of(fresh, run), tags=["known"])
    marks = {mark["kind"]: (mark["tags"], mark["note"]) for mark in fresh.get(f"/v1/runs/{run}/marks").json()}
    assert marks == {
        "run": (["for Anna", "night"], "all of it"),
        "frame": ([], "odd shadow"),
        "finding": (["known"], ""),
    }


def test_runs_are_listed_by_tag(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    put(fresh, drawn.finished, tags=["night"])
    put(fresh, drawn.failed, tags=["night", "rain"])
    put(fresh, drawn.running, kind="frame", name="0.0.0", tags=["night"])
    items = fresh.get("/v1/runs", params={"tag": "night"}).json()["items"]
    assert [(run["id"], run["tags"]) for run in items] == [
        (drawn.failed, ["night", "rain"]),
        (drawn.finished, ["night"]),
    ]
    assert fresh.get("/v1/tags").json() == {"night": 2, "rain": 1}
    assert fresh.get(f"/v1/runs/{drawn.failed}").json()["tags"] == ["night", "rain"]


def test_an_empty_mark_removes_it(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    put(fresh, drawn.finished, tags=["night"], note="x")
    assert put(fresh, drawn.finished).json() == []
    assert fresh.get("/v1/tags").json() == {}


def test_marks_stay_while_a_run_is_cancelled_and_go_when_it_is_deleted(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    put(fresh, drawn.running, tags=["mine"], note="n")
    fresh.post(f"/v1/runs/{drawn.running}/cancel")
    assert [mark["tags"] for mark in fresh.get(f"/v1/runs/{drawn.running}/marks").json()] == [["mine"]]
    assert fresh.delete(f"/v1/runs/{drawn.running}").status_code == 204
    assert fresh.get(f"/v1/runs/{drawn.running}/marks").status_code == 404
    assert fresh.get("/v1/tags").json() == {}


def test_a_mark_changes_no_digest(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    before = fresh.get(f"/v1/runs/{drawn.finished}").json()
    put(fresh, drawn.finished, tags=["night"], note="n")
    after = fresh.get(f"/v1/runs/{drawn.finished}").json()
    assert after == before | {"tags": ["night"]}


@pytest.mark.parametrize(
    ("mark", "status"),
    [
        ({"kind": "frame", "name": "999.0.0"}, 404),
        ({"kind": "frame", "name": "x"}, 422),
        ({"kind": "finding", "name": "The moon is made of cheese."}, 404),
        ({"kind": "run", "name": "0.0.0"}, 422),
        ({"tags": ["<b>"]}, 422),
        ({"tags": ["t"] * 21}, 422),
        ({"note": "n" * 10_001}, 422),
        ({"note": "a\0b"}, 422),
        ({"kind": "planet"}, 422),
    ],
)
def test_marks_of_nothing_and_odd_tags_are_refused(
    fresh: httpx.Client, drawn: DrawnRuns, mark: dict[str, Any], status: int
) -> None:
    assert put(fresh, drawn.finished, **{"note": "n", **mark}).status_code == status
    assert fresh.get(f"/v1/runs/{drawn.finished}/marks").json() == []


def test_a_run_that_does_not_exist_has_no_marks(fresh: httpx.Client) -> None:
    for kind, name in (("run", ""), ("frame", "0.0.0"), ("finding", "x")):
        assert put(fresh, "r1nothing", kind=kind, name=name, note="n").status_code == 404
