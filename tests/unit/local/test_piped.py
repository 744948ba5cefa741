"""Output of commands into a file or a pipe: whole lines without padding."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich.padding import Padding
from rich.table import Table
from typer.testing import CliRunner

from tests.world.boxes import write_box_street
from valerie.cli.main import app
from valerie.local.piped import PipedConsole

PATH = "scene.house-101.street.floor-2.street.window-3." + "colour" * 24


def test_no_line_ends_with_spaces(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(box=None)
    table.add_column("a name")
    table.add_column("undefined")
    table.add_row("one", "")
    table.add_row("two", "something longer")
    out = PipedConsole(stderr=False)
    out.print(table)
    out.print(Padding("below", (1, 0, 1, 2)))
    printed = capsys.readouterr().out
    assert [line.rstrip() for line in printed.splitlines()] == printed.splitlines()
    assert "something longer" in printed
    assert printed.endswith("\n\n  below\n\n")


def test_what_stands_at_the_beginning_of_a_line_stays(capsys: pytest.CaptureFixture[str]) -> None:
    PipedConsole(stderr=True).print("  a\n   b  ", "c  ", sep="|")
    assert capsys.readouterr().err == "  a\n   b  |c\n"


def test_a_long_path_in_a_table_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(box=None)
    for name in ("path", "value"):
        table.add_column(name, overflow="fold")
    table.add_row(PATH, "3")
    PipedConsole(stderr=False).print(table)
    assert PATH in capsys.readouterr().out.split()


def test_an_asset_is_shown_in_whole_lines_without_padding(tmp_path: Path) -> None:
    write_box_street(tmp_path / "boxes")
    show = ["asset", "show", str(tmp_path / "boxes"), "--declared"]
    result = CliRunner().invoke(app, show, env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert [line for line in lines if line.endswith(" ")] == []
    assert any(line.startswith("scene.camera-2.focal_length_mm FLOAT ") for line in lines)
