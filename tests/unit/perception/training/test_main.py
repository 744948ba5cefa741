import json
import re
from pathlib import Path

import pytest

from valerie.perception.catalog import function_card
from valerie.perception.function_file import read_header
from valerie.perception.training.__main__ import execute, main
from valerie.perception.training.frames import write_index, write_shard


@pytest.fixture
def folders(tmp_path: Path, make_frames) -> tuple[Path, Path]:
    made = []
    for name, seed in (("train", 1000), ("held-out", 900)):
        folder = tmp_path / name
        folder.mkdir()
        shard = write_shard(folder, seed, make_frames(2, street_seed=seed))
        write_index(folder, [shard], {"street-seeds": f"{seed}-{seed}", "asset": "boxes"})
        made.append(folder)
    return made[0], made[1]


def test_fit_writes_a_function_with_its_provenance(folders: tuple[Path, Path], tmp_path: Path, capsys) -> None:
    out = tmp_path / "out" / "semantic-fpn-small.safetensors"
    arguments = ["fit", "semantic-fpn-small", "--frames", str(folders[0]), "--held-out", str(folders[1])]
    arguments += ["--out", str(out), "--steps", "1", "--batch", "2", "--precision", "fp32", "--device", "cpu"]
    arguments += ["--weaknesses", "people far away"]
    assert main(arguments) == 0
    card = function_card("semantic-fpn-small", folder=out.parent)
    assert card.provenance["frames-street-seeds"] == "1000-1000"
    assert card.provenance["held-out-street-seeds"] == "900-900"
    assert card.provenance["licence"] == "Apache-2.0"
    assert card.provenance["steps"] == "1"
    assert card.provenance["known-weaknesses"] == "people far away"
    assert "held-out-person-iou" in card.provenance
    assert "after 1 steps" in capsys.readouterr().out
    assert out.with_suffix(".curve.png").stat().st_size > 1000


def test_scales_of_samples_are_numbers_with_commas(folders: tuple[Path, Path], tmp_path: Path, capsys) -> None:
    out = tmp_path / "a.safetensors"
    arguments = ["fit", "semantic-fpn-small", "--frames", str(folders[0]), "--held-out", str(folders[1])]
    arguments += ["--out", str(out), "--steps", "1", "--batch", "2", "--precision", "fp32", "--device", "cpu"]
    assert main([*arguments, "--scales", "1,0.75"]) == 0
    used = json.loads(read_header(out).provenance["training-settings"])
    assert used["crops"]["scales"] == [1.0, 0.75]
    assert main([*arguments, "--scales", "1,-2"]) == 2
    assert capsys.readouterr().err == "--scales: out of bounds; got -2.0; limit: > 0.0\n"


def test_a_missing_folder_is_said_in_one_line(tmp_path: Path, capsys) -> None:
    arguments = ["fit", "semantic-fpn-small", "--frames", str(tmp_path), "--held-out", str(tmp_path), "--out", "x"]
    assert main(arguments) == 1
    assert "training frames" in capsys.readouterr().err


def test_a_wrong_setting_is_wrong_input(folders: tuple[Path, Path], capsys) -> None:
    arguments = ["fit", "semantic-fpn-small", "--frames", str(folders[0]), "--held-out", str(folders[1])]
    assert main([*arguments, "--out", "x", "--steps", "0", "--device", "cdua", "--time-budget", "-1"]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "--steps: out of bounds; got 0; limit: >= 1",
        "--time-budget: out of bounds; got -1.0; limit: > 0.0",
        "--device: unknown value 'cdua'; did you mean cuda, cpu?",
    ]


@pytest.mark.parametrize("command", ["frames", "fit"])
def test_the_help_names_the_command_that_was_called_and_explains_every_option(command: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        execute([command, "--help"], program="valerie train")
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: valerie train {command} ")
    described = re.findall(r"^  (?:-h, )?--[a-z-]+(?: [^ ]+)?(?:  +|\n {20,})\S", text, re.MULTILINE)
    assert len(described) == len(re.findall(r"^  (?:-h, )?--[a-z-]+", text, re.MULTILINE)) > 5


def test_frames_into_a_full_folder_is_wrong_input(folders: tuple[Path, Path], capsys) -> None:
    assert main(["frames", str(folders[0]), "--streets", "1"]) == 2
    assert "not empty" in capsys.readouterr().err
