from __future__ import annotations

import numpy as np
import pytest

from benchmarks.cycles_frames import cut, linear, mean, planned, put
from valerie.rendering.base import Rectangle
from valerie.rendering.cycles.translation import Guided
from valerie.testing.assets import simple_asset


def guided(height: int, width: int, seed: int) -> Guided:
    drawn = np.random.default_rng(seed).random((3, height, width, 3), np.float32)
    return Guided(*drawn)


def test_a_longer_plan_begins_with_the_shorter_one() -> None:
    asset = simple_asset()
    few, more = (planned(asset, 96, 54, count) for count in (4, 7))
    assert [frame.rectangle for frame in few] == [frame.rectangle for frame in more[:4]]
    assert [frame.index for frame in more] == list(range(7))


def test_pedestrians_of_a_plan_stand_near_and_far_in_several_outfits() -> None:
    frames = planned(simple_asset(), 960, 540, 8)
    distances = [frame.distance_m for frame in frames]
    assert max(distances) > 3 * min(distances)
    assert len({path for frame in frames for path in frame.scene.nodes if path.startswith("scene.person-1.")}) > 1


def test_a_window_holds_its_rectangle_and_knows_where() -> None:
    for frame in planned(simple_asset(), 960, 540, 4):
        whole = np.arange(960 * 540).reshape(540, 960)
        np.testing.assert_array_equal(whole[frame.window.slices][frame.core.slices], whole[frame.rectangle.slices])


def test_a_window_is_put_into_a_copy_of_the_background_and_nothing_else_changes() -> None:
    background, window, at = guided(9, 12, 0), guided(4, 5, 1), Rectangle(3, 2, 5, 4)
    before = [layer.copy() for layer in background]
    frame = put(window, at, background)
    for layer, part, old, now in zip(frame, window, before, background, strict=True):
        np.testing.assert_array_equal(layer[at.slices], part)
        outside = np.ones((9, 12), bool)
        outside[at.slices] = False
        np.testing.assert_array_equal(layer[outside], old[outside])
        np.testing.assert_array_equal(now, old)


def test_what_was_put_in_is_what_is_cut_out() -> None:
    window, at = guided(4, 5, 1), Rectangle(3, 2, 5, 4)
    for there, given in zip(cut(put(window, at, guided(9, 12, 0)), at), window, strict=True):
        np.testing.assert_array_equal(there, given)


def test_the_mean_of_two_seeds_has_half_the_variance() -> None:
    first, second = guided(60, 60, 0), guided(60, 60, 1)
    both = mean(first, second)
    assert both.noisy.dtype == np.float32
    assert both.noisy.var() == pytest.approx(first.noisy.var() / 2, rel=0.1)


def test_light_leaves_as_the_engine_hands_it_out() -> None:
    pixels = np.array([[[-1.0, 0.5, 1e6]]], np.float32)
    np.testing.assert_array_equal(linear(pixels).pixels, np.array([[[0.0, 0.5, 65504.0]]], np.float16))
