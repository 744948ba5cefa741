"""`valerie asset show` prints an asset."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from tests.world.boxes import write_box_street
from valerie.cli import assets
from valerie.cli.main import app
from valerie.testing.assets import simple_manifest


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> int:
    """A terminal of 80 columns."""
    from rich.console import Console

    monkeypatch.setattr(assets, "console", lambda: Console(width=80, color_system=None))
    return 80


def test_declared_parameters_are_whole_on_a_narrow_terminal(terminal: int, tmp_path: Path) -> None:
    write_box_street(tmp_path / "boxes")
    result = CliRunner().invoke(app, ["asset", "show", str(tmp_path / "boxes"), "--declared"])
    assert result.exit_code == 0, result.output
    manifest = simple_manifest()
    assert all(len(line) <= terminal for line in result.output.splitlines())
    assert "…" not in result.output.replace(" … ", "")
    words = result.output.split()
    for parameter in manifest.parameters:
        assert parameter.path[:30] in result.output  # longer ones go on below
        assert set(parameter.choices or ()) <= set(words) | {"auto"}


def test_choices_are_named_by_path_where_two_of_one_attribute_differ(terminal: int, tmp_path: Path) -> None:
    manifest = tmp_path / "boxes" / "manifest.yaml"
    write_box_street(manifest.parent)

    def shown() -> list[str]:
        result = CliRunner().invoke(app, ["asset", "show", str(manifest.parent), "--declared"])
        assert result.exit_code == 0, result.output
        return [line.rstrip() for line in result.output.splitlines() if " | " in line]

    assert shown() == ["character: red-coat | blue-coat | absent"]
    document = yaml.safe_load(manifest.read_text())
    character = next(entry for entry in document["parameters"] if entry["path"] == "scene.person-2.character")
    character["choices"].remove("red-coat")
    manifest.write_text(yaml.safe_dump(document))
    assert shown() == [
        "scene.person-1.character: red-coat | blue-coat | absent",
        "scene.person-2.character: blue-coat | absent",
    ]
