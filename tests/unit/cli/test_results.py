"""`valerie findings` and `valerie rows` over a run of the blank engine."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from tests.world.blank import SMALL, completed_run
from tests.world.boxes import write_box_street
from valerie.cli.main import app
from valerie.errors import InvalidInput, NotFound, UnknownName


def told(invoke: CliRunner, deployed: tuple[Path, str], *arguments: str) -> str:
    command = [*arguments, "--data-dir", str(deployed[0] / "data")]
    result = invoke.invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_findings_shows_the_table_of_a_run_that_ended_without_a_server(
    invoke: CliRunner, deployed: tuple[Path, str]
) -> None:
    printed = told(invoke, deployed, "findings", deployed[1])
    assert "mean pACC" in printed
    assert "blank" in printed
    document = json.loads(told(invoke, deployed, "findings", deployed[1], "--json"))
    assert document["summary"]["frames"] == 24
    with pytest.raises(NotFound):
        told(invoke, deployed, "findings", "r0000000000")


def test_findings_of_several_runs_are_those_of_all_their_rows(
    tmp_path: Path, invoke: CliRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline, first = completed_run(tmp_path)
    second = pipeline.submit()
    assert pipeline.run(second) == "completed"
    monkeypatch.setenv("VALERIE_ASSET_DIR", str(tmp_path / "assets"))
    document = json.loads(told(invoke, (tmp_path, first), "findings", first, second, "--json"))
    assert document["summary"]["frames"] == 48
    assert "mean pACC" in told(invoke, (tmp_path, first), "findings", first, second)
    claims, page = tmp_path / "claims.yaml", tmp_path / "report.html"
    claims.write_text(
        "title: planted\nclaims: [{id: near, says: Near., quantity: {of: distance_m, statistic: minimum, high: 99}}]"
    )
    (entry,) = json.loads(told(invoke, (tmp_path, first), "claims", first, second, str(claims), "--json"))
    assert entry["outcome"] == "reproduced"
    told(invoke, (tmp_path, first), "report", first, second, "--claims", str(claims), "-o", str(page))
    html = page.read_text("utf-8")
    assert "48 frames of 2 runs" in html
    assert f"{second} (box-street)" in html
    assert "nothing but site or draw" in html
    with pytest.raises(InvalidInput, match="several runs are compared"):
        told(invoke, (tmp_path, first), "report", first, second, "--beside", first)
    for command in (["claims", first, second, str(claims)], ["report", first, second]):
        with pytest.raises(InvalidInput, match="several runs"):
            told(invoke, (tmp_path, first), *command, "--url", "http://127.0.0.1:9")
    other = pipeline.submit(SMALL | {"constants": {"sun-1.elevation": 12}, "seed": 3})
    assert pipeline.run(other) == "completed"
    command = ["findings", first, other, "--data-dir", str(tmp_path / "data")]
    said = invoke.invoke(app, command, catch_exceptions=False).stderr.splitlines()
    assert said == [
        f"No finding accounts for what differs: constants.sun-1.elevation (not set in {first}, 12 in {other})."
    ]
    write_box_street(tmp_path / "assets" / "further-street")
    further = pipeline.submit(SMALL | {"asset": "further-street"})
    assert pipeline.run(further) == "completed"
    command = ["findings", first, further, "--data-dir", str(tmp_path / "data")]
    assert invoke.invoke(app, command, catch_exceptions=False).stderr.splitlines() == [
        f"No finding accounts for what differs: asset.name (box-street in {first}, further-street in {further})."
    ]
    with pytest.raises(InvalidInput, match="each run once"):
        told(invoke, (tmp_path, first), "findings", first, first)


def test_rows_is_the_long_table_and_where_picks_among_its_rows(
    invoke: CliRunner, deployed: tuple[Path, str], tmp_path: Path
) -> None:
    run_id = deployed[1]
    table = list(csv.DictReader(io.StringIO(told(invoke, deployed, "rows", run_id))))
    assert len(table) == 48  # two persons, one of them absent, in 24 frames
    near = [row for row in table if row["distance_m"] and row["camera"] == "camera-1"]
    middle = sorted(float(row["distance_m"]) for row in near)[len(near) // 2]
    expected = [row["frame_id"] for row in near if float(row["distance_m"]) > middle]
    assert 0 < len(expected) < len(near)
    out = tmp_path / "far.parquet"
    where = f"distance_m > {middle!r} and camera == 'camera-1'"
    told(invoke, deployed, "rows", run_id, "-o", str(out), "--where", where)
    assert pq.read_table(out)["frame_id"].to_pylist() == expected


def test_what_rows_cannot_write_or_select_is_refused(
    invoke: CliRunner, deployed: tuple[Path, str], tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match="unknown file format"):
        told(invoke, deployed, "rows", deployed[1], "-o", str(tmp_path / "rows.xlsx"))
    with pytest.raises(UnknownName, match="did you mean distance_m"):
        told(invoke, deployed, "rows", deployed[1], "--where", "distance > 12")
