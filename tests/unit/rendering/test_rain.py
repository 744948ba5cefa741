from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valerie.rendering.base import Rectangle, View
from valerie.rendering.rain import OPACITY, rained_on, streaks
from valerie.rendering.sky import sky_of
from valerie.testing.assets import simple_asset

WHOLE = Rectangle(0, 0, 320, 180)


def test_a_part_of_the_image_has_the_streaks_of_the_whole() -> None:
    whole = streaks(0.2, WHOLE, 180)
    part = streaks(0.2, Rectangle(100, 30, 64, 48), 180)
    np.testing.assert_array_equal(part, whole[30:78, 100:164])


def test_more_rain_keeps_every_streak_and_adds_others() -> None:
    little, much = streaks(0.05, WHOLE, 180), streaks(0.3, WHOLE, 180)
    assert (much >= little).all()
    # Streaks cross at most the share of the image that is stated.
    assert 0 < (little > 0.1).mean() < (much > 0.1).mean() < 0.3


def test_without_rain_the_image_is_unchanged() -> None:
    pixels = np.full((180, 320, 3), 0.2, np.float32)
    assert rained_on(pixels, 0.0, np.ones(3), WHOLE, 180) is pixels


def test_a_streak_blends_in_the_light_of_the_drop_by_its_opacity() -> None:
    light = np.array([1.0, 0.5, 0.25])
    pixels = rained_on(np.zeros((180, 320, 3), np.float32), 0.3, light, WHOLE, 180)
    share = streaks(0.3, WHOLE, 180)
    np.testing.assert_allclose(pixels, OPACITY * share[..., None] * light, rtol=1e-5)


@pytest.mark.gl
def test_the_streaks_are_those_of_the_raster_engine() -> None:
    from valerie.rendering.raster.renderer import RasterRenderer

    base = simple_asset().base
    scene = replace(base, environment=replace(base.environment, rain=9.0, cloud_cover=1.0))
    view = View("camera-1", 320, 180)
    sky = sky_of(scene)
    engine = RasterRenderer()
    wet = engine.background(scene, view).pixels.astype(np.float64)
    engine.close()
    share = OPACITY * streaks(sky.drops, WHOLE, 180).astype(np.float64)

    def fine(image: np.ndarray) -> np.ndarray:
        """Return the fine detail of a wall, the differences from the pixels to the left and right."""
        return (image - (np.roll(image, 3, axis=1) + np.roll(image, -3, axis=1)) / 2)[5:80, 5:60].ravel()

    brighter = fine(wet[..., 1])
    # Streaks explain four fifths of the variance, √0.8 = 0.9; the rest is the wall's own. Streaks elsewhere explain a hundredth.
    # Both are requirements of ours.
    assert np.corrcoef(fine(share), brighter)[0, 1] > 0.9
    assert abs(np.corrcoef(fine(share[::-1]), brighter)[0, 1]) < 0.1
