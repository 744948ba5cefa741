from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.errors import InferenceError
from valerie.perception.base import FunctionCard
from valerie.perception.running.batches import predicted

Picture = NDArray[np.uint8]


class Threshold:
    """Calls light pixels a person; keeps how many pictures it was given at once."""

    revision = 1
    numeric_class = "none"
    card = FunctionCard("threshold", "0" * 64, "none", "none", "none", {})

    def __init__(self, batch_size: int) -> None:
        self.batch_size = batch_size
        self.given: list[int] = []

    def predict(self, picture: Picture) -> Picture:
        return self.predict_many([picture])[0]

    def predict_many(self, pictures: Sequence[Picture]) -> list[Picture]:
        self.given.append(len(pictures))
        return [np.where(picture[..., 0] > 100, 11, 0).astype(np.uint8) for picture in pictures]

    def close(self) -> None: ...


def pictures(*heights: int) -> list[tuple[int, Picture]]:
    rng = np.random.default_rng(3)
    return [(n, rng.integers(0, 256, (height, 6, 3), np.uint8)) for n, height in enumerate(heights)]


@pytest.mark.parametrize(
    ("batch", "heights", "together"),
    [
        (1, (4, 4, 4), [1, 1, 1]),
        (3, (4, 4, 4, 4, 4), [3, 2]),
        (3, (4, 4, 5, 5, 5, 5, 4), [2, 3, 1, 1]),
        (8, (), []),
    ],
)
def test_pictures_of_one_size_go_together_and_come_back_in_order(
    batch: int, heights: tuple[int, ...], together: list[int]
) -> None:
    function, given = Threshold(batch), pictures(*heights)
    answers = list(predicted(function, given))
    assert function.given == together
    assert [owner for owner, _ in answers] == list(range(len(heights)))
    for (_, picture), (_, labels) in zip(given, answers, strict=True):
        np.testing.assert_array_equal(labels, np.where(picture[..., 0] > 100, 11, 0))


def test_no_more_pictures_are_read_ahead_than_the_function_takes() -> None:
    read = 0

    def counted() -> object:
        nonlocal read
        for picture in pictures(4, 4, 4, 4):
            read += 1
            yield picture

    next(predicted(Threshold(2), counted()))
    assert read == 2


def test_an_answer_of_another_size_names_the_function_and_both_sizes() -> None:
    class Cropping(Threshold):
        def predict(self, picture: Picture) -> Picture:
            return super().predict(picture)[1:]

    with pytest.raises(InferenceError, match=r"threshold returned labels of shape \(3, 6\) for a picture of \(4, 6\)"):
        list(predicted(Cropping(1), pictures(4)))
