from __future__ import annotations

import numpy as np
import pytest

from valerie.measures import Source, names_from
from valerie.sensing.picture_levels import picture_levels


def test_levels_are_those_of_the_pixels_grey_values() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (31, 17, 3)).astype(np.uint8)
    picture[:4], picture[4:6, :, :] = 0, 255
    grey = picture.astype(float).mean(axis=2)
    levels = picture_levels(picture)
    assert set(levels) == set(names_from(Source.PICTURE))
    assert levels["picture_mean"] == pytest.approx(grey.mean())
    assert levels["picture_deviation"] == pytest.approx(grey.std())
    assert levels["black_share"] == pytest.approx((picture.max(axis=2) == 0).mean())
    assert levels["white_share"] == pytest.approx((picture.min(axis=2) == 255).mean())


def test_a_constant_picture_has_no_deviation() -> None:
    levels = picture_levels(np.full((8, 9, 3), 77, np.uint8))
    assert levels["picture_mean"] == pytest.approx(77)
    assert levels["picture_deviation"] == pytest.approx(0, abs=1e-9)
