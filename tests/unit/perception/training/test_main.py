import hashlib
import json
import re
from pathlib import Path

import pytest

from valerie.perception.catalog import function_card
from valerie.perception.importing.function_file import read_header
from valerie.perception.training.__main__ import execute, main
from valerie.perception.training.frame_folder import write_index, write_shard


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


def test_several_folders_are_learned_from_as_one_and_the_card_says_which(
    folders: tuple[Path, Path], tmp_path: Path, make_frames
) -> None:
    wide = tmp_path / "wide"
    wide.mkdir()
    shard = write_shard(wide, 1030, make_frames(3, street_seed=1030, height=96, width=160))
    write_index(wide, [shard], {"street-seeds": "1030-1030", "asset": "boxes"})
    begun = tmp_path / "begun.safetensors"
    fit = ["--held-out", str(folders[1]), "--batch", "2", "--precision", "fp32", "--device", "cpu", "--steps", "2"]
    assert main(["fit", "semantic-fpn-small", "--frames", str(folders[0]), *fit, "--out", str(begun)]) == 0
    several = ["--frames", str(folders[0]), "--frames", str(wide), "--frames", str(wide), "--start-from", str(begun)]
    outs = [tmp_path / "once" / "semantic-fpn-small.safetensors", tmp_path / "again" / "semantic-fpn-small.safetensors"]
    for out in outs:
        execute(["fit", "semantic-fpn-small", *several, *fit, "--out", str(out)], program="valerie train")
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
    folders: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    fit = ["fit", "semantic-fpn-small", "--out", str(tmp_path / "x.safetensors"), "--held-out", str(folders[1])]
    assert main([*fit, "--frames", str(folders[0]), "--frames", str(folders[1])]) == 2
    assert capsys.readouterr().err == (
        "--frames: streets that are kept apart from training, for runs and for held-out frames; got [900]; "
        "limit: street seeds 1000…99999\n"
    )
    assert main(["frames", str(tmp_path / "new"), "--first-seed", "0"]) == 2
    assert capsys.readouterr().err == "--first-seed: no seed of train; got 0; limit: 1000…99999\n"


def test_frames_into_a_full_folder_is_wrong_input(folders: tuple[Path, Path], capsys) -> None:
    assert main(["frames", str(folders[0]), "--streets", "1"]) == 2
    assert "not empty" in capsys.readouterr().err
