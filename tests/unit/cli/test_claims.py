"""`valerie claims` on a run of drawn pictures."""

from __future__ import annotations

import json
from pathlib import Path
from unittest.mock import Mock

import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from tests.world.drawn import FUNCTIONS
from tools.paper import KEPT
from valerie.cli.main import app
from valerie.errors import InvalidInput, UnknownName
from valerie.pipeline.reading import reports

CLAIMS = """
title: planted
claims:
  - {id: near, source: "1", says: Somebody is near., quantity: {of: distance_m, statistic: minimum, high: 30}}
  - {id: falls, says: It falls., trend: {over: distance_m, shape: falling}}
  - {id: slip, says: More than all., slip: There is no more than all.}
"""


def called(run: tuple[Path, str], document: Path, *arguments: str) -> str:
    folder, run_id = run
    result = CliRunner().invoke(
        app, ["claims", run_id, str(document), *arguments, "--data-dir", str(folder)], catch_exceptions=False
    )
    assert result.exit_code == 0, result.output
    return result.stdout


def test_every_claim_is_answered_for_people_and_programs(run: tuple[Path, str], tmp_path: Path) -> None:
    document = tmp_path / "claims.yaml"
    document.write_text(CLAIMS)
    printed = called(run, document, "-o", str(tmp_path / "ledger.parquet"))
    assert "REPRODUCED  near" in printed
    assert "SLIP OF THE SOURCE  slip" in printed
    entries = json.loads(called(run, document, "--json"))
    assert [entry["id"] for entry in entries] == ["near", *["falls"] * len(FUNCTIONS), "slip"]
    assert pq.read_table(tmp_path / "ledger.parquet").num_rows == len(entries)
    called(run, document, "-o", str(tmp_path / "ledger.md"))
    assert "| Somebody is near. |" in (tmp_path / "ledger.md").read_text()


def test_wrong_documents_and_formats_are_refused(run: tuple[Path, str], tmp_path: Path) -> None:
    document = tmp_path / "claims.yaml"
    document.write_text("title: nothing\nclaims: []\n")
    with pytest.raises(InvalidInput, match="claims"):
        called(run, document)
    document.write_text(CLAIMS.replace("over: distance_m", "over: distance"))
    with pytest.raises(UnknownName, match="distance_m"):
        called(run, document)
    with pytest.raises(InvalidInput, match=r"\.parquet"):
        called(run, document, "-o", "ledger.xlsx")


def test_a_report_shows_a_comparison_that_was_made_elsewhere(run: tuple[Path, str], tmp_path: Path) -> None:
    folder, run_id = run
    page, other = tmp_path / "report.html", tmp_path / "other.json"
    other.write_text("{}")

    def report(beside: Path) -> str:
        command = ["report", run_id, "--data-dir", str(folder), "-o", str(page), "--beside", str(beside)]
        result = CliRunner().invoke(app, command, catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return page.read_text("utf-8").replace("\xa0", " ")  # no-break spaces

    html = report(KEPT / "paper-cycles.json")
    in_short = html[html.index("In short") : html.index("<h2>Findings")]
    assert (
        "deeplabv3plus-small: in paper-cycles (cycles), pACC differs by −1.4 points from paper-cycles-raster (raster) "
        "of these places, no interval: neighbouring places score alike, so they are no independent evidence, "
        "on 216 equal views" in in_short
    )
    assert "pACC is lower with person-1.pos.y 23 m than with 5 m (deeplabv3plus-small, semantic-fpn-small)" in in_short
    assert "Not decided on either side: 13 of 21 conclusions." in in_short
    assert "comparison uses another run" in html
    with pytest.raises(InvalidInput, match="not a comparison of two runs"):
        report(other)


def test_a_report_with_claims_and_the_numbers_of_its_figures_come_from_one_analysis(
    run: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, run_id = run
    spied = Mock(wraps=reports.analyze)
    monkeypatch.setattr(reports, "analyze", spied)
    command = ["report", run_id, "--data-dir", str(folder), "-o", str(tmp_path / "report.html")]
    (tmp_path / "claims.yaml").write_text(CLAIMS)
    command += ["--claims", str(tmp_path / "claims.yaml"), "--figures", str(tmp_path / "figures")]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert spied.call_count == 1
    names = {path.stem for path in (tmp_path / "figures").iterdir()}
    assert names >= {"bins", "curves", "distributions", "levels"}
    for name in names:
        text = pyarrow.csv.read_csv(tmp_path / "figures" / f"{name}.csv")
        assert text.column_names == pq.read_schema(tmp_path / "figures" / f"{name}.parquet").names
        assert text.num_rows == pq.read_table(tmp_path / "figures" / f"{name}.parquet").num_rows
