from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.rendering.base import Rectangle, View
from valerie.rendering.cycles.reach import denoised_window, reached_rectangle
from valerie.rendering.projection import project
from valerie.scene.graph.model import Environment, Light, Node, Scene
from valerie.testing.assets import simple_asset

VIEW = View("camera-1", 320, 180)


def in_rain(rain: float) -> Scene:
    base = simple_asset().base
    camera = base.cameras["camera-1"]
    wide = replace(camera, focal_length_mm=0.4 * camera.focal_length_mm)
    return replace(base, cameras={"camera-1": wide}, environment=Environment(cloud_cover=1.0, rain=rain))


def test_on_a_wet_road_the_rectangle_holds_the_mirror_image_of_the_head() -> None:
    dry, wet = (reached_rectangle(in_rain(rain), VIEW) for rain in (0.0, 5.0))
    assert wet.y + wet.height > dry.y + dry.height
    # A person of 1.8 m stands at (0, 10): the mirror image of the head is seen as far below the ground.
    ((x, y),) = project(np.array([[0.0, 10.0, -1.8]]), in_rain(5.0).cameras["camera-1"], 320, 180)[:, :2]
    assert wet.x <= x <= wet.x + wet.width
    assert wet.y <= y <= wet.y + wet.height


def test_a_moving_lamp_reaches_the_whole_image() -> None:
    scene = in_rain(0.0)
    lamp = Node("scene.car-2", np.eye(4), light=Light(), movable=True)
    statics = {p: n for p, n in scene.nodes.items() if not n.movable}
    for nodes in (scene.nodes, statics):
        lit = replace(scene, nodes={**nodes, lamp.path: lamp})
        assert reached_rectangle(lit, VIEW) == Rectangle(0, 0, VIEW.width, VIEW.height)


@pytest.mark.parametrize("rain", [0.0, 5.0])
def test_without_movables_nothing_is_reached(rain: float) -> None:
    scene = in_rain(rain)
    statics = replace(scene, nodes={p: n for p, n in scene.nodes.items() if not n.movable})
    assert reached_rectangle(statics, VIEW).empty


@given(st.data())
def test_the_denoisers_window_is_whole_blocks_from_the_lower_left_around_the_rectangle(
    data: st.DataObject,
) -> None:
    x, y = data.draw(st.integers(0, VIEW.width - 1)), data.draw(st.integers(0, VIEW.height - 1))
    width, height = data.draw(st.integers(1, VIEW.width - x)), data.draw(st.integers(1, VIEW.height - y))
    window = denoised_window(Rectangle(x, y, width, height), VIEW)
    right, bottom = window.x + window.width, window.y + window.height
    assert 0 <= window.x <= max(x - 16, 0)
    assert 0 <= window.y <= max(y - 16, 0)
    assert VIEW.width >= right >= min(x + width + 16, VIEW.width)
    assert VIEW.height >= bottom >= min(y + height + 16, VIEW.height)
    assert window.x % 16 == 0
    assert right % 16 == 0
    assert (VIEW.height - bottom) % 16 == 0
    assert window.y == 0 or (VIEW.height - window.y) % 16 == 0
    # And no block more.
    assert window.x > x - 32
    assert right < x + width + 32
