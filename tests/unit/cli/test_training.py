"""`valerie train`: from a run to a new version of a function."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[2]))

from sketch.runs import FUNCTIONS, open_sketch, settings_of, spec, work

from valerie.cli.main import app
from valerie.errors import InvalidInput

WEAK = "pacc < 0.5 and distance_m > 25"


def test_for_a_run_with_several_functions_the_command_of_each_is_shown(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    context, bell = open_sketch(settings_of(folder))
    run_id = work(context, bell, spec("two functions"), products=0)
    context.engine.dispose()
    given = ["train", "--from", run_id, "--where", WEAK, "--anywhere", "--steps", "7", "--data-dir", str(folder)]
    refused = CliRunner().invoke(app, given).exception
    assert isinstance(refused, InvalidInput)
    first, *lines = str(refused).splitlines()
    assert first == "--function: the run has several functions, and one is trained at a time; choose:"
    called = [shlex.split(line) for line in lines]
    assert [words[-2:] for words in called] == [["--function", name] for name in FUNCTIONS]
    for words in called:
        assert words[words.index("train") + 1 : -2] == given[1:]
