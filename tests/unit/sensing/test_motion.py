"""Motion blur against images of moving squares computed by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.sensing.motion import Movement, collect_light

HEIGHT, WIDTH = 60, 120


def square(speed_x: float = 0.0, speed_y: float = 0.0) -> tuple[NDArray[np.float32], Movement]:
    """Return a moving white square of 20 × 20 pixels, 5 m away, in front of a black wall at 20 m, and its movement."""
    light, velocity = np.zeros((HEIGHT, WIDTH, 3), np.float32), np.zeros((HEIGHT, WIDTH, 2), np.float32)
    depth = np.full((HEIGHT, WIDTH), 20.0, np.float32)
    light[20:40, 50:70] = 1.0
    velocity[20:40, 50:70] = (speed_x, speed_y)
    depth[20:40, 50:70] = 5.0
    return light, Movement(velocity, depth)


def test_without_motion_nothing_changes() -> None:
    light, movement = square()
    assert collect_light(light, movement, 0.1) is light


def test_a_moving_square_blurs_beyond_its_edges_and_shows_the_wall_at_both_ends() -> None:
    light, movement = square(speed_x=100.0)
    blurred = collect_light(light, movement, 0.1)[30, :, 0]
    # Ten pixels: the box of the square, 50 … 70, is blurred by a box ten wide.
    edges = np.clip(np.minimum(np.arange(WIDTH) + 0.5 - 45.0, 75.0 - (np.arange(WIDTH) + 0.5)) / 10.0, 0.0, 1.0)
    # Eleven moments give steps of 1/11, off by half of one.
    assert blurred == pytest.approx(edges, abs=0.5 / 11)
    assert blurred.sum() == pytest.approx(20.0, rel=1e-5)
    assert np.array_equal(blurred[:44], np.zeros(44))


@pytest.mark.parametrize("speed", [(0.0, 150.0), (-90.0, 0.0), (60.0, -60.0)])
def test_blur_preserves_light_and_its_centre(speed: tuple[float, float]) -> None:
    light, movement = square(*speed)
    blurred = collect_light(light, movement, 0.1)
    assert blurred.sum() == pytest.approx(light.sum(), rel=0.03)
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    assert (blurred[..., 0] * rows).sum() / blurred[..., 0].sum() == pytest.approx(29.5, abs=0.4)
    assert (blurred[..., 0] * columns).sum() / blurred[..., 0].sum() == pytest.approx(59.5, abs=0.4)


def test_a_longer_exposure_blurs_more() -> None:
    light, movement = square(speed_x=100.0)
    spread = [collect_light(light, movement, seconds).std() for seconds in (0.0, 0.02, 0.05, 0.1)]
    assert spread == sorted(spread, reverse=True)
    assert len(set(spread)) == 4


def test_a_static_object_in_front_is_not_smeared_over_a_moving_background() -> None:
    light, velocity = np.zeros((HEIGHT, WIDTH, 3), np.float32), np.zeros((HEIGHT, WIDTH, 2), np.float32)
    depth = np.full((HEIGHT, WIDTH), 20.0, np.float32)
    velocity[...] = (100.0, 0.0)  # the camera turns, and follows the square
    light[20:40, 50:70], velocity[20:40, 50:70], depth[20:40, 50:70] = 1.0, 0.0, 5.0
    blurred = collect_light(light, Movement(velocity, depth), 0.1)
    assert blurred[30, 50:70, 0] == pytest.approx(np.ones(20))
    assert blurred.sum() == pytest.approx(light.sum(), rel=0.02)
