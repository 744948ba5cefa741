"""Measure the CPU milliseconds per megapixel of each effect of the sensor stage.

``make bench-sensor``, or ``python -m benchmarks.bench_sensor [--width W --height H --repeat N]``. The image consists of random
tiles with the depth of a road. *First* includes the tables and maps that later pictures with the same setting share.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks import results
from valerie.sensing.sensor import Shot, develop
from valerie.sensing.settings import SensorSetting

EFFECTS: Final[dict[str, dict[str, Any]]] = {
    "exposure, gain, curve, gamma": {"exposure_ev": 0.5, "gain_db": 3, "gamma": 1.2},
    "white balance": {"white_balance": {"temperature_k": 4500, "tint": 3}},
    "curve blender-filmic": {"curve": "blender-filmic"},
    "defocus f/1.4": {"lens": {"f_number": 1.4, "focus_distance_m": 8}},
    "motion blur of 6 pixels in a ninth": {"shutter": {"exposure_ms": 20}},
    "vignetting": {"lens": {"vignetting": 1}},
    "glare": {"lens": {"glare": 0.02}},
    "flare": {"lens": {"flare": 0.002}},
    "chromatic aberration": {"lens": {"chromatic_aberration": 0.002}},
    "distortion": {"distortion": {"k1": -0.3, "k2": 0.1}},
    "distortion and aberration": {"distortion": {"k1": -0.3}, "lens": {"chromatic_aberration": 0.002}},
    "dirt": {"soiling": {"dirt": 0.1}},
    "drops": {"soiling": {"drops": 0.1}},
    "shot and read noise": {"noise": {"shot": True, "read_electrons": 4}},
    "converter 10 bits": {"noise": {"adc_bits": 10}},
    "dead and hot pixels": {"pixels": {"dead_rate": 1e-3, "hot_rate": 1e-3}},
    "JPEG 80": {"jpeg_quality": 80},
    "all of them": {
        "curve": "blender-filmic",
        "white_balance": {"temperature_k": 4500},
        "lens": {
            "f_number": 1.4,
            "focus_distance_m": 8,
            "vignetting": 1,
            "glare": 0.02,
            "flare": 0.002,
            "chromatic_aberration": 0.002,
        },
        "distortion": {"k1": -0.3},
        "soiling": {"dirt": 0.1, "drops": 0.1},
        "noise": {"shot": True, "read_electrons": 4, "adc_bits": 10},
        "pixels": {"dead_rate": 1e-3, "hot_rate": 1e-3},
        "jpeg_quality": 80,
    },
}


def frame(width: int, height: int) -> tuple[NDArray[np.float16], Shot]:
    """Return an image of tiles of 20 pixels, and the sensor's other inputs: a depth that grows towards a horizon, and motion."""
    rng = np.random.default_rng(0)
    tiles = rng.gamma(1.5, 0.3, (-(-height // 20), -(-width // 20), 3))
    linear = np.kron(tiles, np.ones((20, 20, 1)))[:height, :width].astype(np.float16)
    below = np.maximum(np.arange(height) / height - 0.45, 0.0)
    with np.errstate(divide="ignore"):
        depth = np.repeat((1.5 / below).astype(np.float32)[:, None], width, axis=1)
    velocity = np.zeros((height, width, 2), np.float32)
    velocity[height // 3 : 2 * height // 3, width // 3 : 2 * width // 3] = (300.0, 0.0)
    return linear, Shot(50.0, depth, velocity, 0, ("bench",))


def milliseconds(call: Any, megapixels: float) -> float:
    """Return the CPU time of one call, per megapixel."""
    started = time.process_time()
    call()
    return (time.process_time() - started) * 1000.0 / megapixels


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=960)
    parser.add_argument("--height", type=int, default=540)
    parser.add_argument("--repeat", type=int, default=7)
    arguments = parser.parse_args()
    linear, shot = frame(arguments.width, arguments.height)
    megapixels = linear.shape[0] * linear.shape[1] / 1e6
    figures: dict[str, object] = {"width": arguments.width, "height": arguments.height, "unit": "CPU ms per megapixel"}
    settings = {name: SensorSetting.model_validate(effect) for name, effect in EFFECTS.items()}
    calls: dict[str, Any] = {name: partial(develop, linear, setting, shot) for name, setting in settings.items()}
    for name, call in calls.items():
        first = milliseconds(call, megapixels)
        again = median(milliseconds(call, megapixels) for _ in range(arguments.repeat))
        figures[name] = {"first": round(first, 1), "again": round(again, 1)}
        print(f"{name:36} {again:8.1f}   first {first:8.1f}")
    results.write("sensor", figures)


if __name__ == "__main__":
    main()
