"""`valerie gate` over runs of drawn pictures, in which the first function sees worse far away than the second."""

from __future__ import annotations

import csv
import html
import io
import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from services.api.app import create_app
from tests.world.drawn import FUNCTIONS, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.analysis.wording import ALIKE_PLACES
from valerie.cli.main import app
from valerie.cli.shell import Exit
from valerie.db.claiming import Job
from valerie.errors import InvalidInput, UnknownName

WORSE, BETTER = FUNCTIONS
ALONG = [["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 0.25]]
REQUIREMENTS = [
    {"id": "NEAR", "statistic": "mean(pacc) >= 0.2", "where": "distance_m < 30"},
    {"id": "ALL", "statistic": "share(pacc >= 0.5) >= 99 %", "functions": [WORSE]},
]


@pytest.fixture(scope="module")
def deployed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str, str]:
    """A data folder with a run, a run on the same frames, and one whose truths of three variants failed."""
    folder = tmp_path_factory.mktemp("gate") / "data"
    world = DrawnWorld(settings_of(folder))
    common = {"vary": ALONG, "constants": {"person-1.pos.x": 2.2}, "cameras": ["camera-1"]}
    run_id = world.work(spec("gated", **common, requirements=REQUIREMENTS))
    other = world.work(spec("before", **common, functions=[WORSE]))

    def broken(job: Job) -> bool:
        return job.kind == "truth" and job.frame.key.variant < 3

    far = {"id": "FAR", "statistic": "mean(pacc) >= 0.01", "where": "person-1.pos.y > 20"}
    small = spec("broken", width=64, height=36, **common, requirements=[*REQUIREMENTS, far])
    failed = world.work(small, broken=broken)
    world.context.engine.dispose()
    return folder, run_id, other, failed


def gated(deployed: tuple[Path, str, str, str], *arguments: str, code: int) -> str:
    command = ["gate", *arguments, "--data-dir", str(deployed[0])]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.stdout


def findings(deployed: tuple[Path, str, str, str]) -> str:
    command = ["findings", deployed[1], "--data-dir", str(deployed[0])]
    return CliRunner().invoke(app, command, catch_exceptions=False).stdout


def test_requirements_decide_and_are_written_for_people_ci_and_tables(
    deployed: tuple[Path, str, str, str], tmp_path: Path
) -> None:
    junit, table = tmp_path / "ci" / "gate.xml", tmp_path / "verdicts.csv"
    printed = gated(deployed, deployed[1], "--junit", str(junit), "-o", str(table), code=Exit.GATE_FAILED)
    assert f"MET  NEAR · {WORSE}" in printed
    assert f"NOT MET  ALL · {WORSE}" in printed
    assert "the listed grid" in printed
    assert f"The gate fails: ALL by {WORSE} is not met." in printed
    cases = {(case.get("classname"), case.get("name")): case for case in ET.parse(junit).iter("testcase")}
    assert {key: case.find("failure") is not None for key, case in cases.items()} == {
        (f"requirements.{WORSE}", "NEAR"): False,
        (f"requirements.{BETTER}", "NEAR"): False,
        (f"requirements.{WORSE}", "ALL"): True,
    }
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [(row["id"], row["function"], row["outcome"]) for row in rows] == [
        ("NEAR", WORSE, "met"), ("NEAR", BETTER, "met"), ("ALL", WORSE, "not met"),
    ]  # fmt: skip
    parquet, document = tmp_path / "verdicts.parquet", tmp_path / "verdicts.json"
    for path in (parquet, document):
        gated(deployed, deployed[1], "-o", str(path), code=Exit.GATE_FAILED)
    assert pq.read_table(parquet)["rows"].to_pylist() == [int(row["rows"]) for row in rows]
    assert [load["rows"] for load in json.loads(document.read_text())] == [int(row["rows"]) for row in rows]


def test_a_function_worse_than_its_baseline_shuts_the_gate(deployed: tuple[Path, str, str, str]) -> None:
    document = json.loads(gated(deployed, deployed[1], "--baseline", BETTER, "--json", code=Exit.GATE_FAILED))
    (version,) = document["versions"]
    assert version["version"] == WORSE
    slices = {item["name"]: item for item in version["gate"]["slices"]}
    assert slices["all"]["worse"]
    assert slices["all"]["places"] == 121
    assert {name for name in slices if name.startswith("distance")} >= {"distance 20–30 m"}


def test_a_gate_says_in_how_many_slices_a_drop_would_not_show(deployed: tuple[Path, str, str, str]) -> None:
    printed = gated(deployed, deployed[1], "--baseline", BETTER, "--effect", "0.001", code=Exit.GATE_FAILED)
    (head,) = (line for line in printed.splitlines() if "undecided" in line)
    said = re.search(
        r"; (\d+) of \d+ slices (?:is|are) undecided: (.+?)(?:,.*|;) '(.+)' has (\S+) places and needs about (\S+) to show a "
        r"drop of 0.1 points", head,
    )  # fmt: skip
    assert said is not None, head
    # Of some slices, the places are alike.
    assert int(said[1]) == printed.count("; too few: ") + printed.count(f"; {ALIKE_PLACES}") > 0
    assert said[2] == said[3]
    (line,) = (line for line in printed.splitlines() if line.startswith(f"  {said[3]}: "))
    assert f" at {said[4]} places" in line
    assert f"too few: {said[5]} places" in line


def test_a_run_on_the_same_frames_is_a_baseline(deployed: tuple[Path, str, str, str]) -> None:
    folder, run_id, other, failed = deployed
    printed = gated(deployed, other, "--baseline", run_id, code=Exit.OK)
    assert f"{WORSE} against {WORSE} of run {run_id}: nowhere shown to be worse" in printed
    assert "too few" not in printed
    assert "The gate passes." in printed
    with pytest.raises(InvalidInput, match="looked at other frames; what differs: resolution"):
        gated(deployed, other, "--baseline", failed, code=Exit.OK)
    with pytest.raises(InvalidInput, match="no requirements"):
        gated(deployed, other, code=Exit.OK)
    with pytest.raises(
        UnknownName, match=rf"--baseline: unknown run, or function of the run, 'r0000000000'; known: {WORSE}"
    ):
        gated(deployed, other, "--baseline", "r0000000000", code=Exit.OK)
    assert folder.exists()


def test_frames_that_failed_count_at_their_worst(deployed: tuple[Path, str, str, str]) -> None:
    failed = deployed[3]
    document = json.loads(gated(deployed, failed, "--json", code=Exit.GATE_FAILED))
    verdicts = {(verdict["id"], verdict["function"]): verdict for verdict in document["verdicts"]}
    near, far = verdicts["NEAR", BETTER], verdicts["FAR", BETTER]
    # Three variants without truth: one person each that may be near, and none far, since the spec places it.
    assert (near["lost"], far["lost"]) == (3, 0)
    assert near["worst"] == pytest.approx(near["estimate"] * near["rows"] / (near["rows"] + 3))
    assert near["best"] == pytest.approx((near["estimate"] * near["rows"] + 3) / (near["rows"] + 3))
    assert (far["worst"], far["outcome"]) == (None, "met")


def test_a_server_gives_the_same_result(deployed: tuple[Path, str, str, str]) -> None:
    folder, run_id, _, _ = deployed
    local = json.loads(gated(deployed, run_id, "--baseline", BETTER, "--json", code=Exit.GATE_FAILED))
    with served(create_app(settings_of(folder), control=False)) as client:
        url = ["--url", str(client.base_url)]
        remote = json.loads(gated(deployed, run_id, "--baseline", BETTER, "--json", *url, code=Exit.GATE_FAILED))
        table = client.get(f"/v1/runs/{run_id}/verdicts").text
        parquet = client.get(f"/v1/runs/{run_id}/verdicts", params={"format": "parquet"}).content
        summary = client.get(f"/v1/runs/{run_id}/summary").json()
        report = client.get(f"/v1/runs/{run_id}/report").text
        status = CliRunner().invoke(app, ["status", run_id, *url], catch_exceptions=False).stdout
    assert remote == local
    assert [row["outcome"] for row in csv.DictReader(table.splitlines())] == ["met", "met", "not met"]
    assert pq.read_table(io.BytesIO(parquet))["outcome"].to_pylist() == ["met", "met", "not met"]
    assert summary["verdicts"] == local["verdicts"]
    # Verdicts come before everything else that a result shows.
    shown = ((status, "render"), (html.unescape(report), "<h2>Summary</h2>"), (findings(deployed), "pooled"))
    for text, later in shown:
        assert text.index("share of persons with pACC ≥ 0.5") < text.index(later)


def test_an_unknown_format_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="unknown file format"):
        CliRunner().invoke(app, ["gate", "r1", "-o", str(tmp_path / "x.xls")], catch_exceptions=False)


def test_before_a_version_is_run_the_gate_says_how_many_places_it_takes(
    deployed: tuple[Path, str, str, str],
) -> None:
    text = gated(deployed, deployed[1], "--before", "--effect", "0.2", code=0)
    assert f"{WORSE}: a drop of 20 points in one of " in text
    (need,) = json.loads(
        gated(deployed, deployed[2], "--before", "--deviation", "0.1", "--json", code=0)
    )  # a run of one function
    assert need["needed"] > 1
    assert need["slices"]["all"] > 100
