"""An evidence folder is a valid RO-Crate 1.2, as roc-validator judges it in an environment of its own (`make test-rocrate`)."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.world.blank import completed_run
from valerie.pipeline.evidence.crate import METADATA
from valerie.pipeline.evidence.exporting import export_evidence

VALIDATE = Path(__file__).with_name("validate.py")
#: Recommendations that cannot be met: nobody says who publishes, no licence is chosen, and the manifest is written last.
OPEN = {"ro-crate-1.2_56.1", "ro-crate-1.2_64.1", "ro-crate-1.2_85.0"}


@pytest.fixture(scope="module")
def evidence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evidence")
    pipeline, run_id = completed_run(folder)
    export_evidence(pipeline.context, run_id, folder / "out")
    return folder / "out"


def issues(folder: Path) -> list[tuple[str, str]]:
    """Return the severity and the identifier of each issue."""
    python = os.environ["VALERIE_TEST_ROCRATE_PYTHON"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run([python, VALIDATE, folder], capture_output=True, text=True, env=environment, check=False)
    assert not done.stderr, done.stderr
    return [(line.split(": ")[0], line.split(": ")[1]) for line in done.stdout.splitlines()]


def test_evidence_meets_every_requirement_and_all_but_three_recommendations(evidence: Path) -> None:
    problems = issues(evidence)
    assert {severity for severity, _ in problems} == {"RECOMMENDED"}
    assert {identifier for _, identifier in problems} == OPEN


def test_the_validator_sees_a_damaged_description(evidence: Path) -> None:
    path = evidence / METADATA
    whole = path.read_text("utf-8")
    path.write_text(whole.replace('"datePublished"', '"datePublisht"'))
    assert "REQUIRED" in {severity for severity, _ in issues(evidence)}
    path.write_text(whole)
