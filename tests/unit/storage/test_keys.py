"""Object keys."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.errors import InvalidInput
from valerie.storage.keys import parse_product_key, product_key, run_key

DIGEST = "0123456789abcdef0123456789abcdef"
digests = st.text("0123456789abcdef", min_size=32, max_size=32)


def test_a_product_is_sharded_by_the_first_two_characters_of_its_digest() -> None:
    assert product_key("layer", DIGEST) == f"products/layer/01/{DIGEST}.zst"


@given(kind=st.sampled_from(["background", "layer", "truth", "prediction"]), digest=digests)
def test_a_product_key_is_read_back_as_what_it_was_made_of(kind: str, digest: str) -> None:
    assert parse_product_key(product_key(kind, digest)) == (kind, digest)


@pytest.mark.parametrize(
    "key",
    [
        f"products/layer/02/{DIGEST}.zst",  # wrong shard
        f"products/layer/01/{DIGEST}",
        f"products/layer/{DIGEST}.zst",
        f"products/La yer/01/{DIGEST}.zst",
        "runs/a/report.html",
        "",
    ],
)
def test_other_keys_are_no_product_keys(key: str) -> None:
    assert parse_product_key(key) is None


@pytest.mark.parametrize("digest", ["", "abc", DIGEST.upper(), DIGEST + "0", "../" + DIGEST[3:], DIGEST[:-1] + "\n"])
def test_what_is_no_digest_is_refused(digest: str) -> None:
    with pytest.raises(InvalidInput, match="digest"):
        product_key("layer", digest)


@pytest.mark.parametrize("kind", ["", "../x", "Layer", "layer/x"])
def test_what_is_no_kind_is_refused(kind: str) -> None:
    with pytest.raises(InvalidInput, match="kind"):
        product_key(kind, DIGEST)


def test_a_runs_artifact_lies_below_the_run() -> None:
    assert run_key("0192-ab", "report.html") == "runs/0192-ab/report.html"


@pytest.mark.parametrize(
    ("run", "name"), [("..", "a"), ("a/b", "c"), ("", "c"), ("a", ".."), ("a", ".x"), ("a", "b/c")]
)
def test_a_runs_key_cannot_leave_its_folder(run: str, name: str) -> None:
    with pytest.raises(InvalidInput):
        run_key(run, name)
