"""Rooms behind panes in Cycles."""

from __future__ import annotations

import numpy as np
import pytest

from tests.unit.rendering.rooms import VIEW, check_lamps, check_walls, pane, texture, walls_met
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings


@pytest.fixture
def cycles(holder: BlenderHolder) -> CyclesRenderer:
    return CyclesRenderer(CyclesSettings(samples=8, denoise=False), holder)


def test_a_pane_shows_the_wall_at_which_the_ray_behind_it_ends(cycles: CyclesRenderer) -> None:
    check_walls(lambda scene: cycles.full(scene, VIEW).pixels)


def test_lamps_light_the_rooms_that_have_some_while_the_street_lamps_are_on(cycles: CyclesRenderer) -> None:
    check_lamps(lambda scene: cycles.full(scene, VIEW).pixels)


def test_a_cloth_hangs_at_the_pane_before_the_room(cycles: CyclesRenderer) -> None:
    scene = pane(texture(hung=0.5), "in front")
    columns = np.flatnonzero((walls_met(scene.cameras["camera-1"])[0] >= 0).any(0))
    half = len(columns) // 2
    pixels = cycles.full(scene, VIEW).pixels[24:30].astype(np.float64).mean(axis=0)
    cloth, room = pixels[columns[: half - 2]], pixels[columns[half + 2 :]]
    # A grey cloth before a wall without green, whose texel of 0 is a radiance of 0.001: see `inside.rooms`.
    assert (cloth[:, 1] > 0.9 * cloth[:, 0]).all()
    assert (room[:, 1] < 0.05 * room[:, 0]).all()
