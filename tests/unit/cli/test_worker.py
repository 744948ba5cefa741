"""`valerie worker`: which engines a render worker is told to offer."""

from __future__ import annotations

import os
from typing import Any

import pytest
from typer.testing import CliRunner

from valerie.cli.main import app


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> list[dict[str, str]]:
    """Environments of the programs that would have been started."""
    environments: list[dict[str, str]] = []
    monkeypatch.setattr(os, "execve", lambda _path, _arguments, environment: environments.append(environment))
    monkeypatch.setenv("VALERIE_DATA_DIR", str(tmp_path))
    return environments


def test_a_render_worker_offers_the_engines_that_it_is_told(started: list[dict[str, str]]) -> None:
    CliRunner().invoke(app, ["worker", "render", "--engines", "cycles"])
    assert [one["VALERIE_RENDER_ENGINES"] for one in started] == ["cycles"]


def test_without_being_told_it_offers_what_the_settings_say(started: list[dict[str, str]]) -> None:
    CliRunner().invoke(app, ["worker", "render"])
    assert [one["VALERIE_RENDER_ENGINES"] for one in started] == ["raster,pyrender,cycles"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "--engines", "cycels"], "did you mean cycles"),
        (["infer", "--engines", "cycles"], "only a render worker takes engines"),
        (["paint"], "unknown stage 'paint'; known: eval, infer, render"),
    ],
)
def test_a_wrong_choice_is_named_and_nothing_starts(
    started: list[dict[str, str]], arguments: list[str], message: str
) -> None:
    result = CliRunner().invoke(app, ["worker", *arguments])
    assert message in str(result.exception) + result.output
    assert not started
