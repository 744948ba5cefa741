"""Weather in the raster engine: what each parameter changes, and what it must not."""

from dataclasses import replace

import numpy as np
import pytest

from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.raster.tiles import widened
from valerie.rendering.sky import sky_of
from valerie.scene.model import Environment, Scene
from valerie.testing.assets import simple_asset
from valerie.testing.rendering import assert_same

pytestmark = pytest.mark.gl

VIEW = View("camera-1", 160, 90)
WEATHERS = ({"cloud_cover": 0.6}, {"cloud_cover": 1.0}, {"visibility": 60.0}, {"rain": 6.0, "cloud_cover": 0.9})


def in_weather(**environment: float) -> Scene:
    base = simple_asset().base
    return replace(base, environment=replace(base.environment, **environment))


def picture(raster: RasterRenderer, **environment: float) -> np.ndarray:
    return raster.full(in_weather(**environment), VIEW).pixels.astype(np.float64)


@pytest.mark.parametrize("environment", WEATHERS)
def test_the_layer_over_the_background_is_the_frame_in_any_weather(
    raster: RasterRenderer, environment: dict[str, float]
) -> None:
    scene = in_weather(**environment)
    assert_same(raster.layer(scene, VIEW).over(raster.background(scene, VIEW)), raster.full(scene, VIEW))


@pytest.mark.parametrize("environment", WEATHERS)
def test_weather_changes_the_picture_and_never_the_truth(
    raster: RasterRenderer, truth_pass: TruthPass, environment: dict[str, float]
) -> None:
    dry, wet = in_weather(), in_weather(**environment)
    assert (raster.background(dry, VIEW).pixels != raster.background(wet, VIEW).pixels).any()
    first, second = truth_pass.truth(dry, VIEW), truth_pass.truth(wet, VIEW)
    for name in ("class_map", "instance_map", "depth"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(first.persons[0].amodal, second.persons[0].amodal)


def test_the_defaults_are_the_clear_day_bit_for_bit(raster: RasterRenderer) -> None:
    bare = replace(simple_asset().base, environment=Environment())
    told = replace(bare, environment=Environment(cloud_cover=0.0, visibility=100_000.0, rain=0.0))
    assert_same(raster.full(bare, VIEW), raster.full(told, VIEW))


def test_fog_hides_things_behind_its_own_light_by_distance(raster: RasterRenderer, truth_pass: TruthPass) -> None:
    scene = in_weather(visibility=60.0)
    depth = truth_pass.truth(scene, VIEW).depth
    left = np.abs(raster.full(scene, VIEW).pixels.astype(np.float64) - sky_of(scene).haze).mean(axis=2)
    near, far = left[depth < 10], left[(depth > 25) & (depth < 60)]
    assert len(near) > 100
    assert len(far) > 100
    # exp(−β d) with β = 3.9 / 60 m: above 0.52 below 10 m, below 0.2 from 25 m on.
    assert np.median(far) < 0.4 * np.median(near)


def test_an_overcast_sky_throws_no_shadow_of_the_movables(raster: RasterRenderer) -> None:
    with_sun = raster.layer(in_weather(), VIEW).rectangle
    without = raster.layer(in_weather(cloud_cover=1.0), VIEW).rectangle
    assert 0 < without.width * without.height < with_sun.width * with_sun.height


def test_rain_wets_what_faces_up_and_leaves_walls_their_colour(raster: RasterRenderer, truth_pass: TruthPass) -> None:
    # The same light with and without water: drops and extinction are small at 0.8 mm/h.
    classes = truth_pass.truth(in_weather(cloud_cover=1.0), VIEW)
    dry, wet = picture(raster, cloud_cover=1.0), picture(raster, cloud_cover=1.0, rain=0.8)
    near = classes.depth < 25
    ground, wall = (near & (classes.class_map == label) for label in (7, 11))
    assert ground.any()
    assert wall.any()
    change = [np.median(np.abs(wet[part] / dry[part] - 1)) for part in (ground, wall)]
    assert change[0] > 0.1
    assert change[1] < 0.05


def test_drops_lie_at_the_same_places_whatever_stands_in_the_street(
    raster: RasterRenderer, truth_pass: TruthPass
) -> None:
    rainy = in_weather(cloud_cover=1.0, rain=30.0)
    sky = ~widened(truth_pass.truth(rainy, VIEW).class_map != 23, 2)
    assert sky.sum() > 200
    alone, street = (raster.full(scene, VIEW).pixels for scene in (replace(rainy, nodes={}), rainy))
    np.testing.assert_array_equal(alone[sky], street[sky])
    dry = raster.full(in_weather(cloud_cover=1.0), VIEW).pixels
    assert (dry[sky] != street[sky]).any()
