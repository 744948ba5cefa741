"""`valerie train`: from a run to a new version of a function."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.world.drawn import FUNCTIONS, TOWN, DrawnWorld, installed_town, spec
from tests.world.training import class_here, draw_frames
from tests.world.world import settings_of
from valerie.cli.main import app
from valerie.errors import InvalidInput

WEAK = "pacc < 0.9 and distance_m > 25"


@pytest.fixture(scope="module", autouse=True)
def town(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with installed_town(tmp_path_factory.mktemp("town")):
        yield


def test_for_a_run_with_several_functions_the_command_of_each_is_shown(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    world = DrawnWorld(settings_of(folder))
    run_id = world.work(spec("two functions"), products=0)
    world.context.engine.dispose()
    arguments = ["train", "--from", run_id, "--where", WEAK, "--anywhere", "--steps", "7", "--data-dir", str(folder)]
    refused = CliRunner().invoke(app, arguments).exception
    assert isinstance(refused, InvalidInput)
    first, *lines = str(refused).splitlines()
    assert first == "--function: the run has several functions, and one is trained at a time; choose:"
    called = [shlex.split(line) for line in lines]
    assert [words[-2:] for words in called] == [["--function", name] for name in FUNCTIONS]
    for words in called:
        assert words[words.index("train") + 1 : -2] == arguments[1:]


@pytest.mark.timeout(900)
def test_a_new_version_is_trained_registered_and_compared_in_one_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "data"
    deployment = settings_of(folder)
    world = DrawnWorld(deployment, infer_class=class_here("semantic-fpn-small", deployment))
    along_the_street = [["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 5.0]]
    run_id = world.work(spec("validation", asset=TOWN, vary=along_the_street, functions=["semantic-fpn-small"]))
    world.context.engine.dispose()
    monkeypatch.setattr("valerie.pipeline.retraining.retrain.render_training_frames", draw_frames)
    monkeypatch.setenv("VALERIE_MIN_FREE_MB", "0")
    monkeypatch.setenv("VALERIE_BROKER_URL", "memory://")
    little = ["--frames", "1", "--sites", "1", "--steps", "1", "--batch", "2", "--held-out-frames", "0"]
    place = ["--data-dir", str(folder)]
    arguments = ["train", "--from", run_id, "--where", WEAK, *little, *place, "--json"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["versions"][0] == "semantic-fpn-small"
    listed = json.loads(CliRunner().invoke(app, ["function", "list", "--json", *place], catch_exceptions=False).stdout)
    (new,) = [function for function in listed if function["name"] == "semantic-fpn-small-retrained"]
    assert json.loads(result.stdout)["versions"][1].startswith(f"semantic-fpn-small-retrained@{new['digest'][:12]}")
    assert f"functions: [semantic-fpn-small, semantic-fpn-small-retrained@{new['digest'][:12]}]" in result.stderr
