import numpy as np
import pytest

from valerie.sensing.motion import motion_blur, rolling_shutter_map
from valerie.sensing.resampling import bilinear


def flow_of(x: float, y: float, height: int = 40, width: int = 80) -> np.ndarray:
    return np.broadcast_to(np.array([x, y], np.float32), (height, width, 2)).copy()


def test_without_motion_or_shutter_nothing_changes() -> None:
    image = np.random.default_rng(0).random((40, 80, 3), np.float32)
    assert motion_blur(image, flow_of(0, 0), 0.5) is image
    assert motion_blur(image, flow_of(9, 2), 0.0) is image


def test_a_moving_point_becomes_a_track_of_the_same_energy() -> None:
    image = np.zeros((40, 80, 3), np.float32)
    image[20, 40] = 1.0
    found = motion_blur(image, flow_of(16.0, 0.0), 0.5)[..., 0]
    assert found.sum() == pytest.approx(1.0, rel=1e-4)
    columns = np.flatnonzero(found[20] > 1e-4)
    assert 7 <= columns[-1] - columns[0] <= 9  # half of 16 pixels
    assert (columns[0] + columns[-1]) / 2 == pytest.approx(40, abs=0.6)
    assert found[np.arange(40) != 20].sum() == 0.0


def test_a_longer_shutter_blurs_more() -> None:
    image = np.random.default_rng(0).random((40, 80, 3), np.float32)
    spread = [motion_blur(image, flow_of(12, 5), shutter).std() for shutter in (0.0, 0.25, 0.5, 1.0)]
    assert spread == sorted(spread, reverse=True)


def test_a_rolling_shutter_leans_what_moves_sideways() -> None:
    image = np.zeros((40, 80), np.float32)
    image[:, 40] = 1.0
    x, y = rolling_shutter_map(flow_of(20.0, 0.0), 0.8)
    found = bilinear(image, x, y)
    top, middle, bottom = (float(found[row] @ np.arange(80)) for row in (0, 20, 39))
    # The first row is read 0.39 intervals before the middle one.
    assert top == pytest.approx(40 - 20 * 0.8 * (0.5 - 0.5 / 40), abs=0.1)
    assert middle == pytest.approx(40, abs=0.3)
    assert bottom == pytest.approx(40 + 20 * 0.8 * (0.5 - 0.5 / 40), abs=0.1)


def test_an_instant_readout_leaves_every_pixel_where_it_is() -> None:
    x, y = rolling_shutter_map(flow_of(20.0, 3.0), 0.0)
    np.testing.assert_array_equal(x, np.broadcast_to(np.arange(80), (40, 80)))
    np.testing.assert_array_equal(y, np.broadcast_to(np.arange(40)[:, None], (40, 80)))
