import hashlib
from pathlib import Path

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.perception.training.frame_folder import FrameFolder, write_index, write_shard
from valerie.perception.training.provenance import sites_seen
from valerie.perception.training.training_set import TrainingSet, open_training_set


@pytest.fixture
def make_folder(tmp_path: Path, make_frames):
    """``make_folder(name, seed, count, **provenance)``: a folder with one site of the asset ``boxes``."""

    def make(name: str, seed: int, count: int, **provenance: str) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        shard = write_shard(folder, seed, make_frames(count, site_seed=seed))
        write_index(folder, [shard], {"street-seeds": f"{seed}-{seed}", "asset": "boxes", **provenance})
        return folder

    return make


def test_one_folder_keeps_its_digest_and_provenance(make_folder) -> None:
    folder = FrameFolder(make_folder("a", 1000, 2, renderer="raster"))
    frames = TrainingSet([folder])
    assert frames.digest == folder.digest
    assert frames.provenance() == folder.listing.provenance
    assert frames.site_seeds == {1000}
    assert len(frames[0:9]) == len(frames) == 2


def test_a_folder_that_is_listed_twice_counts_twice_in_any_order(make_folder) -> None:
    first, second = make_folder("a", 1000, 2), make_folder("b", 1001, 3)
    frames = open_training_set([first, second, first])
    assert [frame.site_seed for frame in frames] == [1000] * 4 + [1001] * 3
    np.testing.assert_array_equal(frames[0].picture, frames[2].picture)
    digests = [hashlib.sha256((folder / "frames.json").read_bytes()).hexdigest() for folder in (first, second)]
    expected = hashlib.sha256(f"2 {digests[0]}\n1 {digests[1]}\n".encode()).hexdigest()
    assert frames.digest == open_training_set([first, first, second]).digest == expected


def test_another_count_or_order_is_another_set(make_folder) -> None:
    a, b = make_folder("a", 1000, 1), make_folder("b", 1001, 1)
    assert len({open_training_set(folders).digest for folders in ([a], [a, a], [a, b], [b, a])}) == 4


def test_facts_that_folders_share_stand_once_and_others_for_each(make_folder) -> None:
    a = make_folder("a", 1000, 1, **{"frame-size": "960x540", "renderer": "raster"})
    b = make_folder("b", 1001, 1, **{"frame-size": "1920x1080", "renderer": "raster", "region": "far"})
    provenance = open_training_set([b, a]).provenance()
    assert provenance["renderer"] == "raster"
    assert provenance["frame-size"] == "1920x1080; 960x540"
    assert provenance["region"] == "far; unstated"
    assert provenance["times-each-counts"] == "1; 1"


def test_sites_of_runs_and_held_out_ones_are_not_learned_from(make_folder) -> None:
    allowed = make_folder("a", 1000, 1)
    for seed in (0, 900, 999, 100_000):
        with pytest.raises(InvalidInput, match=rf"kept apart.*\[{seed}\]"):
            open_training_set([allowed, make_folder(f"kept-{seed}", seed, 1)])


def test_sites_of_two_assets_are_not_one_training_set(make_folder) -> None:
    folders = [make_folder("a", 1000, 1), make_folder("b", 1001, 1, asset="another")]
    with pytest.raises(InvalidInput, match=r"different assets.*boxes in .*another in "):
        open_training_set(folders)


def test_no_folder_at_all_is_refused() -> None:
    with pytest.raises(InvalidInput, match="at least one folder"):
        open_training_set([])


def test_the_sites_that_a_network_saw_are_read_from_its_card() -> None:
    card = {"frames-street-seeds": "1000-1002; 1030-1031", "street-seeds-before": "1002-1004"}
    assert sites_seen(card) == (range(1000, 1003), range(1002, 1005), range(1030, 1032))
    assert sites_seen({}) == ()
