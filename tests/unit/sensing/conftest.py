"""A small street-like image with its depth, and a camera for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.sensing.sensor import Shot
from valerie.sensing.settings import SensorSetting

WIDTH, HEIGHT = 96, 54


@pytest.fixture(scope="session")
def linear() -> NDArray[np.float16]:
    """Return a linear image, (54, 96, 3): tiles of different light, some above white, over a soft gradient."""
    rng = np.random.default_rng(3)
    tiles = np.kron(rng.uniform(0.02, 2.0, (9, 16, 3)), np.ones((6, 6, 1)))
    tiles *= np.linspace(0.7, 1.3, WIDTH)[None, :, None]
    tiles[20:24, 40:44] = 9.0
    return tiles.astype(np.float16)


@pytest.fixture(scope="session")
def shot() -> Shot:
    depth = np.repeat(np.linspace(60.0, 0.5, HEIGHT, dtype=np.float32)[:, None], WIDTH, axis=1)
    depth[:6] = np.inf
    return Shot(focal_length_mm=50.0, depth=depth, run_seed=7, content=("background", "layer"))


def setting(**groups: Any) -> SensorSetting:
    return SensorSetting.model_validate(groups)
