"""The dipped beam against the limits of UN Regulation 112 (class B, 01 series of amendments, paragraph 6.2.4)."""

import math

import numpy as np
import pytest

from valerie.rendering.beams import DIPPED, DippedBeam

#: Intensity of the lamps of `urban-street`, candela, and angle of the cut-off below the horizontal in the regulation's tests
#: (1 %), degrees.
INTENSITY = 12_000.0
AIM = math.degrees(math.atan(0.01))


def candela(right_deg: float, up_deg: float) -> float:
    """Return the intensity in the regulation's coordinates, angles from the horizontal and vertical planes through the lamp."""
    across, up = math.tan(math.radians(right_deg)), math.tan(math.radians(up_deg + AIM))
    return float(INTENSITY * DIPPED.share(np.array(across), np.array(up)))


@pytest.mark.parametrize(
    ("point", "right", "up", "least", "most"),
    [
        ("B50L", -3.43, 0.57, 0.0, 350.0),
        ("75R", 1.15, -0.57, 10_100.0, math.inf),
        ("75L", -3.43, -0.57, 0.0, 10_600.0),
        ("50L", -3.43, -0.86, 0.0, 13_200.0),
        ("50R", 1.72, -0.86, 10_100.0, math.inf),
        ("50V", 0.0, -0.86, 5_100.0, math.inf),
        ("25L", -9.0, -1.72, 1_700.0, math.inf),
        ("25R", 9.0, -1.72, 1_700.0, math.inf),
    ],
)
def test_each_point_of_the_regulation_has_its_light(
    point: str, right: float, up: float, least: float, most: float
) -> None:
    assert least <= candela(right, up) <= most, point


def test_above_the_cut_off_there_is_at_most_the_light_of_zone_iii_and_enough_for_signs() -> None:
    left = [candela(right, up) for right in np.arange(-30.0, 0.1, 1.0) for up in np.arange(0.0, 30.0, 0.5)]
    assert max(left) <= 625.0
    assert candela(0.0, 4.0) >= 65.0


def test_zone_iv_is_lit_and_zone_i_does_not_glare() -> None:
    zone_iv = [candela(right, up) for right in np.arange(-5.15, 5.2, 0.5) for up in np.arange(-1.72, -0.85, 0.1)]
    zone_i = [candela(right, up) for right in np.arange(-9.0, 9.1, 1.0) for up in np.arange(-4.0, -1.7, 0.2)]
    assert min(zone_iv) >= 2_500.0
    assert max(zone_i) <= 2.0 * candela(1.72, -0.86)


def test_a_wall_ten_metres_ahead_is_dark_above_the_lamps() -> None:
    # Lamps are 0.65 m high, and the cut-off descends by 0.1 m over 10 m. Lux of one lamp along a vertical line to the left: at
    # most the light of the point B50L, and below the cut-off at least that of the point 50V.
    heights = np.array([0.65, 1.0, 1.5, 2.5])
    lux = [candela(-2.0, math.degrees(math.atan((h - 0.65) / 10.0))) / 100.0 for h in heights]
    assert max(lux) <= 350.0 / 10.0**2
    assert candela(-2.0, -2.0) >= 5_100.0


def test_the_flux_is_that_of_the_share_over_all_directions() -> None:
    across, up = np.meshgrid(np.linspace(-4, 4, 1601), np.linspace(-4, 0, 1601))
    # The solid angle is dx dy / (1 + x² + y²)^1.5. The beam has a level, sharp cut-off and no stray light.
    share = DippedBeam(DIPPED.spread, 0.0, 1e-9, 0.0).share(across, up)
    lumen = float((share / (1 + across**2 + up**2) ** 1.5).sum() * (8 / 1600) * (4 / 1600))
    # The formula leaves out the solid angle's factor, whose mean is about 1 − 1.5 · 0.25² = 0.91.
    assert DIPPED.flux() == pytest.approx(lumen, rel=0.1)
    # Range of the luminous flux of a halogen lamp's dipped beam on the road, lumens.
    assert 300.0 < INTENSITY * DIPPED.flux() < 1000.0
