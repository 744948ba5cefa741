import pytest

from valerie.errors import CorruptArtifact, InvalidInput, NotFound
from valerie.perception.running.opening import open_function
from valerie.perception.shipped import file_document, load_function


def test_a_shipped_function_is_known_by_the_digest_of_its_file(write_function) -> None:
    path = write_function("semantic-fpn-small")
    document = file_document("semantic-fpn-small", path)
    assert load_function("semantic-fpn-small", folder=path.parent).card.digest == document.payload.sha256


def test_any_other_function_is_known_by_the_digest_of_its_document(write_function) -> None:
    path = write_function()
    document = file_document("mine", path)
    assert open_function(document, path).card.digest == document.digest


def test_a_payload_that_is_another_file_is_refused(write_function) -> None:
    path = write_function()
    document = file_document("mine", path)
    path.write_bytes(path.read_bytes() + b" ")
    with pytest.raises(CorruptArtifact, match="mine needs"):
        open_function(document, path)


def test_a_missing_payload_is_named(write_function, tmp_path) -> None:
    document = file_document("mine", write_function())
    with pytest.raises(NotFound, match="gone"):
        open_function(document, tmp_path / "gone")


def test_no_threads_at_all_are_refused(write_function) -> None:
    path = write_function()
    with pytest.raises(InvalidInput, match="threads"):
        open_function(file_document("mine", path), path, threads=0)
