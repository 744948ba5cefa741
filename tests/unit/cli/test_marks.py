"""`valerie mark` and `valerie status --tag`, against a real server over the drawn runs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.api.app import create_app
from tests.world.drawn import DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.cli.main import app


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, str]]:
    """The address of a server, and its run."""
    settings = settings_of(tmp_path, log_level="error")
    run = DrawnWorld(settings).work(spec("marked"))
    with served(create_app(settings, control=False)) as client:
        yield str(client.base_url), run


def call(url: str, *arguments: str) -> str:
    result = CliRunner().invoke(app, [*arguments, "--url", url])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_tags_are_added_and_taken_away_and_the_note_stays(server: tuple[str, str]) -> None:
    url, run = server
    call(url, "mark", run, "--tag", "night", "--tag", "rain", "--note", "look here")
    call(url, "mark", f"{run}.0.1.0", "--tag", "odd")
    shown = call(url, "mark", run, "--untag", "rain", "--tag", "dusk")
    assert shown.splitlines() == [f"{run}.0.1.0: odd", f"{run}: dusk, night: look here"]
    assert call(url, "mark", run) == shown


def test_candidates_are_reached_by_their_numbers_and_others_are_refused(
    server: tuple[str, str], tmp_path: Path
) -> None:
    url, run = server
    shown = CliRunner().invoke(app, ["findings", run, "--json", "--data-dir", str(tmp_path)])
    findings = json.loads(shown.stdout)["findings"]
    sentences = [finding["sentence"] for finding in findings["items"] + findings["candidates"]]
    assert findings["candidates"]
    mark = ["mark", run, "--tag", "x", "--url", url]
    refine = ["refine", run, "--data-dir", str(tmp_path)]
    for command in (mark, refine):
        result = CliRunner().invoke(app, [*command, "--finding", str(len(sentences))])
        assert result.exit_code == 0
        assert sentences[-1] in result.output
        result = CliRunner().invoke(app, [*command, "--finding", str(len(sentences) + 1)])
        assert str(result.exception).startswith("--finding: no such finding")


def test_runs_are_listed_by_tag_with_and_without_a_server(server: tuple[str, str], tmp_path: Path) -> None:
    url, run = server
    call(url, "mark", run, "--tag", "night")
    for where in (("--url", url), ("--data-dir", str(tmp_path))):
        lines = CliRunner().invoke(app, ["status", "--tag", "night", "--json", *where]).stdout.splitlines()
        assert [json.loads(line)["tags"] for line in lines] == [["night"]]
        assert CliRunner().invoke(app, ["status", "--tag", "day", "--json", *where]).stdout == ""


def test_a_selection_as_wide_as_the_run_is_said_to_cover_everything(server: tuple[str, str], tmp_path: Path) -> None:
    _, run = server
    result = CliRunner().invoke(app, ["refine", run, "--where", "pixel_area >= 0", "--data-dir", str(tmp_path)])
    assert "region: everything, since the selected rows vary as widely as the run" in result.output


def test_a_folder_without_data_is_named_by_commands_that_need_no_server(tmp_path: Path) -> None:
    for command in (["report", "r1"], ["study", "report", "s1"], ["findings", "r1"]):
        result = CliRunner().invoke(app, [*command, "--data-dir", str(tmp_path)])
        assert str(result.exception).startswith(f"there is no database {tmp_path}")
