import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from valerie.errors import CorruptArtifact, InvalidInput, NotFound
from valerie.perception.training.frame_folder import INDEX_NAME, FrameFolder, TrainingFrame, write_index, write_shard


@pytest.fixture
def folder(tmp_path, make_frames):
    shards = [write_shard(tmp_path, seed, make_frames(3, site_seed=seed)) for seed in (1001, 1000)]
    write_index(tmp_path, shards, {"generator": "boxes"})
    return tmp_path


def test_frames_come_back_as_they_were_written_in_order_of_sites(folder, make_frames) -> None:
    stored = FrameFolder(folder)
    expected = [*make_frames(3, site_seed=1000), *make_frames(3, site_seed=1001)]
    assert len(stored) == 6
    for got, wanted in zip(stored, expected, strict=True):
        np.testing.assert_array_equal(got.picture, wanted.picture)
        np.testing.assert_array_equal(got.train_ids, wanted.train_ids)
        assert got.site_seed == wanted.site_seed


def test_frames_of_different_sizes_live_in_one_shard(tmp_path, make_frames) -> None:
    frames = [*make_frames(1), *make_frames(1, height=32, width=40)]
    write_index(tmp_path, [write_shard(tmp_path, 1000, frames)], {})
    assert [frame.train_ids.shape for frame in FrameFolder(tmp_path)] == [(64, 96), (32, 40)]


def test_a_folder_can_be_indexed_from_the_end_and_sliced(folder) -> None:
    stored = FrameFolder(folder)
    assert stored[-1].site_seed == 1001
    assert len(stored[1:3]) == 2
    with pytest.raises(IndexError):
        stored[6]


def test_the_seeds_are_known_without_reading_frames(folder) -> None:
    for shard in folder.glob("*.safetensors"):
        shard.unlink()
    assert FrameFolder(folder).site_seeds == {1000, 1001}


def test_the_digest_stands_for_the_pixels(tmp_path, make_frames) -> None:
    digests = []
    for name, count in (("a", 2), ("b", 2), ("c", 3)):
        place = tmp_path / name
        place.mkdir()
        write_index(place, [write_shard(place, 1000, make_frames(count))], {})
        digests.append(FrameFolder(place).digest)
    assert digests[0] == digests[1] != digests[2]


def test_an_intact_folder_verifies(folder) -> None:
    FrameFolder(folder).verify()


def test_a_changed_shard_is_detected(folder) -> None:
    path = folder / "site-001001.safetensors"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(CorruptArtifact, match="site-001001"):
        FrameFolder(folder).verify()


def test_a_cut_shard_is_reported_when_read(folder) -> None:
    path = folder / "site-001000.safetensors"
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(CorruptArtifact, match="site-001000"):
        FrameFolder(folder)[0]


def test_threads_may_read_at_once(folder) -> None:
    stored = FrameFolder(folder)
    with ThreadPoolExecutor(4) as pool:
        read = list(pool.map(stored.__getitem__, [0, 1, 2, 3, 4, 5] * 10))
    for number, frame in enumerate(read):
        np.testing.assert_array_equal(frame.picture, stored[number % 6].picture)


def test_an_unfinished_folder_is_no_folder_of_frames(folder) -> None:
    (folder / INDEX_NAME).unlink()
    with pytest.raises(NotFound, match="training frames"):
        FrameFolder(folder)


@pytest.mark.parametrize("file", ["../x.safetensors", "/etc/passwd", "a/b.safetensors"])
def test_an_index_that_leads_outside_the_folder_is_refused(folder, file: str) -> None:
    listing = json.loads((folder / INDEX_NAME).read_text())
    listing["shards"][0]["file"] = file
    (folder / INDEX_NAME).write_text(json.dumps(listing))
    with pytest.raises(InvalidInput, match="file"):
        FrameFolder(folder)


def test_a_frame_of_another_site_is_refused(tmp_path, make_frames) -> None:
    with pytest.raises(InvalidInput, match="another site"):
        write_shard(tmp_path, 1000, make_frames(1, site_seed=1001))


def test_maps_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InvalidInput, match="not a training frame"):
        TrainingFrame(np.zeros((4, 5, 3), np.uint8), np.zeros((4, 6), np.uint8), 0)
