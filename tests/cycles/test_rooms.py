"""Rooms behind panes in Cycles against rays that end at the walls of a box, as the raster engine's tests have them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.unit.rendering.raster.test_rooms import CAMERAS, GREY, ROOMS, VIEW, WALLS, pane, texture, walls_met
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.sky import LUX
from valerie.scene.graph.model import Scene


@pytest.fixture
def cycles(holder: BlenderHolder) -> CyclesRenderer:
    return CyclesRenderer(CyclesSettings(samples=8, denoise=False), holder)


def test_a_pane_shows_the_wall_at_which_the_ray_behind_it_ends(cycles: CyclesRenderer) -> None:
    met: set[int] = set()
    for camera in CAMERAS:
        scene = pane(texture(), camera)
        wall, sure = walls_met(scene.cameras["camera-1"])
        pixels = cycles.full(scene, VIEW).pixels.astype(np.float64)
        brightest = pixels.max(-1, keepdims=True)
        assert ((pixels > 0.4 * brightest) == (WALLS[wall] > 0))[sure].all(), camera
        met |= set(wall[sure].tolist())
    assert met == {0, 1, 2, 3, 4}


def test_a_cloth_hangs_at_the_pane_before_the_room(cycles: CyclesRenderer) -> None:
    scene = pane(texture(hung=0.5), "in front")
    columns = np.flatnonzero((walls_met(scene.cameras["camera-1"])[0] >= 0).any(0))
    half = len(columns) // 2
    pixels = cycles.full(scene, VIEW).pixels[24:30].astype(np.float64).mean(axis=0)
    cloth, room = pixels[columns[: half - 2]], pixels[columns[half + 2 :]]
    # A grey cloth before a wall without green, whose texel of 0 is a radiance of 0.001: see `inside.rooms`.
    assert (cloth[:, 1] > 0.9 * cloth[:, 0]).all()
    assert (room[:, 1] < 0.05 * room[:, 0]).all()


def test_lamps_light_the_rooms_that_have_some_while_the_street_lamps_are_on(cycles: CyclesRenderer) -> None:
    def middle(scene: Scene) -> float:
        return float(cycles.full(scene, VIEW).pixels[24:30, 45:51].astype(np.float64).mean())

    night = {"elevation": -18.0}
    # 10 cd/m² is the luminance of a white surface in 31.4 lx. Eight bits of a colour: 1 %.
    expected = GREY * math.pi * ROOMS.luminance * LUX
    assert middle(pane(texture(), "in front", **night)) == pytest.approx(expected, rel=0.01)  # type: ignore[arg-type]
    for scene in (
        pane(texture(), "in front", **night, street_lamps="off"),  # type: ignore[arg-type]
        pane(texture(lit=False), "in front", **night),  # type: ignore[arg-type]
    ):
        assert middle(scene) < expected / 50
