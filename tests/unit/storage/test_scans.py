"""A scan comes back from the store as it was."""

from dataclasses import fields, replace

import numpy as np
import pytest

from valerie.errors import CorruptArtifact
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.annotations.scan import Scan
from valerie.storage.annotation_codecs import decode_scan, encode_annotation

SCAN = Scan(
    rectangle=np.array([2, 1, 3, 2]),
    pixels=np.full((2, 3, 3), 0.5, np.float16),
    class_map=np.full((2, 3), 24, np.uint8),
    instance_map=np.full((2, 3), 24001, np.uint16),
    depth=np.full((2, 3), np.inf, np.float32),
    vectors=np.zeros((0, 0, 2), np.float32),
    instances=np.array([24001, 24002]),
    boxes=np.array([[2, 1, 3, 2], [0, 0, 0, 0]]),
    padded_pixels=np.array([9, 4]),
    masks=np.array([1, 0, 1, 1, 1, 0], np.uint8),
    size=np.array([4, 8]),
)


def test_a_scan_comes_back_as_it_was() -> None:
    again = decode_scan(encode_annotation(AnnotationKind.SCAN, SCAN))
    for field in fields(Scan):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(SCAN, field.name))
    assert [person.padded_pixels for person in again.persons] == [9, 4]
    assert np.count_nonzero(again.persons[0].amodal) == 4


@pytest.mark.parametrize(
    "forged",
    [
        {"rectangle": np.array([6, 1, 3, 2])},
        {"depth": np.zeros((3, 2), np.float32)},
        {"masks": np.zeros(5, np.uint8)},
        {"boxes": np.array([[2, 1, 3, 9], [0, 0, 0, 0]])},
    ],
    ids=lambda forged: next(iter(forged)),
)
def test_a_scan_whose_arrays_do_not_fit_is_refused(forged: dict[str, np.ndarray]) -> None:
    with pytest.raises(CorruptArtifact, match="scan"):
        decode_scan(encode_annotation(AnnotationKind.SCAN, replace(SCAN, **forged)))
