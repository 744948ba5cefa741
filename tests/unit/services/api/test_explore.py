"""The endpoints of the page Explore over a finished run, and saved selections."""

from __future__ import annotations

import io
from typing import Any
from zipfile import ZipFile

import httpx
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.world.drawn import CHARACTERS, FUNCTIONS, DrawnRuns
from valerie.labels import VOID, to_train_ids
from valerie.pipeline.export import archive
from valerie.runs.resolving.spec import parse


def test_columns_are_those_with_a_value_and_what_the_run_varied(api: httpx.Client, drawn: DrawnRuns) -> None:
    answer = api.get("/v1/explore/columns", params={"run": drawn.finished}).json()
    columns = {column["name"]: column for column in answer["columns"]}
    assert answer["functions"] == {drawn.finished: list(FUNCTIONS)}
    assert columns["scene.person-1.pos.y"]["group"] == "varied"
    assert (columns["scene.person-1.pos.y"]["low"], columns["scene.person-1.pos.y"]["high"]) == (5.0, 35.0)
    assert set(columns["character"]["names"]) <= set(CHARACTERS)
    assert "irradiance" not in columns, "the run did not ask for light"


@pytest.mark.parametrize("path", ["histograms", "links", "rates", "rows", "scatter", "swings", "spec", "confusion"])
def test_every_question_takes_an_expression_and_names_what_is_wrong_with_it(
    api: httpx.Client, drawn: DrawnRuns, path: str
) -> None:
    common: dict[str, Any] = {"run": drawn.finished}
    if path in ("histograms", "links"):
        common["column"] = ["distance_m", "pacc"]
    if path == "confusion":
        common["function"] = FUNCTIONS[0]
    assert api.get(f"/v1/explore/{path}", params={**common, "where": "distance_m > 0"}).status_code == 200
    for wrong in ("nope > 1", "distance_m == 'far'"):
        refused = api.get(f"/v1/explore/{path}", params={**common, "where": wrong})
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["field"] == "where"
        assert wrong.split()[0] in refused.json()["detail"]


def test_selected_rows_are_exported_as_they_are_listed(api: httpx.Client, drawn: DrawnRuns) -> None:
    query = {"run": drawn.finished, "where": f"function == '{FUNCTIONS[0]}' and camera == 'camera-1'"}
    listed = api.get("/v1/explore/rows", params={**query, "limit": 1000}).json()
    assert 0 < len(listed["items"]) == listed["selected"]
    parquet = pa.parquet.read_table(
        io.BytesIO(api.get("/v1/explore/rows", params={**query, "format": "parquet"}).content)
    )
    assert parquet["frame_id"].to_pylist() == [row["frame_id"] for row in listed["items"]]
    arrow = pa.ipc.open_stream(api.get("/v1/explore/rows", params={**query, "format": "arrow"}).content).read_all()
    assert arrow.num_rows == listed["selected"]
    csv = api.get("/v1/explore/rows", params={**query, "format": "csv"}).text.splitlines()
    assert len(csv) == listed["selected"] + 1


def test_a_confusion_matrix_counts_the_pixels_of_the_selected_frames_and_names_those_of_a_cell(
    api: httpx.Client, drawn: DrawnRuns
) -> None:
    query = {"run": drawn.finished, "where": "camera == 'camera-1' and distance_m < 40", "function": FUNCTIONS[1]}
    answer = api.get("/v1/explore/confusion", params={**query, "truth": "person", "predicted": "building"}).json()
    listing = {"run": drawn.finished, "where": query["where"], "limit": 1000}
    rows = api.get("/v1/explore/rows", params=listing).json()["items"]
    frames = sorted({row["frame_id"] for row in rows if row["function"] == FUNCTIONS[1]})
    expected, of_cell = np.zeros((19, 20), np.int64), {}
    for frame in frames:

        def labels(frame: str = frame, **more: str) -> NDArray[np.uint8]:
            png = api.get(f"/v1/frames/{frame}/labels", params=more).content
            return to_train_ids(np.array(Image.open(io.BytesIO(png))))

        truth, predicted = labels(), labels(function=FUNCTIONS[1])
        judged = truth != VOID
        column = np.where(predicted[judged] == VOID, 19, predicted[judged])
        counts = np.zeros((19, 20), np.int64)
        np.add.at(counts, (truth[judged], column), 1)
        expected += counts
        of_cell[frame] = int(counts[11, 2])  # person and building
    matrix = answer["confusion"]
    assert matrix["evaluations"] == len(frames) > 3
    np.testing.assert_array_equal(matrix["counts"], expected)
    listed = [(answer["rows"][str(frame["row"])]["frame_id"], frame["pixels"]) for frame in matrix["frames"]]
    assert dict(listed) == {frame: pixels for frame, pixels in of_cell.items() if pixels}
    assert [pixels for _, pixels in listed] == sorted((pixels for _, pixels in listed), reverse=True)
    for wrong in ({"truth": "person"}, {"truth": "persn", "predicted": "void"}, {"function": "nobody"}):
        refused = api.get("/v1/explore/confusion", params={**query, **wrong})
        assert refused.status_code == 422
    assert (
        "did you mean person"
        in api.get("/v1/explore/confusion", params={**query, "truth": "persn", "predicted": "void"}).text
    )


def test_a_sheet_holds_a_thumbnail_for_each_tile(api: httpx.Client, drawn: DrawnRuns) -> None:
    rows = api.get("/v1/explore/rows", params={"run": drawn.finished, "limit": 10}).json()["items"]
    tiles = [f"{row['frame_id']}:{row['instance_id'] or 0}:{row['function']}:{row['sensor']}" for row in rows]
    query: dict[str, Any] = {"tile": [*tiles, f"{drawn.finished}.99999.0.0:0:{FUNCTIONS[0]}:default"], "width": 64}
    whole = Image.open(io.BytesIO(api.get("/v1/explore/sheet", params=query).content))
    assert whole.size == (8 * 64, 2 * 36)
    cropped = Image.open(
        io.BytesIO(api.get("/v1/explore/sheet", params={**query, "crop": True, "kind": "errors"}).content)
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
    assert child.name == "finished refined"
    assert (varied["scene.person-1.pos.y"].minimum, varied["scene.person-1.pos.y"].maximum) == (15.0, 35.0)
    assert child.constants["scene.person-1.character"] == CHARACTERS[0]
    draft = api.post("/v1/draft", json={"text": answer["yaml"]}).json()
    assert not draft["several_blocks"], "a form shows it"
    assert api.post("/v1/plan", content=answer["yaml"], headers={"Content-Type": "application/yaml"}).status_code == 200


def test_a_selection_is_compared_with_another_that_may_overlap_it(api: httpx.Client, drawn: DrawnRuns) -> None:
    asked = {"run": drawn.finished, "where": "distance_m > 20"}
    alone = api.get("/v1/explore/rates", params={"run": drawn.finished, "where": "distance_m > 10"}).json()
    both = api.get("/v1/explore/rates", params={**asked, "beside": "distance_m > 10"}).json()
    assert [one["beside"] for one in both["groups"]] == [one["selected"] for one in alone["groups"]]
    refused = api.get("/v1/explore/rates", params={**asked, "beside": "nope > 1"})
    assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "beside")


def test_two_runs_are_explored_together_and_matched(api: httpx.Client, drawn: DrawnRuns) -> None:
    sides = {"before": f"{drawn.finished}:{FUNCTIONS[0]}", "after": f"{drawn.failed}:{FUNCTIONS[0]}"}
    query: dict[str, Any] = {"run": [drawn.finished, drawn.failed]}
    answer = api.get("/v1/explore/comparison", params={**query, **sides, "outcome": "both found"}).json()
    comparison = answer["comparison"]
    assert 0 < comparison["matched"] <= min(comparison["rows"])
    exclusive = ("fixed", "broken", "both missed", "both found")
    assert sum(comparison["outcomes"][name] for name in exclusive) == comparison["matched"]
    for pair in comparison["pairs"]:
        a, b = (answer["rows"][str(pair[side])] for side in ("before", "after"))
        assert (a["run_id"], b["run_id"]) == (drawn.finished, drawn.failed)
        assert a["frame_id"].split(".")[1:] == b["frame_id"].split(".")[1:]
    pooled = dict.fromkeys(("tp", "fn", "fp"), 0)
    for outcome in exclusive:
        found = api.get("/v1/explore/comparison", params={**query, **sides, "outcome": outcome, "limit": 200}).json()
        for pair in found["comparison"]["pairs"]:  # one person in each frame
            for name in pooled:
                pooled[name] += found["rows"][str(pair["after"])][name]
    found = pooled["tp"]
    assert comparison["precision"][1] == pytest.approx(found / (found + pooled["fp"]))
    assert comparison["iou"][1] == pytest.approx(found / sum(pooled.values()))
    refused = api.get("/v1/explore/comparison", params={**query, **sides, "after": "x:y"})
    assert refused.json()["errors"][0]["field"] == "after"
    refused = api.get("/v1/explore/comparison", params={**query, **sides, "across": "nope"})
    assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "across")


def test_a_comparison_of_two_runs_names_what_their_specs_set_differently(api: httpx.Client, drawn: DrawnRuns) -> None:
    sides = {"before": f"{drawn.finished}:{FUNCTIONS[0]}", "after": f"{drawn.failed}:{FUNCTIONS[0]}"}
    answer = api.get("/v1/explore/comparison", params={"run": [drawn.finished, drawn.failed], **sides}).json()
    assert answer["comparison"]["matched"] > 0
    (sentence,) = answer["differs"]
    assert "sun-1.elevation" in sentence
    assert "12" in sentence
    assert "not set before" in sentence
    own = {"before": sides["before"], "after": f"{drawn.finished}:{FUNCTIONS[1]}"}
    assert api.get("/v1/explore/comparison", params={"run": drawn.finished, **own}).json()["differs"] == []


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


def test_more_like_these_moves_selected_variants_by_half_a_step_and_mixes_none(
    api: httpx.Client, drawn: DrawnRuns
) -> None:
    # Two corners of the grid of 3.5 m across and 10 m along: no variant may lie between them.
    where = "(person-1.pos.x == -1 and person-1.pos.y == 5) or (person-1.pos.x == 2.5 and person-1.pos.y == 35)"
    query: dict[str, Any] = {"run": drawn.finished, "where": where, "form": "nearby", "count": 40}
    child = parse(api.get("/v1/explore/spec", params=query).json()["yaml"])
    (block,) = child.blocks
    assert (block.design, len(block.points), child.parent_run) == ("points", 40, drawn.finished)
    corners = {(-1.0, 5.0): 0, (2.5, 35.0): 0}
    for point in block.points:
        x, y = float(point["scene.person-1.pos.x"]), float(point["scene.person-1.pos.y"])
        (corner,) = [(a, b) for a, b in corners if abs(x - a) <= 1.75 and abs(y - b) <= 5]
        corners[corner] += 1
        assert point["scene.person-1.character"] in CHARACTERS
        assert x >= -1
        assert 5 <= y <= 35
    assert min(corners.values()) > 0
    assert len({str(point) for point in block.points}) == 40
    nobody = api.get("/v1/explore/spec", params={**query, "where": "pacc > 2"})
    assert nobody.status_code == 422


@pytest.mark.parametrize(("form", "labels"), [("cityscapes", "labelIds.png"), ("coco", "instances_val.json")])
def test_the_frames_of_a_selection_come_as_one_zip_archive(
    api: httpx.Client, drawn: DrawnRuns, form: str, labels: str
) -> None:
    where = "camera == 'camera-1' and person-1.pos.y == 5"
    rows = api.get("/v1/explore/rows", params={"run": drawn.finished, "where": where, "limit": 100}).json()["items"]
    frames = {row["frame_id"] for row in rows}
    answer = api.get("/v1/explore/frames", params={"run": drawn.finished, "where": where, "format": form})
    assert answer.headers["content-type"] == "application/zip"
    with ZipFile(io.BytesIO(answer.content)) as files:
        assert files.testzip() is None
        names = files.namelist()
        pictures = [name for name in names if "gtFine" not in name and "panoptic" not in name and name.endswith(".png")]
        assert len(pictures) == len(frames) > 1
        assert any(name.endswith(labels) for name in names)
        shown = {np.array(Image.open(files.open(name))).tobytes() for name in pictures}
    served = (api.get(f"/v1/frames/{frame}/image").content for frame in frames)
    assert shown == {np.array(Image.open(io.BytesIO(one))).tobytes() for one in served}
    for wrong in ({"where": "pacc > 2"}, {"format": "zip"}, {"run": [drawn.finished, drawn.failed]}):
        assert api.get("/v1/explore/frames", params={"run": drawn.finished, **wrong}).status_code == 422


def test_a_download_of_too_many_frames_names_the_command_without_a_limit(
    api: httpx.Client, drawn: DrawnRuns, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "MAX_FRAMES", 3)
    answer = api.get("/v1/explore/frames", params={"run": drawn.finished})
    assert answer.status_code == 422
    assert "valerie dataset export" in answer.json()["detail"]
