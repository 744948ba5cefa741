"""Blender's Filmic against Blender itself: ``blender_filmic_pairs.npz`` pairs linear values with Blender 4.5's 8-bit PNG of them.

``plain`` is the plain view transform Filmic; ``paper`` has exposure 0.5 and gamma 1.5, as in the paper's section 6.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.unit.sensing.conftest import setting
from valerie.sensing.blender_filmic import blender_filmic
from valerie.sensing.sensor import develop, respond

PAIRS = Path(__file__).with_name("blender_filmic_pairs.npz")


@pytest.mark.parametrize(("name", "values"), [("plain", {}), ("paper", {"exposure_ev": 0.5, "gamma": 1.5})])
def test_the_curve_is_within_one_grey_level_of_blenders_own_image(name: str, values: dict[str, float]) -> None:
    with np.load(PAIRS) as pairs:
        linear, expected = pairs["linear"][None], pairs[name][None].astype(int)
    picture = develop(linear, setting(curve="blender-filmic", **values)).astype(int)
    assert np.abs(picture - expected).max() <= 1
    # A curve that is off by e grey levels rounds otherwise in a share e of the pixels: this one is off by less than 0.03.
    assert (picture != expected).mean() < 0.03


def test_middle_grey_is_in_the_middle_and_white_is_reached_after_six_and_a_half_stops() -> None:
    grey, bright = respond(np.array([0.18, 16.3]), setting(curve="blender-filmic"))
    assert grey == pytest.approx(0.5, abs=0.003)
    assert round(255 * bright) == 255


def test_it_is_monotone_in_grey() -> None:
    display = respond(np.geomspace(1e-6, 1e5, 3000), setting(curve="blender-filmic"))
    assert (np.diff(display) >= 0).all()


def test_bright_colours_lose_their_saturation() -> None:
    display = blender_filmic(np.array([[0.2, 0.02, 0.02], [200.0, 20.0, 20.0]], np.float32))
    assert display[0, 0] > 2 * display[0, 1]
    # All channels are above 16.3, where white is reached: to half a grey level.
    assert display[1].min() >= 1 - 0.5 / 255
