"""Snowflakes in the image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valerie.rendering.base import Rectangle, View
from valerie.rendering.scene_reading import camera_of
from valerie.rendering.sky import sky_of
from valerie.rendering.snowfall import chance, falling, snowed_on
from valerie.testing.assets import simple_asset

WHOLE = Rectangle(0, 0, 320, 180)
FOCAL = 444.0


def test_a_part_of_the_image_has_the_flakes_of_the_whole() -> None:
    whole = falling(100.0, WHOLE, 180, FOCAL)
    part = falling(100.0, Rectangle(100, 30, 64, 48), 180, FOCAL)
    np.testing.assert_array_equal(part, whole[30:78, 100:164])


def test_more_snow_keeps_every_flake_and_adds_others() -> None:
    little, much = (falling(flakes, WHOLE, 180, FOCAL) for flakes in (50.0, 250.0))
    assert (much >= little).all()
    assert 0 < (little > 0.1).mean() < (much > 0.1).mean() < 0.5


def test_without_snowfall_the_image_is_unchanged() -> None:
    pixels = np.full((180, 320, 3), 0.2, np.float32)
    assert snowed_on(pixels, 0.0, np.ones(3), WHOLE, 180, FOCAL) is pixels


def test_flakes_hide_what_is_behind_them() -> None:
    light = np.array([1.0, 0.5, 0.25])
    pixels = snowed_on(np.full((180, 320, 3), 2.0, np.float32), 200.0, light, WHOLE, 180, FOCAL)
    share = falling(200.0, WHOLE, 180, FOCAL)[..., None]
    assert share.max() < 1
    np.testing.assert_allclose(pixels, 2.0 - share * (2.0 - light), rtol=1e-5)


def test_a_layer_of_cells_holds_as_many_flakes_as_the_air() -> None:
    # At a distance d, a cell is 63.2 mm / √d wide and high and d / 2 deep: 0.002 m³ anywhere.
    assert chance(250.0) == pytest.approx(250.0 * 0.0632**2 / 2)
    assert chance(250.0) <= 0.5


def test_a_longer_lens_enlarges_the_flakes() -> None:
    near = falling(150.0, WHOLE, 180, FOCAL)
    large = falling(150.0, Rectangle(0, 180, 640, 180), 360, 2 * FOCAL)
    # Both show the lower left corner. Smaller samples leave the edges sharper.
    reduced = large.reshape(90, 2, 320, 2).mean(axis=(1, 3))
    assert np.corrcoef(reduced.ravel(), near[90:].ravel())[0, 1] > 0.95


@pytest.mark.gl
def test_the_flakes_are_those_of_the_raster_engine() -> None:
    from valerie.rendering.raster.renderer import RasterRenderer

    base = simple_asset().base
    scene = replace(base, environment=replace(base.environment, snowfall=4.0, cloud_cover=1.0), nodes={})
    view = View("camera-1", 320, 180)
    engine = RasterRenderer()
    # The sky alone: what it changes towards the light of the flakes is their share.
    snowy = engine.background(scene, view).pixels.astype(np.float64)[:60]
    engine.close()
    sky = sky_of(scene)
    focal = camera_of(scene, view).focal_length_px(view.width)
    share = falling(sky.flakes, WHOLE, view.height, focal).astype(np.float64)[:60]

    def fine(image: np.ndarray) -> np.ndarray:
        return (image - np.median(image, axis=1, keepdims=True)).ravel()

    towards = np.sign(sky.haze[1] - np.median(snowy[..., 1]))
    # As for rain: flakes explain four fifths of the variance, and flakes elsewhere a hundredth.
    assert np.corrcoef(fine(share), towards * fine(snowy[..., 1]))[0, 1] > 0.9
    assert abs(np.corrcoef(fine(share[::-1]), fine(snowy[..., 1]))[0, 1]) < 0.1
