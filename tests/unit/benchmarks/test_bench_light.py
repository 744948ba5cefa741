from __future__ import annotations

import numpy as np

from benchmarks.bench_light import compared
from valerie.labels import BY_NAME, SKY


def test_ratios_are_those_of_mean_values_and_the_difference_leaves_out_the_sky() -> None:
    road, car = BY_NAME["road"].id, BY_NAME["car"].id
    classes = np.array([[SKY.id, SKY.id, road, road], [road, road, car, car]], np.uint8)
    raster, cycles = np.ones((2, 4, 3)), np.ones((2, 4, 3))
    raster[0, :2] = 9.0
    raster[1, 2:] = 2.0
    cycles[0, 2] = 3.0
    ratios = compared(raster, cycles, classes)
    assert ratios["ratios"] == {"road": round(4 / 6, 2), "car": 2.0, "sky": 9.0}
    # Of six pixels one is three times darker, two are twice as bright.
    assert ratios["difference"] == round(float(np.exp((np.log(3) + 2 * np.log(2)) / 6)), 2)
