import io

import numpy as np
import pytest
from PIL import Image

from valerie.sensing.jpeg import through_jpeg


@pytest.mark.parametrize("quality", [1, 50, 95])
def test_the_picture_is_the_one_that_pillow_reads_back(quality: int, linear: np.ndarray) -> None:
    picture = (np.clip(linear, 0, 1) * 255).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=quality)
    np.testing.assert_array_equal(through_jpeg(picture, quality), np.asarray(Image.open(file)))


def test_higher_quality_is_nearer_to_the_original() -> None:
    rng = np.random.default_rng(0)
    picture = np.kron(rng.integers(0, 256, (12, 16, 3)), np.ones((5, 5, 1))).astype(np.uint8)
    errors = [np.abs(through_jpeg(picture, q).astype(int) - picture).mean() for q in (5, 30, 60, 95)]
    assert errors == sorted(errors, reverse=True)
