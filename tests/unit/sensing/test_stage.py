"""Properties of all effects together."""

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.sensing.conftest import setting
from valerie.errors import InvalidInput
from valerie.sensing.sensor import Shot, develop

#: Every effect at a visible strength.
STRONG: dict[str, dict[str, Any]] = {
    "exposure": {"exposure_ev": 1.0},
    "gain": {"gain_db": 6.0},
    "blender-filmic": {"curve": "blender-filmic"},
    "gamma": {"gamma": 1.5},
    "temperature": {"white_balance": {"temperature_k": 4000}},
    "tint": {"white_balance": {"tint": 15}},
    "defocus": {"lens": {"f_number": 0.7, "focus_distance_m": 1}},
    "vignetting": {"lens": {"vignetting": 2}},
    "glare": {"lens": {"glare": 0.05}},
    "flare": {"lens": {"flare": 0.05}},
    "chromatic aberration": {"lens": {"chromatic_aberration": 0.01}},
    "distortion": {"distortion": {"k1": -0.3, "p1": 0.01}},
    "dirt": {"soiling": {"dirt": 0.2}},
    "drops": {"soiling": {"drops": 0.2}},
    "shot noise": {"noise": {"shot": True, "full_well_electrons": 500}},
    "read noise": {"noise": {"read_electrons": 200}},
    "converter": {"noise": {"adc_bits": 4}},
    "dead pixels": {"pixels": {"dead_rate": 0.05}},
    "hot pixels": {"pixels": {"hot_rate": 0.05}},
    "jpeg": {"jpeg_quality": 10},
}


@pytest.mark.parametrize("effect", STRONG)
def test_every_effect_changes_the_picture(effect: str, linear: NDArray[np.float16], shot: Shot) -> None:
    plain, changed = develop(linear, setting(), shot), develop(linear, setting(**STRONG[effect]), shot)
    assert changed.shape == plain.shape
    assert changed.dtype == np.uint8
    assert (plain != changed).any()


@pytest.mark.parametrize("effect", STRONG)
def test_equal_input_gives_equal_pictures_and_leaves_the_input_alone(
    effect: str, linear: NDArray[np.float16], shot: Shot
) -> None:
    before = linear.copy()
    first, second = (develop(linear, setting(**STRONG[effect]), shot) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(linear, before)


@pytest.mark.parametrize(
    "neutral",
    [
        {"lens": {"focus_distance_m": 2.0}},
        {"noise": {"full_well_electrons": 100, "headroom_ev": 0}},
        {"specimen": 5},
        {"gain_db": 0, "jpeg_quality": 0, "white_balance": {"temperature_k": 6504, "tint": 0}},
    ],
)
def test_a_value_without_effect_alone_leaves_the_image_bit_for_bit(
    neutral: dict[str, Any], linear: NDArray[np.float16], shot: Shot
) -> None:
    np.testing.assert_array_equal(develop(linear, setting(**neutral), shot), develop(linear, setting()))


@pytest.mark.parametrize("effect", ["shot noise", "read noise"])
def test_noise_differs_between_frames_seeds_and_specimens(effect: str, linear: NDArray[np.float16], shot: Shot) -> None:
    noisy = setting(**STRONG[effect])
    pictures = [
        develop(linear, noisy, shot),
        develop(linear, noisy, Shot(run_seed=8, content=shot.content)),
        develop(linear, noisy, Shot(run_seed=7, content=("background", "other"))),
        develop(linear, setting(**STRONG[effect], specimen=1), shot),
    ]
    assert len({picture.tobytes() for picture in pictures}) == 4


@pytest.mark.parametrize("effect", ["dead pixels", "hot pixels", "dirt", "drops"])
def test_places_belong_to_the_specimen_and_not_to_the_frame(
    effect: str, linear: NDArray[np.float16], shot: Shot
) -> None:
    soiled = setting(**STRONG[effect])
    here, there = develop(linear, soiled, shot), develop(linear, soiled, Shot(run_seed=7, content=("other", "frame")))
    np.testing.assert_array_equal(here, there)
    for other in (
        develop(linear, setting(**STRONG[effect], specimen=1), shot),
        develop(linear, soiled, Shot(run_seed=8)),
    ):
        assert (here != other).any()


@pytest.mark.parametrize(
    ("values", "missing"),
    [
        ({"distortion": {"k1": 0.1}}, "focal length"),
        ({"lens": {"vignetting": 1}}, "focal length"),
        ({"lens": {"f_number": 2}}, "focal length"),
    ],
)
def test_a_setting_declares_the_data_that_it_needs(
    values: dict[str, Any], missing: str, linear: NDArray[np.float16]
) -> None:
    with pytest.raises(InvalidInput, match=missing):
        develop(linear, setting(**values))


def test_defocus_without_depth_is_refused(linear: NDArray[np.float16]) -> None:
    with pytest.raises(InvalidInput, match="depth"):
        develop(linear, setting(lens={"f_number": 2}), Shot(focal_length_mm=50.0))


def test_not_a_number_and_infinity_pass_through_all_effects(shot: Shot) -> None:
    linear = np.full((54, 96, 3), 0.5, np.float16)
    linear[10, 10], linear[20, 20], linear[30, 30] = np.nan, np.inf, -1.0
    everything: dict[str, Any] = {
        "lens": {"f_number": 2, "vignetting": 1, "glare": 0.02, "flare": 0.01, "chromatic_aberration": 0.01},
        "distortion": {"k1": -0.1},
        "soiling": {"dirt": 0.1, "drops": 0.1},
        "noise": {"shot": True, "read_electrons": 3, "adc_bits": 10},
        "pixels": {"dead_rate": 0.01, "hot_rate": 0.01},
        "jpeg_quality": 50,
    }
    clean = np.where(np.isfinite(linear) & (linear >= 0), linear, np.float16(0.5))
    for curve in ("filmic", "blender-filmic"):
        pictures = [develop(image, setting(curve=curve, **everything), shot) for image in (linear, clean)]
        # Far from these pixels, only the glare of the infinite one is added.
        means = [float(picture[40:, 60:].mean()) for picture in pictures]
        assert 0 < means[1] <= means[0] < 255


def test_gain_and_exposure_are_the_same_where_nothing_is_counted(linear: NDArray[np.float16]) -> None:
    six_decibel = 20.0 * np.log10(2.0)
    np.testing.assert_array_equal(
        develop(linear, setting(gain_db=six_decibel)), develop(linear, setting(exposure_ev=1.0))
    )


def test_gain_is_noisier_than_exposure(shot: Shot) -> None:
    linear = np.full((64, 64, 3), 0.1, np.float16)
    noise = {"shot": True, "full_well_electrons": 2000}
    spread = [
        develop(linear, setting(noise=noise, curve="srgb", **brighter), shot).std()
        for brighter in ({"exposure_ev": 2.0}, {"gain_db": 12.04})
    ]
    # Both are four times as bright. Four times the electrons have half the relative noise, so gain is twice as noisy; less where
    # the steps of 8 bits add their own.
    assert spread[1] > 1.7 * spread[0]


_SCRIPT = """
import hashlib, sys
import numpy as np
from valerie.sensing.sensor import Shot, develop
from valerie.sensing.settings import SensorSetting
linear = np.linspace(0, 2, 40 * 30 * 3).reshape(30, 40, 3).astype(np.float16)
setting = SensorSetting.model_validate_json(sys.argv[1])
print(hashlib.sha256(develop(linear, setting, Shot(run_seed=3, content=("a", "b"))).tobytes()).hexdigest())
"""


@pytest.mark.processes
def test_another_process_draws_the_same_noise_and_dirt() -> None:
    everything = setting(
        noise={"shot": True, "read_electrons": 9}, soiling={"dirt": 0.1, "drops": 0.1}, pixels={"hot_rate": 0.01}
    )
    root = Path(__file__).parents[3]
    other = subprocess.run(
        [sys.executable, "-c", _SCRIPT, everything.model_dump_json()],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
    )
    linear = np.linspace(0, 2, 40 * 30 * 3).reshape(30, 40, 3).astype(np.float16)
    here = develop(linear, everything, Shot(run_seed=3, content=("a", "b")))
    assert other.stdout.strip() == hashlib.sha256(here.tobytes()).hexdigest()
