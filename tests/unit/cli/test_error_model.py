"""`valerie error-model` over a run of drawn pictures, and its files in the evidence."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner

from tests.world.drawn import FUNCTIONS, DrawnWorld, spec
from tests.world.world import settings_of
from valerie.cli.main import app
from valerie.cli.shell import Exit

ALONG = [["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 0.75]]


def test_the_models_of_a_run_are_written_stored_and_part_of_its_evidence(tmp_path: Path) -> None:
    def told(*arguments: str, code: int = Exit.OK) -> str:
        result = CliRunner().invoke(app, [*arguments, "--data-dir", str(data)], catch_exceptions=False)
        assert result.exit_code == code, result.output
        return result.stdout

    data, out, folder = tmp_path / "data", tmp_path / "models", tmp_path / "evidence"
    world = DrawnWorld(settings_of(data))
    common = {"constants": {"person-1.pos.x": 2.2}, "cameras": ["camera-1"], "functions": [FUNCTIONS[0]]}
    run_id = world.work(spec("modelled", width=64, height=36, vary=ALONG, **common))
    world.context.engine.dispose()

    refused = Exit.COMPLETED_WITH_FAILURES
    answer = told(
        "error-model", run_id, "--out", str(out), "--given", "distance_m", "--threshold", "0.001", code=refused
    )
    card = json.loads((out / "error-model.json").read_text())
    assert (card["run"], card["threshold"]) == (run_id, 0.001)
    assert FUNCTIONS[0] in answer
    assert card["conditions"]["person-1.pos.x"] == "2.2"

    told("evidence", "export", run_id, "--out", str(folder))
    facts = json.loads((folder / "run.json").read_text())
    assert facts["results"]["table"] == card["table"]
    assert (folder / "error-model.json").read_bytes() == (out / "error-model.json").read_bytes()
    told("evidence", "verify", str(folder))
    (folder / "error-model.json").write_bytes(b"x" + (folder / "error-model.json").read_bytes()[1:])
    assert "error-model.json: changed" in told("evidence", "verify", str(folder), code=refused)
