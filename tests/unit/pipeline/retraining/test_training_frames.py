import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from tests.world.drawn import TOWN, installed_town
from valerie.errors import InvalidInput
from valerie.labels import PERSON
from valerie.perception.training.frame_folder import SEEDS
from valerie.pipeline.retraining.training_frames import FrameSettings, frames_of, render_training_frames
from valerie.testing.assets import simple_asset


def test_the_splits_share_no_site_and_leave_out_the_default_one() -> None:
    train, held_out = (set(SEEDS[split]) for split in ("train", "held-out"))
    assert train.isdisjoint(held_out)
    assert 0 not in train | held_out
    assert min(train) == 1000
    assert held_out == set(range(900, 1000))


def test_seeds_are_taken_from_the_front_of_the_split() -> None:
    assert list(FrameSettings(split="held-out", sites=3).seeds()) == [900, 901, 902]
    assert list(FrameSettings(sites=2).seeds()) == [1000, 1001]


def test_more_sites_than_seeds_are_refused() -> None:
    with pytest.raises(InvalidInput, match="sites"):
        FrameSettings(split="held-out", sites=101).seeds()


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("kept")
    with pytest.raises(InvalidInput, match="not empty"):
        render_training_frames(tmp_path, FrameSettings(sites=1))


@pytest.mark.gl
@pytest.mark.processes
@pytest.mark.timeout(300)
def test_a_killed_command_leaves_no_process_that_renders(tmp_path: Path) -> None:
    """Its folder belongs to the command that continues."""
    command = [sys.executable, "-m", "valerie", "train", "frames", str(tmp_path / "frames"), "--sites", "50"]
    with (
        installed_town(tmp_path / "packages"),
        subprocess.Popen(
            [*command, "--asset", TOWN],
            stdout=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path / "packages"), *sys.path])},
        ) as started,
    ):
        parent = psutil.Process(started.pid)
        rendering: list[psutil.Process] = []
        while not rendering:
            assert started.poll() is None
            time.sleep(0.1)
            children = parent.children()
            rendering = [child for child in children if "moderngl" in Path(f"/proc/{child.pid}/maps").read_text()]
        started.kill()
    gone, alive = psutil.wait_procs(rendering, timeout=30)
    assert gone
    assert not alive


@pytest.mark.gl
def test_frames_of_a_site_are_repeatable_and_labelled() -> None:
    settings = FrameSettings(per_site=6, width=160, height=96)
    one, other = (list(frames_of(simple_asset(), 1000, settings)) for _ in range(2))
    assert len(one) == 6
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.picture, b.picture)
        np.testing.assert_array_equal(a.train_ids, b.train_ids)
    labels = {int(label) for frame in one for label in np.unique(frame.train_ids)}
    assert PERSON.train_id in labels
    assert len(labels) >= 4


@pytest.mark.gl
def test_another_site_seed_draws_other_frames() -> None:
    settings = FrameSettings(per_site=1, width=160, height=96)
    one, other = (next(frames_of(simple_asset(), seed, settings)) for seed in (1000, 1001))
    assert not np.array_equal(one.picture, other.picture)


@pytest.mark.gl
def test_two_frames_after_each_other_show_one_background() -> None:
    peopled = 0
    for seed in range(1000, 1004):
        first, second, third = frames_of(simple_asset(), seed, FrameSettings(per_site=3, width=160, height=96))
        nobody = (first.train_ids != PERSON.train_id) & (second.train_ids != PERSON.train_id)
        np.testing.assert_array_equal(first.train_ids[nobody], second.train_ids[nobody])
        peopled += not nobody.all() and not np.array_equal(first.train_ids, second.train_ids)
        nobody = (first.train_ids != PERSON.train_id) & (third.train_ids != PERSON.train_id)
        assert (first.train_ids[nobody] != third.train_ids[nobody]).mean() > 0.01
    assert peopled
