"""The endpoints of the page Explore over a finished run, and saved selections."""

from __future__ import annotations

import io
from typing import Any

import httpx
import pyarrow as pa
import pyarrow.parquet
import pytest
from PIL import Image

from tests.world.drawn import CHARACTERS, FUNCTIONS, DrawnRuns
from valerie.runs.resolving.spec import parse


def test_columns_are_those_with_a_value_and_what_the_run_varied(api: httpx.Client, drawn: DrawnRuns) -> None:
    answer = api.get("/v1/explore/columns", params={"run": drawn.finished}).json()
    columns = {column["name"]: column for column in answer["columns"]}
    assert answer["functions"] == {drawn.finished: list(FUNCTIONS)}
    assert columns["scene.person-1.pos.y"]["group"] == "varied"
    assert (columns["scene.person-1.pos.y"]["low"], columns["scene.person-1.pos.y"]["high"]) == (5.0, 35.0)
    assert set(columns["character"]["names"]) <= set(CHARACTERS)
    assert "irradiance" not in columns, "the run did not ask for light"


@pytest.mark.parametrize("path", ["histograms", "links", "rates", "rows", "scatter", "swings", "spec"])
def test_every_question_takes_an_expression_and_names_what_is_wrong_with_it(
    api: httpx.Client, drawn: DrawnRuns, path: str
) -> None:
    common: dict[str, Any] = {"run": drawn.finished}
    if path in ("histograms", "links"):
        common["column"] = ["distance_m", "pacc"]
    assert api.get(f"/v1/explore/{path}", params={**common, "where": "distance_m > 0"}).status_code == 200
    for wrong in ("nope > 1", "distance_m == 'far'"):
        refused = api.get(f"/v1/explore/{path}", params={**common, "where": wrong})
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["field"] == "where"
        assert wrong.split()[0] in refused.json()["detail"]


def test_selected_rows_are_exported_as_they_are_listed(api: httpx.Client, drawn: DrawnRuns) -> None:
    asked = {"run": drawn.finished, "where": f"function == '{FUNCTIONS[0]}' and camera == 'camera-1'"}
    listed = api.get("/v1/explore/rows", params={**asked, "limit": 1000}).json()
    assert 0 < len(listed["items"]) == listed["selected"]
    parquet = pa.parquet.read_table(
        io.BytesIO(api.get("/v1/explore/rows", params={**asked, "format": "parquet"}).content)
    )
    assert parquet["frame_id"].to_pylist() == [row["frame_id"] for row in listed["items"]]
    arrow = pa.ipc.open_stream(api.get("/v1/explore/rows", params={**asked, "format": "arrow"}).content).read_all()
    assert arrow.num_rows == listed["selected"]
    csv = api.get("/v1/explore/rows", params={**asked, "format": "csv"}).text.splitlines()
    assert len(csv) == listed["selected"] + 1


def test_a_sheet_holds_a_thumbnail_for_each_tile(api: httpx.Client, drawn: DrawnRuns) -> None:
    rows = api.get("/v1/explore/rows", params={"run": drawn.finished, "limit": 10}).json()["items"]
    tiles = [f"{row['frame_id']}:{row['instance_id'] or 0}:{row['function']}:{row['sensor']}" for row in rows]
    asked: dict[str, Any] = {"tile": [*tiles, f"{drawn.finished}.99999.0.0:0:{FUNCTIONS[0]}:default"], "width": 64}
    whole = Image.open(io.BytesIO(api.get("/v1/explore/sheet", params=asked).content))
    assert whole.size == (8 * 64, 2 * 36)
    cropped = Image.open(
        io.BytesIO(api.get("/v1/explore/sheet", params={**asked, "crop": True, "kind": "errors"}).content)
    )
    assert cropped.size == (8 * 64, 2 * 64)
    missing = cropped.crop((2 * 64 + 8, 64 + 8, 3 * 64 - 8, 128 - 8)).convert("L").getextrema()
    assert max(missing) - min(missing) < 8, "a frame that does not exist is grey"
    assert api.get("/v1/explore/sheet", params={"tile": "x"}).status_code == 422


def test_a_selection_becomes_the_spec_of_a_run_that_looks_closer(api: httpx.Client, drawn: DrawnRuns) -> None:
    where = f"person-1.pos.y >= 15 and character == '{CHARACTERS[0]}'"
    answer = api.get("/v1/explore/spec", params={"run": drawn.finished, "where": where, "count": 7}).json()
    child = parse(answer["yaml"])
    (block,) = child.blocks
    varied = {one.parameter: one for one in block.vary}
    assert (child.parent_run, child.iteration, block.count) == (drawn.finished, 1, 7)
    assert (varied["scene.person-1.pos.y"].minimum, varied["scene.person-1.pos.y"].maximum) == (15.0, 35.0)
    assert block.constants["scene.person-1.character"] == CHARACTERS[0]
    assert api.post("/v1/plan", content=answer["yaml"], headers={"Content-Type": "application/yaml"}).status_code == 200


def test_two_runs_are_explored_together_and_matched(api: httpx.Client, drawn: DrawnRuns) -> None:
    sides = {"before": f"{drawn.finished}:{FUNCTIONS[0]}", "after": f"{drawn.failed}:{FUNCTIONS[0]}"}
    asked: dict[str, Any] = {"run": [drawn.finished, drawn.failed]}
    answer = api.get("/v1/explore/comparison", params={**asked, **sides, "outcome": "both found"}).json()
    one = answer["comparison"]
    assert 0 < one["matched"] <= min(one["rows"])
    assert sum(one["outcomes"].values()) == one["matched"]
    for pair in one["pairs"]:
        a, b = (answer["rows"][str(pair[side])] for side in ("before", "after"))
        assert (a["run_id"], b["run_id"]) == (drawn.finished, drawn.failed)
        assert a["frame_id"].split(".")[1:] == b["frame_id"].split(".")[1:]
    refused = api.get("/v1/explore/comparison", params={**asked, **sides, "after": "x:y"})
    assert refused.json()["errors"][0]["field"] == "after"


def test_a_selection_is_saved_listed_and_deleted(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    new = {"name": "dark and far", "runs": [drawn.finished], "expression": "distance_m > 25", "view": "x=distance_m"}
    assert fresh.post("/v1/selections", json=new).status_code == 201
    assert fresh.post("/v1/selections", json=new).status_code == 409
    assert fresh.post("/v1/selections", json={**new, "name": "of nobody", "runs": ["nope"]}).status_code == 404
    (saved,) = fresh.get("/v1/selections").json()
    assert {key: saved[key] for key in new} == new
    assert fresh.delete("/v1/selections/dark and far").status_code == 204
    assert fresh.delete("/v1/selections/dark and far").status_code == 404


@pytest.mark.parametrize("path", ["columns", "histograms", "links", "rates", "rows", "scatter", "swings", "spec"])
def test_what_cannot_be_the_id_of_a_run_is_refused_before_the_database_is_asked(api: httpx.Client, path: str) -> None:
    columns = {"column": "pacc"} if path in ("histograms", "links") else {}
    for wrong in ("\0", "a/b", "", "r" * 33):
        refused = api.get(f"/v1/explore/{path}", params={"run": wrong, **columns})
        assert refused.status_code == 422
        assert {problem["field"] for problem in refused.json()["errors"]} == {"run.0"}


def test_a_selection_with_text_that_no_database_holds_is_refused(api: httpx.Client) -> None:
    new: dict[str, Any] = {"name": "dark", "runs": ["r1"], "expression": "", "view": ""}
    for field, wrong, named in (("runs", ["\0"], "runs.0"), ("expression", "\0", "expression"), ("view", "\0", "view")):
        refused = api.post("/v1/selections", json={**new, field: wrong})
        assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, named)
    assert api.delete("/v1/selections/%00").status_code == 422


@pytest.mark.parametrize("body", [b"{", b"\xff", b"[" * 100_000], ids=["cut off", "not UTF-8", "nested too deeply"])
def test_a_selection_that_is_not_json_is_refused(api: httpx.Client, body: bytes) -> None:
    refused = api.post("/v1/selections", content=body, headers={"Content-Type": "application/json"})
    assert (refused.status_code, len(refused.json()["errors"])) == (422, 1)


def test_the_page_has_an_address_of_its_own(api: httpx.Client) -> None:
    answer = api.get("/explore?runs=a,b&where=pacc%20%3C%200.5", follow_redirects=False)
    assert answer.headers["location"] == "/dashboard/#/explore?runs=a,b&where=pacc%20%3C%200.5"
