"""Lamps: which of them are on, their strength in the image's unit, and the materials that glow."""

import math
from dataclasses import replace

import numpy as np
import pytest

from valerie.rendering.lamps import glowing, keeping_hue, lit_lamps
from valerie.rendering.sky import EXPOSURE, LUX, sky_of
from valerie.scene.graph.model import SWITCHES, Environment, Light, Material, Node, Scene, Sun
from valerie.scene.graph.transforms import Pose

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def scene_with(
    light: Light, elevation: float = -12.0, *, visible: bool = True, movable: bool = False, **environment: str
) -> Scene:
    node = Node("scene.pole-1", Pose((1, 2, 0), (0, 0, 0)).matrix(), visible=visible, movable=movable)
    lamp = Node("scene.pole-1.lamp", Pose((0, 0, 5), (270, 0, 0)).matrix(), light=light, movable=movable)
    return Scene(
        {node.path: node, lamp.path: lamp},
        {"lens": Material("lens"), "post": Material("post")},
        {},
        {},
        Sun(0.0, math.radians(elevation)),
        Environment(**environment),  # type: ignore[arg-type]
    )


def lit(scene: Scene) -> tuple:
    return lit_lamps(scene, sky_of(scene))


def test_a_lamp_shines_from_its_node_along_the_nodes_y_axis() -> None:
    (lamp,) = lit(scene_with(Light(intensity=200.0)))
    assert lamp.position == (1.0, 2.0, 5.0)
    np.testing.assert_allclose(lamp.direction, (0, 0, -1), atol=1e-12)  # turned about x, +y looks down


def test_a_candela_is_a_lux_at_one_metre_whatever_its_colour() -> None:
    for color in ((1.0, 1.0, 1.0), (1.0, 0.7, 0.4), (0.5, 0.0, 0.0)):
        (lamp,) = lit(scene_with(Light(intensity=200.0, color=color)))
        assert np.array(lamp.strength) @ LUMINANCE == pytest.approx(200.0 * LUX)
    # A white surface in the noon sun, 100,000 lx, has the image value `EXPOSURE`.
    assert pytest.approx(EXPOSURE) == 100_000.0 * LUX


@pytest.mark.parametrize(("inner", "outer"), [(0.07, 0.52), (0.6, 1.3), (0.0, math.pi)])
def test_the_flux_of_a_lamp_is_its_light_over_all_directions(inner: float, outer: float) -> None:
    (lamp,) = lit(scene_with(Light(intensity=200.0, inner=inner, outer=outer)))
    angle = (np.arange(100_000) + 0.5) / 100_000 * math.pi
    share = np.clip((np.cos(angle) - math.cos(outer)) / (math.cos(inner) - math.cos(outer)), 0.0, 1.0) ** 2
    if outer == math.pi:
        share[:] = 1.0
    lumen = 200.0 * float((share * np.sin(angle)).sum()) * 2.0 * math.pi * math.pi / 100_000
    assert np.array(lamp.flux) @ LUMINANCE == pytest.approx(lumen * LUX, rel=1e-6)


@pytest.mark.parametrize(("switch", "field"), [("street", "street_lamps"), ("car", "car_lamps")])
def test_a_switch_turns_its_own_lamps_on_and_off_and_auto_waits_for_the_dark(switch: str, field: str) -> None:
    light = Light(switch=switch)
    dark, day = -12.0, 40.0
    assert lit(scene_with(light, dark))
    assert not lit(scene_with(light, day))
    assert lit(scene_with(light, day, **{field: "on"}))
    assert not lit(scene_with(light, dark, **{field: "off"}))
    other = "car_lamps" if field == "street_lamps" else "street_lamps"
    assert lit(scene_with(light, dark, **{other: "off"}))


@pytest.mark.parametrize("switch", ["street", "car"])
def test_auto_follows_the_light_on_the_ground(switch: str) -> None:
    for elevation in np.arange(-8.0, 3.0, 0.25):
        scene = scene_with(Light(switch=switch), float(elevation))
        assert bool(lit(scene)) == (sky_of(scene).lux < SWITCHES[switch])


def test_the_lamps_of_vehicles_turn_on_before_those_of_the_street() -> None:
    at_sunset = {switch: bool(lit(scene_with(Light(switch=switch), -0.8))) for switch in SWITCHES}
    assert at_sunset == {"street": False, "car": True}


def test_lamps_turn_on_earlier_under_thick_clouds() -> None:
    clear = scene_with(Light(switch="car"), 0.5)
    clouded = replace(clear, environment=Environment(cloud_cover=1.0))
    assert not lit(clear)
    assert lit(clouded)


def test_a_lamp_without_a_switch_is_always_on_and_a_hidden_one_never() -> None:
    assert lit(scene_with(Light(), 40.0))
    assert not lit(scene_with(Light(), visible=False))
    assert not lit(scene_with(Light(intensity=0.0)))


def test_only_the_materials_that_a_lamp_names_glow_and_only_while_it_is_on() -> None:
    light = Light(switch="street", glowing=("lens",), luminance=10_000.0, color=(1.0, 0.5, 0.25))
    night, day = scene_with(light), scene_with(light, 40.0)
    scene = glowing(night, sky_of(night))
    assert scene.materials["post"] is night.materials["post"]
    # 10,000 cd/m² is the luminance of a white surface in 31,416 lx.
    assert np.array(scene.materials["lens"].emissive) @ LUMINANCE == pytest.approx(math.pi * 10_000.0 * LUX)
    assert glowing(day, sky_of(day)) is day
    again = glowing(replace(night), sky_of(night))
    assert again.materials["lens"] is scene.materials["lens"]


RED, AMBER, WHITE = (0.9, 0.03, 0.015), (0.95, 0.42, 0.015), (14.0, 13.0, 11.5)


@pytest.mark.parametrize("color", [RED, AMBER])
def test_a_coloured_signal_keeps_its_hue_in_a_street_that_is_exposed_for_its_lamps(
    color: tuple[float, float, float],
) -> None:
    dark = scene_with(Light(), -12.0)
    night = replace(dark, materials={**dark.materials, "signal": Material("signal", emissive=color, signal=True)})
    shown = np.array(keeping_hue(night, sky_of(night)).materials["signal"].emissive)
    np.testing.assert_allclose(shown / shown.max(), np.array(color) / max(color))
    # Where a white surface in the 20 lx of street lamps has the display's white, at most one channel clips.
    display = shown / (20.0 * LUX)
    assert 1.0 <= display.max() <= 2.0
    assert np.sort(display)[1] < 1.0


def test_other_lamps_and_signals_by_day_keep_their_radiance() -> None:
    for elevation, signal in ((-12.0, False), (40.0, True)):
        plain = scene_with(Light(), elevation)
        materials = {str(k): Material(str(k), emissive=color, signal=signal) for k, color in enumerate((WHITE, RED))}
        scene = replace(plain, materials=materials)
        shown = keeping_hue(scene, sky_of(scene))
        for name, material in materials.items():
            assert shown.materials[name].emissive == pytest.approx(material.emissive)


def test_a_lamp_on_a_movable_is_marked_as_movable() -> None:
    assert [lamp.movable for lamp in lit(scene_with(Light(), movable=True))] == [True]
    assert [lamp.movable for lamp in lit(scene_with(Light()))] == [False]
