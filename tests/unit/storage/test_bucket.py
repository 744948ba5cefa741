"""The store over a real S3 endpoint: moto's server as a process of its own."""

import urllib.request
from collections.abc import Iterator

import numpy as np
import pytest

from tests.world.bucket import s3_server
from valerie.errors import InvalidInput, NotFound, StorageUnavailable
from valerie.rendering.base import LinearImage
from valerie.storage import ArtifactStore, codecs, open_store
from valerie.storage.keys import product_key

pytestmark = pytest.mark.processes

KEY = product_key("layer", "0123456789abcdef0123456789abcdef")


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with s3_server(tmp_path_factory.mktemp("moto")) as url:
        yield url


@pytest.fixture
def store(endpoint: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> ArtifactStore:
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    create = urllib.request.Request(f"{endpoint}/valerie", method="PUT")
    urllib.request.urlopen(create, timeout=5).close()
    return open_store(f"s3://valerie/{request.node.name}", s3_endpoint=endpoint)


def test_what_was_put_is_got(store: ArtifactStore) -> None:
    assert store.put(KEY, b"content") is True
    assert store.get(KEY) == b"content"


def test_the_prefix_of_the_url_comes_before_every_key(store: ArtifactStore, endpoint: str) -> None:
    store.put(KEY, b"content")
    prefix = store.url.removeprefix("s3://valerie/")
    whole_bucket = open_store("s3://valerie", s3_endpoint=endpoint)
    assert whole_bucket.get(f"{prefix}/{KEY}") == b"content"


def test_the_first_writer_of_an_intact_product_wins(store: ArtifactStore) -> None:
    first, second = (codecs.encode_image(LinearImage(np.full((2, 2, 3), n, np.float16))) for n in (1, 2))
    store.put(KEY, first)
    assert store.put(KEY, second) is False
    assert store.get(KEY) == first


def test_a_large_object_survives(store: ArtifactStore) -> None:
    content = np.random.default_rng(0).bytes(12_000_000)
    store.put(KEY, content)
    assert store.get(KEY) == content


def test_a_runs_artifact_may_be_replaced_also_when_it_is_large(store: ArtifactStore) -> None:
    store.put("runs/a/table.parquet", b"first", replace=True)
    store.put("runs/a/table.parquet", b"x" * 12_000_000, replace=True)
    assert store.head("runs/a/table.parquet").size == 12_000_000


def test_a_range_is_part_of_the_object(store: ArtifactStore) -> None:
    store.put(KEY, b"0123456789")
    assert store.get_range(KEY, 3, 4) == b"3456"
    assert store.get_range(KEY, 8, 100) == b"89"
    with pytest.raises(InvalidInput, match="range"):
        store.get_range(KEY, 10, 1)


def test_a_missing_object_is_not_found_by_any_call(store: ArtifactStore) -> None:
    for call in (store.get, store.head):
        with pytest.raises(NotFound):
            call("runs/a/nothing")
    assert not store.exists("runs/a/nothing")


def test_deleted_objects_are_gone_and_deleting_twice_is_no_error(store: ArtifactStore) -> None:
    store.put(KEY, b"x")
    store.delete(KEY)
    store.delete(KEY)
    assert not store.exists(KEY)


def test_list_and_usage_see_what_is_below_a_prefix(store: ArtifactStore) -> None:
    for number in range(3):
        store.put(product_key("truth", f"{number:032x}"), b"12345")
    store.put("runs/a/report.html", b"1")
    assert sorted(info.key for info in store.list("products")) == sorted(
        product_key("truth", f"{number:032x}") for number in range(3)
    )
    assert sum(info.size for info in store.list()) == 16


def test_the_check_passes_and_leaves_nothing(store: ArtifactStore) -> None:
    store.check()
    assert not list(store.list())


def test_a_bucket_does_not_tell_its_free_space(store: ArtifactStore) -> None:
    assert store.free_bytes() is None


def test_a_bucket_that_is_not_there_is_unavailable_or_not_found_and_named(store: ArtifactStore, endpoint: str) -> None:
    absent = open_store("s3://absent/x", s3_endpoint=endpoint)
    with pytest.raises(StorageUnavailable, match="s3://absent/x"):
        absent.check()
    assert store.url  # the same endpoint serves the other bucket


def test_an_endpoint_that_does_not_answer_is_unavailable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    store = open_store("s3://valerie", s3_endpoint="http://127.0.0.1:9")  # the discard port: nobody listens
    with pytest.raises(StorageUnavailable, match="s3://valerie"):
        store.check()
