"""Refusals of the commands about studies and truths, and the output of `valerie plan --truth-only`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.shipped import EXAMPLES, STUDIES
from tests.world.blank import SMALL
from valerie.cli.main import app
from valerie.errors import InvalidInput
from valerie.runs.moments import duration
from valerie.runs.resolving.spec import parse
from valerie.runs.study.study_document import CascadeGoal, parse_study


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(SMALL))
    return path


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["study", "run", "SPEC", "--until-met"], "--until-met.*with --retrain"),
        (["study", "run", "nothere"], "FILE: neither a file nor the id of a study; got nothere"),
        (["study", "mode", "s1", "manual"], "MODE: unknown mode 'manual'; known: automatic, by-hand"),
        (["plan", "SPEC", "--where", "distance_m < 8"], "--where.*with --truth-only"),
        (["plan", "SPEC", "-o", "x.yaml"], "--output.*with --truth-only"),
        (["plan", "SPEC", "--truth-only", "--where", "pacc < 0.5"], "--where.*measures of the truth"),
    ],
)
def test_options_that_lack_another_one_are_refused(
    arguments: list[str], problem: str, spec: Path, invoke: CliRunner
) -> None:
    result = invoke.invoke(app, [str(spec) if word == "SPEC" else word for word in arguments])
    assert isinstance(result.exception, InvalidInput)
    with pytest.raises(InvalidInput, match=problem):
        raise result.exception


def test_variants_are_chosen_by_their_truth(spec: Path, tmp_path: Path, invoke: CliRunner) -> None:
    chosen = tmp_path / "chosen.yaml"
    arguments = ["plan", str(spec), "--truth-only", "--where", "scene.person-1.pos.x < -2.95", "-o", str(chosen)]
    result = invoke.invoke(app, [*arguments, "--data-dir", str(tmp_path / "data")])
    assert result.exit_code == 0, result.output
    (block,) = parse(chosen.read_text()).blocks
    assert len(block.points) == 3
    assert {point["scene.person-1.pos.x"] for point in block.points} == {-3.0}


def test_a_plan_prices_the_first_batch_and_the_whole_budget(tmp_path: Path, invoke: CliRunner) -> None:
    study, data = str(tmp_path / "study.yaml"), ["--data-dir", str(tmp_path / "data")]
    assert invoke.invoke(app, ["study", "new", study]).exit_code == 0
    plan = json.loads(invoke.invoke(app, ["study", "plan", study, "--json", *data]).stdout)["plan"]
    shown = invoke.invoke(app, ["study", "plan", study, *data]).stdout
    start, batch = plan["start_cpu_seconds"], plan["cpu_seconds"]
    whole = duration(start + (batch - start) / 32 * 256)  # the template's batch and budget
    assert f"the budget of 256 variants: about {whole} of CPU time" in shown
    assert "budget.cpu_hours" not in shown
    Path(study).write_text(
        Path(study).read_text("utf-8").replace("{variants: 256}", "{variants: 256, cpu_hours: 0.0001}")
    )
    assert (
        "budget.cpu_hours: 0.0001 hours pay for about 0 variants"
        in invoke.invoke(app, ["study", "plan", study, *data]).stdout
    )


@pytest.mark.parametrize("file", STUDIES, ids=lambda file: file.name)
def test_every_example_of_a_study_can_be_planned(file: Path, tmp_path: Path, invoke: CliRunner) -> None:
    shown = invoke.invoke(app, ["study", "plan", str(file), "--data-dir", str(tmp_path / "data")])
    assert shown.exit_code == 0, shown.output
    cascade = isinstance(parse_study(file.read_text("utf-8")).goal, CascadeGoal)
    assert ("costly engine cost more" in shown.stdout) == cascade
    assert ("of CPU time at this price" in shown.stdout) != cascade


def test_the_cascade_of_the_examples_is_small_and_drafts_its_costly_frames() -> None:
    study = parse_study((EXAMPLES / "cascade.yaml").read_text("utf-8"))
    assert isinstance(study.goal, CascadeGoal)
    assert (study.spec.engine, study.goal.renderer) == ("raster", {"name": "cycles", "quality": "draft"})
    assert study.budget.variants <= 128
    assert study.spec.resolution.width <= 480
