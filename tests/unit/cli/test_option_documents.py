"""Commands that take options as documents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from valerie.cli.option_documents import takes_documents


@dataclass(frozen=True, slots=True)
class Place:
    x: Annotated[float, typer.Option("--x", min=0)]
    y: Annotated[float, typer.Option("--y")] = 2.0


@dataclass(frozen=True, slots=True)
class Marks:
    tags: Annotated[list[str] | None, typer.Option("--tag", help="Can be repeated.")] = None
    hidden: Annotated[bool, typer.Option("--hidden")] = False


@pytest.fixture
def app() -> typer.Typer:
    application = typer.Typer(rich_markup_mode=None)

    @application.command()
    @takes_documents
    def pin(name: str, place: Place, marks: Marks, count: Annotated[int, typer.Option("--count")] = 1) -> None:
        """Pin a name."""
        typer.echo(repr((name, place, marks, count)))

    return application


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["a", "--x", "1"], ("a", Place(1.0), Marks(), 1)),
        (
            ["--y", "3", "--tag", "b", "--tag", "c", "a", "--hidden", "--count", "4", "--x", "1"],
            ("a", Place(1.0, 3.0), Marks(["b", "c"], hidden=True), 4),
        ),
    ],
)
def test_a_document_holds_the_values_of_its_options(
    app: typer.Typer, arguments: list[str], expected: tuple[object, ...]
) -> None:
    answer = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert answer.stdout.strip() == repr(expected)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a"], "Missing option '--x'"),
        (["a", "--x", "-1"], "'--x': Input should be greater"),
        (["--x", "1"], "Missing argument 'name'"),
    ],
)
def test_a_missing_or_wrong_option_is_refused_by_its_name(app: typer.Typer, arguments: list[str], words: str) -> None:
    answer = CliRunner().invoke(app, arguments)
    assert answer.exit_code == 2
    assert words in answer.stderr


def test_help_lists_the_options_in_order(app: typer.Typer) -> None:
    text = CliRunner().invoke(app, ["--help"]).stdout
    places = [text.index(option) for option in ("--x", "--y", "--tag", "--hidden", "--count")]
    assert places == sorted(places)
    assert "Pin a name." in text
    assert "Can be repeated." in text
