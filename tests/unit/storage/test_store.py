"""The folder store: written once, never half, errors that say what to do."""

import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from valerie.errors import InvalidInput, NotFound, StorageUnavailable
from valerie.rendering.base import LinearImage
from valerie.storage import ArtifactStore, codecs, open_store
from valerie.storage.keys import product_key

DIGEST = "0123456789abcdef0123456789abcdef"
KEY = product_key("layer", DIGEST)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "artifacts"


@pytest.fixture
def store(folder: Path) -> ArtifactStore:
    return open_store(str(folder))


def _frame(value: float) -> bytes:
    return codecs.encode_image(LinearImage(np.full((2, 2, 3), value, np.float16)))


def test_what_was_put_is_got(store: ArtifactStore, folder: Path) -> None:
    assert store.put(KEY, b"content") is True
    assert store.get(KEY) == b"content"
    assert (folder / KEY).read_bytes() == b"content"


def test_a_file_url_opens_the_same_folder(store: ArtifactStore, folder: Path) -> None:
    store.put(KEY, b"content")
    assert open_store(f"file://{folder}").get(KEY) == b"content"


def test_the_first_writer_of_an_intact_product_wins(store: ArtifactStore) -> None:
    store.put(KEY, _frame(1))
    assert store.put(KEY, _frame(2)) is False
    assert store.get(KEY) == _frame(1)


def test_a_product_that_a_power_cut_left_broken_is_replaced(store: ArtifactStore) -> None:
    store.put(KEY, _frame(1)[:-3])
    assert store.put(KEY, _frame(1)) is True
    assert store.get(KEY) == _frame(1)


def test_a_runs_artifact_may_be_replaced(store: ArtifactStore) -> None:
    store.put("runs/a/report.html", b"first", replace=True)
    store.put("runs/a/report.html", b"second", replace=True)
    assert store.get("runs/a/report.html") == b"second"


def test_many_writers_of_one_key_leave_one_of_their_objects_whole(store: ArtifactStore, folder: Path) -> None:
    contents = [bytes([n]) * 200_000 for n in range(8)]
    results: list[bool] = []
    threads = [threading.Thread(target=lambda c=c: results.append(store.put("runs/a/b", c))) for c in contents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results.count(True) == 1
    assert store.get("runs/a/b") in contents
    assert [path.name for path in folder.rglob("*") if path.is_file()] == ["b"]


def test_a_missing_object_is_named(store: ArtifactStore) -> None:
    with pytest.raises(NotFound, match=DIGEST):
        store.get(KEY)


def test_exists_tells_what_is_there(store: ArtifactStore) -> None:
    assert not store.exists(KEY)
    store.put(KEY, b"x")
    assert store.exists(KEY)


def test_a_range_is_part_of_the_object(store: ArtifactStore) -> None:
    store.put(KEY, b"0123456789")
    assert store.get_range(KEY, 3, 4) == b"3456"
    assert store.get_range(KEY, 8, 100) == b"89"


@pytest.mark.parametrize(("start", "length"), [(10, 1), (-1, 3), (0, 0)])
def test_a_range_outside_the_object_is_refused(store: ArtifactStore, start: int, length: int) -> None:
    store.put(KEY, b"0123456789")
    with pytest.raises(InvalidInput, match="range"):
        store.get_range(KEY, start, length)


def test_the_tag_changes_with_the_content(store: ArtifactStore) -> None:
    store.put("runs/a/b", b"one", replace=True)
    first = store.head("runs/a/b")
    store.put("runs/a/b", b"three", replace=True)
    second = store.head("runs/a/b")
    assert (first.size, second.size) == (3, 5)
    assert first.etag != second.etag


def test_deleting_twice_is_no_error(store: ArtifactStore) -> None:
    store.put(KEY, b"x")
    store.delete(KEY)
    store.delete([KEY, "runs/a/b"])
    assert not store.exists(KEY)


def test_a_list_has_what_is_below_a_prefix(store: ArtifactStore) -> None:
    for number in range(3):
        store.put(product_key("truth", f"{number:032x}"), b"12345")
    store.put("runs/a/report.html", b"1")
    assert {info.key for info in store.list("products/truth")} == {
        product_key("truth", f"{number:032x}") for number in range(3)
    }
    assert [info.size for info in store.list("products")] == [5, 5, 5]
    assert len(list(store.list())) == 4
    assert not list(store.list("nothing"))


@pytest.mark.parametrize("key", ["../outside", "a/../../outside", "a//b"])
def test_a_key_cannot_leave_the_folder(store: ArtifactStore, folder: Path, key: str) -> None:
    with pytest.raises(InvalidInput, match="key"):
        store.put(key, b"x")
    assert not list(folder.parent.glob("outside*"))


def test_the_folder_tells_its_free_space(store: ArtifactStore, folder: Path) -> None:
    free = store.free_bytes()
    assert free is not None
    assert free == pytest.approx(shutil.disk_usage(folder).free, rel=0.05)


def test_the_check_leaves_nothing_behind(store: ArtifactStore, folder: Path) -> None:
    store.check()
    assert not list(folder.iterdir())


def test_a_folder_below_a_file_is_refused_with_its_name(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageUnavailable, match="file/artifacts"):
        open_store(str(tmp_path / "file" / "artifacts"))


@pytest.mark.parametrize("url", ["ftp://host/x", "file://host/x", "s3://", "s3:///prefix"])
def test_other_urls_are_refused(url: str) -> None:
    with pytest.raises(InvalidInput, match="VALERIE_ARTIFACTS_URL"):
        open_store(url)


def test_half_written_files_of_killed_writers_are_removed_when_they_are_old(store: ArtifactStore, folder: Path) -> None:
    store.put(KEY, b"x")
    old, young = (folder / KEY).with_name("a.zst#1"), (folder / KEY).with_name("b.zst#2")
    old.write_bytes(b"")
    young.write_bytes(b"")
    os.utime(old, (0, 0))
    assert store.remove_staging(before=store.now() - timedelta(hours=1)) == 1
    assert young.exists()
    assert store.exists(KEY)


_PROGRAM = """
import sys
from valerie.errors import ValerieError
from valerie.storage import open_store
try:
    store = open_store(sys.argv[1])
    store.put("runs/a/big", b"x" * 3_000_000)
    store.check()
except ValerieError as error:
    print(type(error).__name__, error)
"""


def _try_to_write(folder: Path, *wrapper: str) -> str:
    """Write and check as a process of its own that ``wrapper`` took something from; returns the error."""
    command = [*wrapper, sys.executable, "-c", _PROGRAM, str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_a_write_that_does_not_fit_is_storage_full_and_leaves_nothing(store: ArtifactStore, folder: Path) -> None:
    # A limit on file size fails in the same place as a full disk, and needs no rights.
    assert _try_to_write(folder, "prlimit", "--fsize=1000000").startswith("StorageFull")
    assert not store.exists("runs/a/big")


@pytest.fixture
def read_only(folder: Path) -> Iterator[Path]:
    folder.mkdir()
    folder.chmod(0o555)
    yield folder
    folder.chmod(0o755)


def test_a_folder_without_permission_is_unavailable_and_named(read_only: Path) -> None:
    # Root may write anywhere, unless the capability is given up first.
    without = ("setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override") if os.geteuid() == 0 else ()
    error = _try_to_write(read_only, *without)
    assert error.startswith("StorageUnavailable")
    assert "ermission denied" in error
    assert str(read_only) in error
