import numpy as np
import pytest

from valerie.sensing.colour import planckian_locus, white_balance_gains


def test_the_neutral_setting_multiplies_by_exactly_one() -> None:
    assert white_balance_gains(6504.0, 0.0) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("kelvin", "x", "y"),
    [(2856.0, 0.4476, 0.4075), (4000.0, 0.3804, 0.3767), (6504.0, 0.3135, 0.3236), (10000.0, 0.2807, 0.2884)],
)
def test_the_locus_is_that_of_black_bodies(kelvin: float, x: float, y: float) -> None:
    # Planck's law integrated over the CIE 1931 observer (Wyszecki and Stiles, Color Science, table I(3.3.4)).
    assert planckian_locus(kelvin) == pytest.approx((x, y), abs=6e-4)


def test_a_higher_temperature_is_warmer() -> None:
    kelvins = np.linspace(2500, 15000, 26)
    red, green, blue = np.array([white_balance_gains(float(k), 0.0) for k in kelvins]).T
    assert (np.diff(red) > 0).all()
    assert (np.diff(blue) < 0).all()
    assert (green == 1.0).all()


def test_the_gains_pass_through_one_without_a_step() -> None:
    near = np.array([white_balance_gains(6504.0 + d, 0.0) for d in (-1.0, 1.0)])
    np.testing.assert_allclose(near, 1.0, atol=5e-4)


def test_tint_above_zero_is_magenta_and_below_green() -> None:
    for tint, more in ((10.0, True), (-10.0, False)):
        red, _, blue = white_balance_gains(6504.0, tint)
        assert (red > 1.0) is more
        assert (blue > 1.0) is more


def test_gains_stay_usable_at_the_ends_of_the_ranges() -> None:
    gains = np.array([white_balance_gains(k, t) for k in (2500.0, 15000.0) for t in (-30.0, 30.0)])
    assert np.isfinite(gains).all()
    # Two stops down and six up, a requirement of ours.
    assert gains.min() > 2.0**-2
    assert gains.max() < 2.0**6
