"""The street at night, as the default camera sees it."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.analysis.rows.picture_faults import BLACK, CONSTANT
from valerie.rendering.base import View
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.variation.variant import apply
from valerie.sensing.picture_levels import picture_levels
from valerie.sensing.sensor import develop
from valerie.sensing.settings import METERING, SensorSetting


@pytest.mark.gl
@pytest.mark.parametrize("elevation", [-4.0, -8.0, -20.0])
def test_night_is_a_picture_for_the_default_camera_and_black_for_a_fixed_exposure(
    elevation: float, asset: SceneAsset, raster: RasterRenderer
) -> None:
    night = raster.background(apply({"scene.sun-1.elevation": elevation}, asset), View("camera-1", 240, 135)).pixels
    assert picture_levels(develop(night, SensorSetting()))["picture_mean"] < BLACK
    levels = picture_levels(develop(night, METERING))
    assert levels["picture_mean"] > BLACK
    assert levels["picture_deviation"] > CONSTANT
    assert np.isfinite(list(levels.values())).all()
