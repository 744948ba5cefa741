"""Contract of perception functions: subclass `PerceptionContract`, override its fixture ``function``, and run it with pytest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.labels import NUM_TRAIN_CLASSES, VOID
from valerie.perception.base import BatchFunction, PerceptionFunction


class PerceptionContract:
    """Tests of a function. The name of a subclass starts with ``Test``, so that pytest collects it."""

    @pytest.fixture
    def function(self) -> Iterator[PerceptionFunction]:
        """Return the loaded function under test. The subclass must override this and close the function after the tests."""
        raise NotImplementedError("override the fixture 'function' in the subclass")

    @pytest.fixture
    def picture(self) -> NDArray[np.uint8]:
        """Return a picture, (90, 150, 3) uint8, of gradients and coloured boxes. No network's stride divides its size."""
        rows, columns = np.mgrid[0:90, 0:150]
        picture = np.stack([rows * 2, columns, 255 - rows - columns // 2], axis=2).clip(0, 255).astype(np.uint8)
        picture[30:70, 40:60] = (220, 210, 30)
        picture[20:80, 100:112] = (15, 15, 20)
        return picture

    @pytest.mark.parametrize(("height", "width"), [(1, 1), (31, 33), (64, 96), (90, 150), (135, 240)])
    def test_the_label_map_has_the_size_of_the_picture(
        self, function: PerceptionFunction, height: int, width: int
    ) -> None:
        labels = function.predict(np.full((height, width, 3), 127, np.uint8))
        assert labels.shape == (height, width)
        assert labels.dtype == np.uint8

    def test_only_declared_train_ids_are_predicted(
        self, function: PerceptionFunction, picture: NDArray[np.uint8]
    ) -> None:
        assert set(np.unique(function.predict(picture))) <= {*range(NUM_TRAIN_CLASSES), VOID}

    def test_the_same_picture_gives_the_same_labels(
        self, function: PerceptionFunction, picture: NDArray[np.uint8]
    ) -> None:
        first = function.predict(picture)
        function.predict(picture[::-1])
        np.testing.assert_array_equal(function.predict(picture), first)

    def test_the_picture_is_not_changed(self, function: PerceptionFunction, picture: NDArray[np.uint8]) -> None:
        copy = picture.copy()
        function.predict(copy)
        np.testing.assert_array_equal(copy, picture)

    def test_a_read_only_picture_is_accepted(self, function: PerceptionFunction, picture: NDArray[np.uint8]) -> None:
        frozen = picture.copy()
        frozen.setflags(write=False)
        np.testing.assert_array_equal(function.predict(frozen), function.predict(picture))

    def test_a_strided_picture_gives_the_labels_of_its_copy(
        self, function: PerceptionFunction, picture: NDArray[np.uint8]
    ) -> None:
        view = picture[:, ::-1]
        np.testing.assert_array_equal(function.predict(view), function.predict(view.copy()))

    def test_a_result_is_not_overwritten_by_the_next_one(
        self, function: PerceptionFunction, picture: NDArray[np.uint8]
    ) -> None:
        first = function.predict(picture)
        copy = first.copy()
        function.predict(255 - picture)
        np.testing.assert_array_equal(first, copy)

    def test_pictures_of_a_batch_get_the_labels_that_they_get_alone(
        self, function: PerceptionFunction, picture: NDArray[np.uint8]
    ) -> None:
        if not isinstance(function, BatchFunction):
            return  # it takes one picture at a time
        pictures = [picture, 255 - picture, picture[::-1], np.roll(picture, 40, axis=1), picture[:, ::-1]]
        together = function.predict_many(pictures)
        assert len(together) == len(pictures)
        for alone, labels in zip(pictures, together, strict=True):
            np.testing.assert_array_equal(labels, function.predict(alone))

    def test_the_card_and_the_numeric_class_say_what_runs(self, function: PerceptionFunction) -> None:
        card = function.card
        assert card.name
        assert card.architecture
        assert len(card.digest) in (32, 64)
        assert int(card.digest, 16) >= 0
        assert function.revision >= 1
        assert card.engine in function.numeric_class
        # The precision of a function on another machine is not known here.
        assert card.precision == "remote" or card.precision in function.numeric_class
