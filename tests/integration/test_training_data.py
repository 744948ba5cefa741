"""Frames through the command, in a process of their own, and a network fitted to them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.plugin_package import write_boxes
from valerie.cli.main import app
from valerie.labels import PERSON
from valerie.perception.shipped import function_card
from valerie.perception.training.frame_folder import FrameFolder, write_index


def train(*arguments: str) -> str:
    return CliRunner().invoke(app, ["train", *arguments], catch_exceptions=False).output


@pytest.mark.gl
@pytest.mark.processes
def test_a_site_is_rendered_and_learned_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(
        "PYTHONPATH", str(write_boxes(tmp_path / "packages")), prepend=":"
    )  # for the processes that render
    monkeypatch.syspath_prepend(str(tmp_path / "packages"))
    monkeypatch.setenv("VALERIE_PLUGINS", "box-assets")
    folder = tmp_path / "train"
    small = ["--asset", "boxes", "--sites", "1", "--per-site", "4", "--size", "160x96", "--first-seed", "1030"]
    assert "4 frames" in train("frames", str(folder), *small)
    frames = FrameFolder(folder)
    frames.verify()
    assert frames.site_seeds == {1030}
    assert frames.listing.provenance["street-seeds"] == "1030-1030"
    assert any((frame.train_ids == PERSON.train_id).any() for frame in frames)
    assert all(frame.picture.std() > 5 for frame in frames)

    held_out = tmp_path / "held-out"  # the same pictures under another seed: only the way is tested here
    held_out.mkdir()
    shard = frames.listing.shards[0].model_copy(update={"site_seed": 900})
    (held_out / shard.file).write_bytes((folder / shard.file).read_bytes())
    write_index(held_out, [shard], {"street-seeds": "900-900"})
    out = tmp_path / "semantic-fpn-small.safetensors"
    arguments = ["fit", "semantic-fpn-small", "--frames", str(folder), "--held-out", str(held_out), "--out", str(out)]
    train(*arguments, "--steps", "2", "--batch", "2", "--precision", "fp32", "--device", "cpu")
    provenance = function_card("semantic-fpn-small", folder=tmp_path).provenance
    assert provenance["frames-digest"] == frames.digest
    assert provenance["frames-asset"] == "boxes"
    assert json.loads(provenance["training-settings"])["steps"] == 2
