"""`valerie compare`: two functions of a run of drawn pictures."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner, Result

from tests.world.drawn import FUNCTIONS
from valerie.cli import progress_lines
from valerie.cli.main import app
from valerie.errors import InvalidInput, UnknownName

HERE, THERE = FUNCTIONS


def called(run: tuple[Path, str], command: str, *arguments: str) -> Result:
    folder, run_id = run
    result = CliRunner().invoke(app, [command, run_id, *arguments, "--data-dir", str(folder)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result


def pacc_of(run: tuple[Path, str], function: str) -> NDArray[np.float64]:
    """Return the pACC of the rows of a function in their order, NaN where undefined."""
    table = pyarrow.csv.read_csv(io.BytesIO(called(run, "rows").stdout_bytes))
    of_function: NDArray[np.bool_] = np.array(table["function"].to_pylist()) == function
    pacc: NDArray[np.float64] = np.array(table["pacc"].to_pylist(), np.float64)
    return pacc[of_function]


def test_two_functions_of_a_run_are_compared_person_by_person(run: tuple[Path, str]) -> None:
    document = json.loads(called(run, "compare", "--function", HERE, "--function", THERE, "--json").stdout)
    (comparison,) = document["functions"]
    assert (comparison["function"], comparison["function_there"]) == (HERE, THERE)
    before, after = pacc_of(run, HERE), pacc_of(run, THERE)
    both = np.isfinite(before) & np.isfinite(after)
    whole = comparison["slices"][0]
    assert whole["pairs"] == np.count_nonzero(both) > 10
    assert whole["here"] == pytest.approx(before[both].mean())
    assert whole["there"] == pytest.approx(after[both].mean())
    falls = np.sort((after - before)[both])
    assert comparison["fell"][0]["there"] - comparison["fell"][0]["here"] == pytest.approx(falls[0])
    printed = called(run, "compare", "--function", HERE, "--function", THERE).stdout
    assert f"{HERE} here, {THERE} there" in printed
    undecided = [
        part
        for part in comparison["slices"]
        if not part["difference"]["judgement"] and part["difference"]["places_needed"] > part["difference"]["places"]
    ]
    own = undecided[0]["difference"]
    words = " ".join(printed.split())
    assert f"{len(undecided)} of {len(comparison['slices'])} slices are undecided: {undecided[0]['name']}" in words
    need = f"{own['places']} places and needs about {own['places_needed']:,} to show a change of 5 points"
    assert f"'{undecided[0]['name']}' has {need}" in words


def test_the_report_of_a_comparison_shows_the_worst_regressions(run: tuple[Path, str], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    called(run, "compare", "--function", HERE, "--function", THERE, "-o", str(page))
    html = page.read_text("utf-8").replace("\xa0", " ")
    assert f"{HERE} here, {THERE} there: in" in html[html.index("In short") : html.index("<h2>Findings")]
    views = html[html.index("The views that differ most") :]
    assert views.count('src="data:image/jpeg') >= 2
    assert "fell from" in views


def test_a_long_comparison_shows_its_progress_on_a_terminal_only(
    run: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress_lines, "LINE_SECONDS", 0.0)
    command = ("compare", "--function", HERE, "--function", THERE)
    assert called(run, *command).stderr == ""
    monkeypatch.setattr(progress_lines, "on_terminal", lambda: True)
    shown = called(run, *command)
    assert re.search(r"^1 of \d+ frames compared, .* left$", shown.stderr, re.MULTILINE)
    assert "frames compared" not in shown.stdout


@pytest.mark.parametrize("arguments", [[], ["--function", HERE], ["--function", HERE, "--function", HERE]])
def test_a_comparison_needs_two_sides(run: tuple[Path, str], arguments: list[str]) -> None:
    with pytest.raises(InvalidInput, match="--function: a"):
        called(run, "compare", *arguments)


def test_a_function_that_the_run_lacks_is_refused_with_its_name(run: tuple[Path, str]) -> None:
    with pytest.raises(UnknownName, match=rf"--function: .*semantic-fpn'; did you mean {THERE}"):
        called(run, "compare", "--function", HERE, "--function", "semantic-fpn")


def test_a_parameter_to_compare_across_that_no_run_has_is_refused_with_its_name(run: tuple[Path, str]) -> None:
    with pytest.raises(InvalidInput, match=r"--across: no parameter of these runs; .*: none; got moon"):
        called(run, "compare", "--function", HERE, "--function", THERE, "--across", "moon")
