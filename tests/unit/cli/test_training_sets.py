"""`valerie train frames` and `valerie train fit`."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest
import typer.main
from typer.testing import CliRunner, Result

from tests.world.training import box_frames
from valerie.cli.main import app
from valerie.errors import InvalidInput, NotFound
from valerie.perception.importing.function_file import read_header
from valerie.perception.shipped import function_card
from valerie.perception.training.frame_folder import write_index, write_shard
from valerie.perception.training.training_settings import TrainingSettings
from valerie.pipeline.retraining.training_frames import FrameSettings

SHORT = ["--steps", "1", "--batch", "2", "--precision", "fp32", "--device", "cpu"]


def write_frames(folder: Path, seed: int, count: int = 2, **size: int) -> Path:
    folder.mkdir()
    shard = write_shard(folder, seed, box_frames(count, site_seed=seed, **size))
    write_index(folder, [shard], {"street-seeds": f"{seed}-{seed}", "asset": "boxes"})
    return folder


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    return write_frames(tmp_path / "train", 1000), write_frames(tmp_path / "held-out", 900)


@pytest.fixture
def fit(folders: tuple[Path, Path]) -> list[str]:
    return ["fit", "semantic-fpn-small", "--frames", str(folders[0]), "--held-out", str(folders[1])]


def train(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["train", *map(str, arguments)], catch_exceptions=False)


def refusal(*arguments: str | Path) -> Exception:
    error = CliRunner().invoke(app, ["train", *map(str, arguments)]).exception
    assert isinstance(error, Exception)
    return error


def test_fit_writes_a_function_with_its_provenance(fit: list[str], tmp_path: Path) -> None:
    out = tmp_path / "out" / "semantic-fpn-small.safetensors"
    result = train(*fit, "--out", out, *SHORT, "--weaknesses", "people far away")
    assert result.exit_code == 0
    card = function_card("semantic-fpn-small", folder=out.parent)
    assert card.provenance["frames-street-seeds"] == "1000-1000"
    assert card.provenance["held-out-street-seeds"] == "900-900"
    assert card.provenance["licence"] == "Apache-2.0"
    assert card.provenance["steps"] == "1"
    assert card.provenance["known-weaknesses"] == "people far away"
    assert "held-out-person-iou" in card.provenance
    assert "after 1 steps" in result.stdout
    assert out.with_suffix(".curve.png").stat().st_size > 1000


def test_scales_of_samples_are_numbers_with_commas(fit: list[str], tmp_path: Path) -> None:
    out = tmp_path / "a.safetensors"
    train(*fit, "--out", out, *SHORT, "--scales", "1,0.75")
    settings = json.loads(read_header(out).provenance["training-settings"])
    assert settings["crops"]["scales"] == [1.0, 0.75]
    refused = refusal(*fit, "--out", out, *SHORT, "--scales", "1,-2")
    assert str(refused) == "--scales: out of bounds; got -2.0; limit: > 0.0"
    assert "--scales: not numbers" in str(refusal(*fit, "--out", out, "--scales", "1;2"))


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    arguments = ["fit", "semantic-fpn-small", "--frames", tmp_path, "--held-out", tmp_path, "--out", "x"]
    refused = refusal(*arguments)
    assert isinstance(refused, NotFound)
    assert "training frames" in str(refused)


def test_every_wrong_setting_is_named_by_its_option(fit: list[str]) -> None:
    refused = refusal(*fit, "--out", "x", "--steps", "0", "--device", "cdua", "--time-budget", "-1")
    assert isinstance(refused, InvalidInput)
    assert sorted(str(refused).splitlines()) == [
        "--device: unknown value 'cdua'; did you mean cuda, cpu?",
        "--steps: out of bounds; got 0; limit: >= 1",
        "--time-budget: out of bounds; got -1.0; limit: > 0.0",
    ]


@pytest.mark.parametrize("command", ["frames", "fit"])
def test_the_help_explains_every_option(command: str) -> None:
    result = CliRunner().invoke(app, ["train", command, "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    parser = typer.main.get_command(app).commands["train"].commands[command]  # type: ignore[attr-defined]
    options = [parameter for parameter in parser.params if parameter.opts[0].startswith("--")]
    assert len(options) > 5
    for option in options:
        assert re.search(rf"{option.opts[0]} .*\w", result.stdout)
        assert option.help


@pytest.mark.parametrize(
    ("command", "settings", "names"),
    [
        ("frames", FrameSettings(), {}),
        ("fit", TrainingSettings(architecture="semantic-fpn-small"), {"time_budget": "time_budget_s"}),
    ],
)
def test_options_have_the_defaults_of_the_settings(command: str, settings, names: dict[str, str]) -> None:
    parser = typer.main.get_command(app).commands["train"].commands[command]  # type: ignore[attr-defined]
    compared = 0
    for parameter in parser.params:
        setting = names.get(parameter.name, parameter.name)
        if setting in type(settings).model_fields and not parameter.required:
            # What the settings look up (the first installed pack) is left to them.
            looked_up = type(settings).model_fields[setting].default_factory is not None
            assert parameter.default == (None if looked_up else getattr(settings, setting)), setting
            compared += 1
    assert compared >= 4


def test_several_folders_are_learned_from_as_one_and_the_card_says_which(
    folders: tuple[Path, Path], tmp_path: Path
) -> None:
    wide = write_frames(tmp_path / "wide", 1030, 3, height=96, width=160)
    first = tmp_path / "first.safetensors"
    more = ["--held-out", folders[1], *SHORT, "--steps", "2"]
    train("fit", "semantic-fpn-small", "--frames", folders[0], *more, "--out", first)
    several = ["--frames", folders[0], "--frames", wide, "--frames", wide, "--start-from", first]
    outs = [tmp_path / "once" / "semantic-fpn-small.safetensors", tmp_path / "again" / "semantic-fpn-small.safetensors"]
    for out in outs:
        train("fit", "semantic-fpn-small", *several, *more, "--out", out)
    assert outs[0].read_bytes() == outs[1].read_bytes(), "the same command gives the same file"
    provenance = read_header(outs[0]).provenance
    assert provenance["frames"] == "8"
    assert provenance["frames-asset"] == "boxes"
    assert provenance["frames-street-seeds"] == "1000-1000; 1030-1030"
    assert provenance["frames-of-each-folder"] == "2; 3"
    assert provenance["frames-times-each-counts"] == "1; 2"
    digests = [hashlib.sha256((folder / "frames.json").read_bytes()).hexdigest() for folder in (folders[0], wide)]
    assert provenance["frames-digest-of-each-folder"] == "; ".join(digests)
    assert provenance["street-seeds-before"] == "1000-1000"
    assert provenance["trained-by"] == "valerie train fit"


def test_frames_that_are_kept_apart_from_training_are_refused_by_their_option(
    fit: list[str], folders: tuple[Path, Path], tmp_path: Path
) -> None:
    refused = refusal(*fit, "--frames", folders[1], "--out", tmp_path / "x.safetensors")
    assert str(refused) == (
        "--frames: sites that are kept apart from training, for runs and for held-out frames; got [900]; "
        "limit: site seeds 1000…99999"
    )
    refused = refusal("frames", tmp_path / "new", "--first-seed", "0")
    assert str(refused) == "--first-seed: no seed of train; got 0; limit: 1000…99999"


@pytest.mark.parametrize("size", ["960", "960x", "wide"])
def test_a_size_that_is_none_is_refused(tmp_path: Path, size: str) -> None:
    assert "--size: not a size" in str(refusal("frames", tmp_path / "new", "--size", size))


def test_a_size_out_of_bounds_is_refused_by_its_option(tmp_path: Path) -> None:
    assert str(refusal("frames", tmp_path / "new", "--size", "8x96")).startswith("--size: out of bounds; got 8")


def test_frames_into_a_full_folder_are_refused(folders: tuple[Path, Path]) -> None:
    assert "DIR: the folder is not empty" in str(refusal("frames", folders[0], "--sites", "1"))
