import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.errors import InvalidInput
from valerie.sensing.curves import CURVES
from valerie.sensing.sensor import develop, respond
from valerie.sensing.settings import SensorSetting

CURVE_NAMES = sorted(CURVES)


def image_of(*values: float) -> np.ndarray:
    """Return a grey linear image of 1 × n pixels."""
    return np.repeat(np.array(values, np.float16).reshape(1, -1, 1), 3, axis=2)


def reference(value: float, setting: SensorSetting) -> int:
    """Return the stage's result for one value, in an independent implementation in plain Python."""
    x = value * 2.0**setting.exposure_ev
    if setting.curve == "filmic":

        def h(v: float) -> float:
            a, b, c, d, e, f = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30
            return (v * (a * v + c * b) + d * e) / (v * (a * v + b) + d * f) - e / f

        x = h(2 * x) / h(11.2)
    elif setting.curve == "aces":
        x *= 0.6
        x = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    x = min(max(x, 0.0), 1.0)
    x = 12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055
    return int(max(x, 0.0) ** (1 / setting.gamma) * 255 + 0.5)


@pytest.mark.parametrize("curve", CURVE_NAMES)
def test_every_finite_float16_gets_the_value_of_the_formula(curve: str) -> None:
    setting = SensorSetting.model_validate({"curve": curve, "exposure_ev": 0.5, "gamma": 1.5})
    codes = np.arange(0, 0x7C00, 7, dtype=np.uint16)  # non-negative and finite
    values = codes.view(np.float16)
    picture = develop(np.repeat(values.reshape(1, -1, 1), 3, axis=2), setting)
    expected = [reference(float(value), setting) for value in values]
    np.testing.assert_array_equal(picture[0, :, 1], expected)


@pytest.mark.parametrize("curve", CURVE_NAMES)
def test_nan_and_negative_are_black_and_infinity_is_white(curve: str) -> None:
    setting = SensorSetting.model_validate({"curve": curve})
    picture = develop(image_of(np.nan, -np.nan, -1.0, -np.inf, -0.0, np.inf, 65504.0), setting)
    assert picture[0, :, 0].tolist() == [0, 0, 0, 0, 0, 255, 255]


@pytest.mark.parametrize("curve", CURVE_NAMES)
@pytest.mark.parametrize("exposure", [-16.0, 16.0])
def test_the_extreme_exposures_stay_in_range_and_monotone(curve: str, exposure: float) -> None:
    setting = SensorSetting.model_validate({"curve": curve, "exposure_ev": exposure})
    values = np.geomspace(1e-7, 65504.0, 500)
    levels = develop(image_of(*values), setting)[0, :, 0].astype(int)
    assert (np.diff(levels) >= 0).all()


def test_plain_srgb_maps_middle_grey_to_118() -> None:
    assert develop(image_of(0.1800), SensorSetting(curve="srgb"))[0, 0, 0] == 118


def test_filmic_maps_middle_grey_darker_than_plain_srgb_and_preserves_highlights() -> None:
    filmic = SensorSetting(curve="filmic")
    grey, bright = develop(image_of(0.18, 2.0), filmic)[0, :, 0]
    assert grey < 118
    assert bright == reference(2.0, filmic) < 255


def test_gamma_above_one_brightens() -> None:
    dark, bright = (develop(image_of(0.1), SensorSetting(gamma=g))[0, 0, 0] for g in (1.0, 1.5))
    assert bright > dark


@given(st.floats(0.0, 60000.0, width=16), st.floats(-4.0, 4.0), st.sampled_from(CURVE_NAMES))
def test_one_stop_up_equals_twice_the_light(value: float, exposure: float, curve: str) -> None:
    lower = SensorSetting.model_validate({"exposure_ev": exposure, "curve": curve})
    upper = SensorSetting.model_validate({"exposure_ev": exposure + 1.0, "curve": curve})
    twice = respond(np.array([2.0 * value]), lower)
    np.testing.assert_allclose(respond(np.array([value]), upper), twice, atol=1e-12)


def test_channels_do_not_mix() -> None:
    linear = np.zeros((2, 2, 3), np.float16)
    linear[..., 1] = 0.5
    picture = develop(linear, SensorSetting())
    assert picture[..., [0, 2]].max() == 0
    assert picture[..., 1].min() > 0


def test_a_view_of_an_image_gives_the_picture_of_its_copy() -> None:
    linear = np.random.default_rng(1).random((8, 12, 3)).astype(np.float16)
    cut = linear[::2, 1::3]
    np.testing.assert_array_equal(develop(cut, SensorSetting()), develop(cut.copy(), SensorSetting()))


def test_an_image_of_another_type_is_refused() -> None:
    with pytest.raises(InvalidInput, match="float32"):
        develop(np.zeros((2, 2, 3), np.float32), SensorSetting())  # type: ignore[arg-type]
