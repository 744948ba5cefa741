"""What `valerie asset show` prints."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from valerie.cli import assets
from valerie.cli.main import app
from valerie.parameters.definitions import Affects, ParameterType
from valerie.scene.assets.asset import asset_manifest
from valerie.scene.variation.traverse import PathEntry


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> int:
    """A terminal of 80 columns."""
    from rich.console import Console

    monkeypatch.setattr(assets, "console", lambda: Console(width=80, color_system=None))
    return 80


def test_what_may_vary_is_told_whole_on_a_narrow_terminal(terminal: int) -> None:
    result = CliRunner().invoke(app, ["asset", "show", "urban-street", "--declared"])
    assert result.exit_code == 0, result.output
    manifest, _ = asset_manifest("urban-street")
    assert all(len(line) <= terminal for line in result.output.splitlines())
    assert "…" not in result.output.replace(" … ", "")
    words = result.output.split()
    for parameter in manifest.parameters:
        assert parameter.path[:30] in result.output  # longer ones go on below
        assert set(parameter.choices or ()) <= set(words) | {"auto"}


def test_choices_are_named_by_path_where_two_of_one_attribute_differ(terminal: int) -> None:
    paths = (
        ("scene.car-1.colour", ("red",)),
        ("scene.bus-1.colour", ("blue",)),
        ("scene.person-1.pose", ("walking",)),
        ("scene.person-2.pose", ("walking",)),
        ("scene.person-1.pos.x", ()),
    )
    entries = [
        PathEntry(path, ParameterType.CATEGORICAL, "", None, None, choices, "", declared=True, affects=Affects.GEOMETRY)
        for path, choices in paths
    ]
    assert assets._choices(entries) == {
        "scene.car-1.colour": ("red",),
        "scene.bus-1.colour": ("blue",),
        "pose": ("walking",),
    }
