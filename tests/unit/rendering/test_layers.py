"""Parts of a frame are cut from its layer and background."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.rendering.base import Layer, LinearImage, Rectangle

HEIGHT, WIDTH = 18, 31


@pytest.mark.parametrize("rectangle", [Rectangle(4, 3, 9, 7), Rectangle(0, 0, WIDTH, HEIGHT), Rectangle(0, 0, 0, 0)])
def test_a_part_of_a_frame_is_that_part_of_the_whole(rectangle: Rectangle) -> None:
    generator = np.random.default_rng(3)
    background = LinearImage(generator.random((HEIGHT, WIDTH, 3)).astype(np.float16))
    layer = Layer(rectangle, 2 + generator.random((rectangle.height, rectangle.width, 3)).astype(np.float16))
    whole = layer.over(background).pixels
    expected = background.pixels.copy()
    expected[rectangle.slices] = layer.pixels
    assert np.array_equal(whole, expected)
    for _ in range(200):
        (top, bottom), (left, right) = (np.sort(generator.integers(0, size + 4, 2)) for size in (HEIGHT, WIDTH))
        window = (slice(top, bottom, generator.integers(1, 5)), slice(left, right, generator.integers(1, 5)))
        assert np.array_equal(layer.over(background, window).pixels, whole[window])
