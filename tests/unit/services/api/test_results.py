"""The long table and the points through REST, compared with the table that the run stored."""

from __future__ import annotations

import csv
import io
from typing import Any

import httpx
import pyarrow.parquet as pq
import pytest

from tests.world.drawn import DrawnRuns
from tests.world.serving import every_item
from tests.world.world import settings_of
from valerie.pipeline.base.context import open_context
from valerie.storage.keys import run_key

Row = dict[str, Any]


@pytest.fixture(scope="module")
def table(drawn: DrawnRuns) -> list[Row]:
    """The long table as the evaluation worker wrote it when the run ended."""
    context = open_context(settings_of(drawn.folder))
    data = context.store.get(run_key(drawn.finished, "evaluations.parquet"))
    rows: list[Row] = pq.read_table(io.BytesIO(data)).to_pylist()
    return rows


def walk(client: httpx.Client, run: str, *, limit: int = 17, **parameters: Any) -> list[Row]:
    path = f"/v1/runs/{run}/evaluations"
    rows = every_item(client, path, limit=limit, **parameters)
    assert client.get(path, params={"limit": 1, **parameters}).json()["total"] == len(rows)
    return rows


def test_the_pages_are_the_stored_table(api: httpx.Client, drawn: DrawnRuns, table: list[Row]) -> None:
    assert walk(api, drawn.finished) == table


@pytest.mark.parametrize("column", ["pacc", "distance_m", "occlusion_rate", "iou", "undefined_reason", "pixel_area"])
@pytest.mark.parametrize("sign", ["", "-"])
def test_sorted_pages_neither_lose_nor_repeat_rows(
    api: httpx.Client, drawn: DrawnRuns, table: list[Row], column: str, sign: str
) -> None:
    rows = walk(api, drawn.finished, sort=sign + column, limit=7)
    values = [row[column] for row in rows if row[column] is not None]
    assert values == sorted(values, reverse=bool(sign))
    assert all(row[column] is None for row in rows[len(values) :]), "rows without a value come last"
    assert list(rows[0]) == list(table[0])
    assert sorted(map(repr, rows)) == sorted(map(repr, table))


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("distance_m:gt:30", lambda row: row["distance_m"] is not None and row["distance_m"] > 30),
        ("pacc:null:true", lambda row: row["pacc"] is None),
        ("pacc:null:false", lambda row: row["pacc"] is not None),
        ("pixel_area:le:2.5", lambda row: row["pixel_area"] is not None and row["pixel_area"] <= 2.5),
        ("pixel_area:lt:1e300", lambda row: row["pixel_area"] is not None),
        ("function:eq:semantic-fpn-small", lambda row: row["function"] == "semantic-fpn-small"),
        ("camera:ne:camera-2", lambda row: row["camera"] != "camera-2"),
        ("undefined_reason:eq:fully hidden", lambda row: row["undefined_reason"] == "fully hidden"),
    ],
)
def test_filters_keep_the_matching_rows(
    api: httpx.Client, drawn: DrawnRuns, table: list[Row], text: str, holds: Any
) -> None:
    expected = [row for row in table if holds(row)]
    assert walk(api, drawn.finished, filter=text) == expected


def test_filters_are_joined_by_and(api: httpx.Client, drawn: DrawnRuns, table: list[Row]) -> None:
    rows = walk(api, drawn.finished, filter=["distance_m:lt:40", "sensor:eq:default", "pacc:ge:0.5"])
    assert rows == [r for r in table if r["pacc"] is not None and r["pacc"] >= 0.5 and r["distance_m"] < 40]
    assert 0 < len(rows) < len(table)


def test_csv_and_parquet_hold_the_same_table(api: httpx.Client, drawn: DrawnRuns, table: list[Row]) -> None:
    path = f"/v1/runs/{drawn.finished}/evaluations"
    parquet = api.get(path, params={"format": "parquet"})
    assert parquet.headers["Content-Type"] == "application/vnd.apache.parquet"
    assert pq.read_table(io.BytesIO(parquet.content)).to_pylist() == table
    text = api.get(path, params={"format": "csv"})
    assert "attachment" in text.headers["Content-Disposition"]
    rows = list(csv.DictReader(io.StringIO(text.text)))
    assert [row["frame_id"] for row in rows] == [row["frame_id"] for row in table]
    for row, expected in zip(rows, table, strict=True):
        for name in ("pacc", "distance_m", "iou", "occlusion_rate"):
            assert (float(row[name]) if row[name] else None) == expected[name]


def test_a_running_run_gives_its_rows_so_far(api: httpx.Client, drawn: DrawnRuns) -> None:
    rows = walk(api, drawn.running)
    assert len(rows) == api.get(f"/v1/runs/{drawn.running}/progress").json()["stages"]["eval"]["done"] > 0


def test_points_are_the_defined_rows_of_the_table(api: httpx.Client, drawn: DrawnRuns, table: list[Row]) -> None:
    points = api.get(f"/v1/runs/{drawn.finished}/points", params={"column": "occlusion_rate"}).json()
    names = [points[name] for name in ("functions", "cameras", "characters")]
    drawn = {
        (points["variant"][i], *(names[k][points[code][i]] for k, code in enumerate(("function", "camera", "character"))),
         points["x"][i], points["pacc"][i])
        for i in range(len(points["x"]))
    }  # fmt: skip
    expected = {
        (r["variant_index"], r["function"], r["camera"], r["character"], r["occlusion_rate"], r["pacc"])
        for r in table
        if r["pacc"] is not None
    }
    assert drawn == expected
    assert points["share"] == 1.0
    assert sum(points["undefined"].values()) == sum(1 for row in table if row["pacc"] is None)


def test_points_over_a_varied_parameter_are_those_of_its_column(
    api: httpx.Client, drawn: DrawnRuns, table: list[Row]
) -> None:
    column = "scene.person-1.pos.y"
    points = api.get(f"/v1/runs/{drawn.finished}/points", params={"column": column}).json()
    drawn = {(points["variant"][i], x, points["pacc"][i]) for i, x in enumerate(points["x"])}
    assert drawn == {(r["variant_index"], r[column], r["pacc"]) for r in table if r["pacc"] is not None}
    (axis,) = [axis for axis in points["axes"] if axis["column"] == column]
    assert axis == {"column": column, "title": "person-1.pos.y", "unit": "m", "scale": 1.0, "group": "varied"}


def test_an_axis_that_the_run_does_not_have_is_refused_with_near_matches(api: httpx.Client, drawn: DrawnRuns) -> None:
    path = f"/v1/runs/{drawn.finished}/points"
    for column in ("contrast", "sun_elevation_deg", "time_s", "scene.person-1.character", "pacc"):
        assert column not in [axis["column"] for axis in api.get(path).json()["axes"]]
        assert api.get(path, params={"column": column}).status_code == 422
    refused = api.get(path, params={"column": "distance"}).json()
    assert "did you mean distance_m" in refused["detail"]


def test_a_sample_of_points_is_a_subset_and_always_the_same(api: httpx.Client, drawn: DrawnRuns) -> None:
    path = f"/v1/runs/{drawn.finished}/points"
    whole = set(api.get(path).json()["variant"])
    some = api.get(path, params={"limit": 100}).json()
    assert some["share"] < 1
    assert 0 < len(set(some["variant"])) < len(whole)
    assert set(some["variant"]) < whole
    assert api.get(path, params={"limit": 100}).json() == some


def test_the_summary_is_that_of_the_stored_table(api: httpx.Client, drawn: DrawnRuns, table: list[Row]) -> None:
    rows = api.get(f"/v1/runs/{drawn.finished}/summary").json()["summary"]["rows"]
    row = next(r for r in rows if (r["function"], r["character"]) == ("semantic-fpn-small", "red-coat"))
    values = [r["pacc"] for r in table if r["function"] == "semantic-fpn-small" and r["character"] == "red-coat"]
    defined = [value for value in values if value is not None]
    assert row["persons"] == len(values)
    assert row["pacc_mean"] == pytest.approx(sum(defined) / len(defined))
    assert (row["pacc_min"], row["pacc_max"]) == (min(defined), max(defined))


def test_the_report_is_one_page_in_a_sandbox(api: httpx.Client, drawn: DrawnRuns) -> None:
    answer = api.get(f"/v1/runs/{drawn.finished}/report")
    assert answer.headers["Content-Type"].startswith("text/html")
    assert answer.headers["Content-Security-Policy"].startswith("sandbox ")
    assert answer.text.startswith("<!DOCTYPE html>")


def test_variants_are_paged_and_filtered_by_rejection(api: httpx.Client, drawn: DrawnRuns) -> None:
    path = f"/v1/runs/{drawn.finished}/variants"
    whole = api.get(path).json()["items"]
    assert [run["index"] for run in whole] == list(range(24))
    first = api.get(path, params={"limit": 12}).json()
    second = api.get(path, params={"limit": 12, "cursor": first["next"]}).json()
    assert first["items"] + second["items"] == whole
    assert second["next"] is None
    accepted = api.get(path, params={"rejected": False}).json()["items"]
    assert accepted == [run for run in whole if run["rejection"] is None]
