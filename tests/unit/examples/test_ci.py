"""The CI examples are YAML, and their command lines are those of `valerie`."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml

from valerie.cli.main import app
from valerie.runs.resolving.spec import parse, resolve
from valerie.scene.assets.asset import asset_manifest

CI = Path(__file__).parents[3] / "examples" / "ci"


def commands(document: Any) -> list[list[str]]:
    """Return the arguments of every `valerie` command line in a document; a substituted id stands for itself."""
    if isinstance(document, dict):
        return [words for value in document.values() for words in commands(value)]
    if isinstance(document, list):
        return [words for value in document for words in commands(value)]
    if not isinstance(document, str) or not document.startswith("valerie "):
        return []
    line = re.split(r" \|\| | > ", re.sub(r'"\$\([^)]*\)"', "r1ng219w3v1ks", document))[0]
    return [shlex.split(line)[1:]]


@pytest.mark.parametrize("name", ["github.yml", "gitlab.yml"])
def test_the_commands_of_a_pipeline_are_understood(name: str) -> None:
    valerie: Any = typer.main.get_command(app)
    calls = commands(yaml.safe_load((CI / name).read_text("utf-8")))
    assert [words[0] for words in calls] == ["run", "gate"]
    parsed = {}
    for words in calls:
        parsed[words[0]] = valerie.commands[words[0]].make_context(words[0], words[1:]).params
    assert parsed["run"]["json_lines"]
    assert parsed["gate"]["run_id"] == "r1ng219w3v1ks"
    assert parsed["gate"]["junit"] == Path("gate.xml")
    # The baseline is one of the functions that were run.
    assert parsed["gate"]["baseline"] in [Path(one).stem for one in parsed["run"]["functions"].split(",")]


def test_both_pipelines_run_the_same() -> None:
    github, gitlab = (
        commands(yaml.safe_load((CI / f"{name}.yml").read_text("utf-8"))) for name in ("github", "gitlab")
    )
    assert github == gitlab


def test_the_requirements_can_be_planned_and_judged() -> None:
    spec = parse((CI / "requirements.yaml").read_text("utf-8"))
    manifest, digest = asset_manifest(spec.asset)
    run = resolve(spec, manifest, asset_digest=digest)
    assert run.warnings == ()
    assert [requirement.functions for requirement in run.requirements] == [spec.functions] * 2
