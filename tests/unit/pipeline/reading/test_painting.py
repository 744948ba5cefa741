"""The difference of two pictures."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.pipeline.reading.painting import brightened_difference


def test_a_difference_is_absolute_and_brightened_until_its_largest_value_is_white() -> None:
    first, second = np.full((2, 20, 20, 3), 100, np.uint8)
    second[:10] = 90
    second[10:15] = 105
    pixels, gain = brightened_difference(first, second)
    assert gain == pytest.approx(25.5)
    assert {tuple(np.unique(part)) for part in (pixels[:10], pixels[10:15], pixels[15:])} == {(255,), (128,), (0,)}


def test_equal_pictures_have_a_black_difference() -> None:
    picture = np.full((2, 2, 3), 7, np.uint8)
    pixels, gain = brightened_difference(picture, picture)
    assert not pixels.any()
    assert gain == 1
