"""A network that knows one answer per colour: whatever happens to the frame on the way, its labels must come back exactly."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.perception.documents.function import InputDocument
from valerie.perception.running.adaptation import Adaptation, Size, plan

SIZES = [(1, 1), (7, 90), (64, 64), (65, 64), (100, 203)]
OUTSIDE = 200


def scene(height: int, width: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A picture whose red channel is the label of each pixel, and the labels."""
    labels = np.random.default_rng(height * width).integers(0, 19, (height, width), dtype=np.uint8)
    return np.stack([labels, 255 - labels, labels // 2], axis=2), labels


def through(steps: Adaptation, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    pieces = steps.pieces(picture)
    assert {piece.shape for piece in pieces} == {(*steps.piece, 3)}
    return steps.joined([piece[..., 0] for piece in pieces])


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    "document",
    [
        {},
        {"multiple_of": 32},
        {"size": (203, 100)},
        {"size": (32, 16), "mode": "tile"},
        {"size": (64, 64), "mode": "tile", "overlap": 20},
        {"size": (33, 50), "mode": "tile", "overlap": 32},
        {"size": (300, 300), "mode": "tile", "overlap": 7},
    ],
)
def test_a_known_label_map_comes_back_exactly(size: tuple[int, int], document: dict[str, Any]) -> None:
    picture, labels = scene(*size)
    np.testing.assert_array_equal(through(plan(InputDocument(**document), *size), picture), labels)


@pytest.mark.parametrize("document", [{"multiple_of": 32}, {"size": (64, 48), "mode": "tile", "overlap": 9}])
def test_labels_of_padding_never_leak_into_the_frame(document: dict[str, Any]) -> None:
    steps = plan(InputDocument(**document), 37, 50)
    answer = np.full(steps.piece, OUTSIDE, np.uint8)
    answer[:37, :50] = 1
    assert (steps.joined([answer]) == 1).all()


def test_padding_repeats_the_last_row_and_column() -> None:
    picture, _ = scene(5, 6)
    (piece,) = plan(InputDocument(multiple_of=8), 5, 6).pieces(picture)
    np.testing.assert_array_equal(piece[5:, :6], np.repeat(picture[4:5], 3, axis=0))
    np.testing.assert_array_equal(piece[:5, 6:], np.repeat(picture[:, 5:6], 2, axis=1))


def test_a_frame_that_fits_is_not_copied() -> None:
    picture, _ = scene(64, 32)
    (piece,) = plan(InputDocument(multiple_of=32), 64, 32).pieces(picture)
    assert np.shares_memory(piece, picture)


def test_a_pixel_takes_its_label_from_the_tile_in_which_it_lies_farthest_from_an_edge() -> None:
    height, width, tile, overlap = 90, 130, 48, 16
    steps = plan(InputDocument(size=(tile, tile), mode="tile", overlap=overlap), height, width)
    rows, columns = np.mgrid[0:tile, 0:tile]
    # Each tile answers with how far from its nearest edge a pixel is; the frame's own edges are no loss.
    answers = []
    for row in steps.rows:
        for column in steps.columns:
            up = rows if row.start else np.full_like(rows, tile)
            down = tile - 1 - rows if row.start + tile < height else np.full_like(rows, tile)
            left = columns if column.start else np.full_like(rows, tile)
            right = tile - 1 - columns if column.start + tile < width else np.full_like(rows, tile)
            answers.append(np.minimum.reduce([up, down, left, right]).astype(np.uint8))
    assert steps.joined(answers).min() >= overlap // 2 - 1


@given(length=st.integers(1, 500), tile=st.integers(1, 200), overlap=st.integers(0, 199))
def test_tiles_cover_every_pixel_once_and_keep_the_overlap(length: int, tile: int, overlap: int) -> None:
    overlap = min(overlap, tile - 1)
    spans = plan(InputDocument(size=(tile, tile), mode="tile", overlap=overlap), 1, length).columns
    assert [span.first for span in spans] == [0, *(span.end for span in spans[:-1])]
    assert spans[-1].end == length
    for span in spans:
        assert span.start <= span.first < span.end <= max(span.start + tile, length if length <= tile else 0)
    for before, after in pairwise(spans):
        assert before.start + tile - after.start >= overlap
    assert spans[-1].start + tile <= max(length, tile)


def test_a_resized_frame_gets_its_labels_at_its_own_resolution() -> None:
    steps = plan(InputDocument(size=(64, 32), mode="resize"), 90, 150)
    assert (steps.piece, steps.labels) == (Size(32, 64), Size(90, 150))


def test_shrinking_takes_means_and_growing_keeps_flat_colours() -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[:, 2:] = 100
    (small,) = plan(InputDocument(size=(2, 2), mode="resize"), 4, 4).pieces(picture)
    assert small[..., 0].tolist() == [[0, 100], [0, 100]]
    (large,) = plan(InputDocument(size=(9, 9), mode="resize"), 4, 4).pieces(np.full((4, 4, 3), 77, np.uint8))
    assert (large == 77).all()


def test_a_frame_of_the_networks_size_is_resized_to_itself() -> None:
    picture, labels = scene(32, 64)
    steps = plan(InputDocument(size=(64, 32), mode="resize"), 32, 64)
    np.testing.assert_array_equal(through(steps, picture), labels)


def test_a_frame_too_large_for_padding_is_refused_with_both_sizes() -> None:
    with pytest.raises(InvalidInput, match=r"resize or tile; got 150 × 90; limit: 64 × 128"):
        plan(InputDocument(size=(64, 128)), 90, 150)


@pytest.mark.parametrize(
    ("frame", "piece"),
    [
        ((1080, 1920), (544, 960)),
        ((1920, 1080), (960, 544)),
        ((540, 960), (544, 960)),  # short enough: padded, as without
        ((544, 961), (544, 960)),
        ((40, 3840), (32, 960)),
    ],
)
def test_frames_above_the_longest_side_are_reduced_to_it(frame: tuple[int, int], piece: tuple[int, int]) -> None:
    adaptation = plan(InputDocument(multiple_of=32, longest_side=960), *frame)
    assert adaptation.piece == piece
    assert adaptation.labels == (piece if max(frame) <= 960 else frame)
    (given,) = adaptation.pieces(np.zeros((*frame, 3), np.uint8))
    assert given.shape == (*piece, 3)
    assert adaptation.joined([np.zeros(adaptation.labels, np.uint8)]).shape == frame


def test_a_longest_side_is_never_exceeded_by_rounding() -> None:
    assert plan(InputDocument(multiple_of=32, longest_side=100), 1000, 1000).piece == (96, 96)


def test_a_reduced_frame_is_the_mean_of_areas_and_its_labels_keep_their_places() -> None:
    picture = np.zeros((64, 128, 3), np.uint8)
    picture[:32, :64] = 200
    adaptation = plan(InputDocument(multiple_of=8, longest_side=32), 64, 128)
    (small,) = adaptation.pieces(picture)
    expected = np.zeros((16, 32, 3), np.uint8)
    expected[:8, :16] = 200
    np.testing.assert_array_equal(small, expected)


@pytest.mark.parametrize(
    "given", [{"size": (64, 32), "mode": "resize"}, {"size": (64, 32), "mode": "tile"}, {"multiple_of": 64}]
)
def test_a_longest_side_belongs_to_frames_of_their_own_size(given: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="longest_side"):
        InputDocument.model_validate({"longest_side": 32, **given})
