"""`valerie evidence`: export, verify and key, over a run of the blank engine."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.planted_tables import planted_finding
from valerie.analysis.findings.findings import ScoredPerson
from valerie.cli import progress_lines
from valerie.cli.main import app
from valerie.cli.shell import Exit
from valerie.pipeline.evidence.evidence_manifest import SIGNED


def test_evidence_is_exported_signed_checked_without_a_data_folder_and_refused_when_it_changed(
    invoke: CliRunner, deployed: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def told(*arguments: str, code: int = Exit.OK) -> str:
        result = invoke.invoke(app, ["evidence", *arguments], catch_exceptions=False)
        assert result.exit_code == code, result.output
        return result.stdout

    run_id = deployed[1]
    shutil.copytree(deployed[0] / "data", tmp_path / "data")
    summary = tmp_path / "data/artifacts/runs" / run_id / "summary.json"
    document = json.loads(summary.read_text())
    view = ScoredPerson(f"{run_id}.5.1.0", "default", "blank", 24001, 0.0)
    document["findings"]["items"] = [asdict(planted_finding(view, view))]
    summary.write_text(json.dumps(document))
    key, folder = tmp_path / "key", tmp_path / "evidence"
    key_id = told("key", "new", str(key)).split()[2].rstrip(";")
    data = ("--data-dir", str(tmp_path / "data"))
    exported = json.loads(told("export", run_id, "--out", str(folder), "--key", str(key), "--json", *data))
    assert exported["signer"] == key_id
    assert exported["folder"] == str(folder)
    monkeypatch.setenv("VALERIE_DATA_DIR", str(tmp_path / "nothing"))
    assert f"signed by key {key_id}" in told("verify", str(folder), "--key", f"{key}.pub")
    assert "files are consistent, signer unknown" in told("verify", str(folder))
    with monkeypatch.context() as terminal:
        terminal.setattr(progress_lines, "LINE_SECONDS", 0.0)
        assert invoke.invoke(app, ["evidence", "verify", str(folder)]).stderr == ""
        terminal.setattr(progress_lines, "on_terminal", lambda: True)
        shown = invoke.invoke(app, ["evidence", "verify", str(folder)]).stderr
        assert re.search(r"^1 of \d+ files checked, .* left$", shown, re.MULTILINE)
    shutil.copytree(folder, tmp_path / "unsigned")
    (tmp_path / "unsigned" / SIGNED).unlink()
    assert "files are consistent. The folder is not signed: nothing shows where it came from; anyone can" in told(
        "verify", str(tmp_path / "unsigned")
    )
    unsigned = told("verify", str(tmp_path / "unsigned"), "--key", f"{key}.pub", code=Exit.COMPLETED_WITH_FAILURES)
    assert "The folder is not signed: nothing shows where it came from" in unsigned
    verified = json.loads(told("verify", str(folder), "--replay", "1", "--json"))
    assert (verified["root"], verified["signer"], verified["problems"]) == (exported["root"], None, [])
    assert [picture["verdict"] for picture in verified["replayed"]] == ["equal"] * 4
    assert told("verify", str(folder), "--replay", "1").count(": equal\n") == 4
    assert not (tmp_path / "nothing").exists()
    monkeypatch.setenv("VALERIE_ASSET_DIR", str(tmp_path))
    assert "cannot be made here" in told("verify", str(folder), "--replay", "1", code=Exit.ENVIRONMENT)
    (folder / "spec.json").write_text("{}")
    assert told("verify", str(folder), code=Exit.COMPLETED_WITH_FAILURES).splitlines() == [
        f"{folder}: refused",
        "  spec.json: changed",
    ]
    refused = json.loads(told("verify", str(folder), "--json", code=Exit.COMPLETED_WITH_FAILURES))
    assert refused == {"problems": ["spec.json: changed"]}
