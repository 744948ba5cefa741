"""Splines against scipy's Hermite splines and polynomials that they must reproduce."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from valerie.scene.motion.splines import linear, smooth, unwrapped

TIMES = (0.0, 0.4, 1.0, 3.0)


def test_between_keyframes_it_is_the_hermite_polynomial_with_tangents_of_parabolas() -> None:
    values = (2.0, -1.0, 4.0, 3.5)
    spline = smooth(TIMES, values, (False,) * 3)
    # Tangents by fitting a parabola through three neighbours each.
    tangents = [
        np.polyval(np.polyder(np.polyfit(TIMES[k : k + 3], values[k : k + 3], 2)), time)
        for k, time in ((0, 0.0), (0, 0.4), (1, 1.0), (1, 3.0))
    ]
    expected = CubicHermiteSpline(TIMES, values, tangents)
    at = np.linspace(0.0, 2.999, 101)
    assert [spline.value(t) for t in at] == pytest.approx(expected(at), abs=1e-12)
    assert [spline.velocity(t) for t in at] == pytest.approx(expected(at, 1), abs=1e-11)


@given(st.tuples(*[st.floats(-5, 5)] * 3), st.floats(0, 2.99))
def test_movement_at_constant_acceleration_is_exact(parabola: tuple[float, float, float], time: float) -> None:
    spline = smooth(TIMES, tuple(np.polyval(parabola, TIMES)), (False,) * 3)
    assert spline.value(time) == pytest.approx(np.polyval(parabola, time), abs=1e-11)
    assert spline.velocity(time) == pytest.approx(np.polyval(np.polyder(parabola), time), abs=1e-11)


def test_keyframes_are_met_exactly_and_the_value_rests_outside_of_them() -> None:
    values = (0.1, 0.7, -0.3, 1.9)
    spline = smooth(TIMES, values, (False,) * 3)
    assert tuple(spline.value(t) for t in TIMES) == values
    assert (spline.value(-9.0), spline.value(9.0)) == (0.1, 1.9)
    assert (spline.velocity(-9.0), spline.velocity(9.0)) == (0.0, 0.0)


def test_nothing_moves_in_a_pause_and_nothing_overshoots_beside_it() -> None:
    spline = smooth(TIMES, (0.0, 1.0, 1.0, 5.0), (False, True, False))
    assert {spline.value(t) for t in np.linspace(0.4, 1.0, 33)} == {1.0}
    assert max(spline.value(t) for t in np.linspace(0.0, 0.4, 33)) == 1.0
    assert min(spline.value(t) for t in np.linspace(1.0, 3.0, 33)) == 1.0


def test_one_keyframe_is_a_place_and_two_are_a_line() -> None:
    assert [smooth((1.0,), (4.0,), ()).value(t) for t in (0.0, 1.0, 2.0)] == [4.0] * 3
    line = smooth((0.0, 2.0), (1.0, 5.0), (False,))
    assert [line.value(t) for t in (0.5, 1.0, 1.5)] == pytest.approx([2.0, 3.0, 4.0])


def test_linear_goes_straight() -> None:
    at = np.linspace(0.0, 3.0, 50)
    spline = linear(TIMES, (0.0, 1.0, -1.0, 5.0))
    assert [spline.value(t) for t in at] == pytest.approx(np.interp(at, TIMES, (0.0, 1.0, -1.0, 5.0)))


def test_angles_turn_the_shortest_way() -> None:
    assert unwrapped((350.0, 10.0, 340.0)) == (350.0, 370.0, 340.0)
    assert unwrapped((0.0, 180.0, 0.0)) == (0.0, 180.0, 360.0)
    assert unwrapped((10.0, 720.0)) == (10.0, 0.0)
