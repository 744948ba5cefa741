"""Rooms behind panes in the raster engine."""

from dataclasses import replace

import numpy as np
import pytest

from tests.unit.rendering.rooms import VIEW, check_lamps, check_walls, pane, texture, walls_met
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer

pytestmark = pytest.mark.gl


def test_a_pane_shows_the_wall_at_which_the_ray_behind_it_ends(raster: RasterRenderer) -> None:
    check_walls(lambda scene: raster.full(scene, VIEW).pixels)


def test_lamps_light_the_rooms_that_have_some_while_the_street_lamps_are_on(raster: RasterRenderer) -> None:
    check_lamps(lambda scene: raster.full(scene, VIEW).pixels)


def test_a_cloth_hangs_at_the_pane_before_the_room(raster: RasterRenderer) -> None:
    scene = pane(texture(hung=0.5), "in front")
    wall, _ = walls_met(scene.cameras["camera-1"])
    bare = raster.full(pane(texture(), "in front"), VIEW).pixels.astype(np.float64)
    pixels = raster.full(scene, VIEW).pixels.astype(np.float64)
    through = np.flatnonzero((wall >= 0).any(0))
    half = len(through) // 2
    rows = slice(24, 30)
    cloth, open_part = pixels[rows, through[: half - 2]], pixels[rows, through[half + 2 :]]
    assert np.ptp(cloth, axis=-1).max() < 0.02 * cloth.max()  # grey, in halves of 11 bits and light of one colour: 2 %
    np.testing.assert_array_equal(open_part, bare[rows, through[half + 2 :]])


def test_rooms_change_no_truth(truth_pass: TruthPass) -> None:
    scene = pane(texture(), "from the left, below")
    plain = replace(scene, materials={"glass": replace(scene.materials["glass"], rooms=None)})
    truth, other = truth_pass.truth(scene, VIEW), truth_pass.truth(plain, VIEW)
    np.testing.assert_array_equal(truth.class_map, other.class_map)
    np.testing.assert_array_equal(truth.depth, other.depth)
