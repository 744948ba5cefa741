import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from valerie.sensing.resampling import bilinear


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 5))
def test_values_between_pixels_are_those_of_scipy(height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.random((height, width, 3), np.float32)
    x, y = rng.uniform(-2, width + 1, 40), rng.uniform(-2, height + 1, 40)
    for channel in range(3):
        expected = map_coordinates(image[..., channel], [y, x], order=1, mode="nearest", output=np.float64)
        np.testing.assert_allclose(bilinear(image, x, y)[:, channel], expected, atol=1e-6)


def test_at_the_pixels_it_is_the_identity() -> None:
    image = np.random.default_rng(0).random((7, 5), np.float32)
    y, x = np.mgrid[:7, :5].astype(np.float64)
    np.testing.assert_array_equal(bilinear(image, x, y), image)
