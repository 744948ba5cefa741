"""Measure the CPU seconds that the driver needs to compile the shaders of a frame on a machine that has compiled none before.

``make bench-shaders``. Each row is a process without a shader cache that renders a small frame of boxes twice. Only the first of
them compiles: ``compiled`` is the difference.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from benchmarks import results
from valerie.plain import JsonObject
from valerie.scene.graph.model import Light, Node, Sun
from valerie.scene.graph.transforms import Pose
from valerie.testing.assets import simple_asset

VIEW: Final = ("camera-1", 160, 90)
SUN_DEG: Final = (160.0, 35.0)
NIGHT_DEG: Final = (160.0, -20.0)
CONDITIONS: Final[dict[str, tuple[tuple[float, float], dict[str, Any]]]] = {
    "clear day": (SUN_DEG, {}),
    "rain": (SUN_DEG, {"rain": 4.0, "cloud_cover": 0.9}),
    "snowfall on snow": (SUN_DEG, {"snowfall": 2.0, "snow_depth": 0.02, "cloud_cover": 1.0}),
    "rain on leaves and slush": (SUN_DEG, {"rain": 2.0, "snow_depth": 0.01, "leaf_litter": 0.4}),
    "night": (NIGHT_DEG, {}),
    "rain at night": (NIGHT_DEG, {"rain": 4.0, "cloud_cover": 0.9}),
}


def first_frames(condition: str) -> JsonObject:
    """Return the CPU seconds of the first frame and of the same frame again."""
    from valerie.rendering.base import View
    from valerie.rendering.raster.renderer import RasterRenderer

    sun, environment = CONDITIONS[condition]
    base = simple_asset().base
    lamp = Node("scene.lamp", Pose((0, 8, 5), (270, 0, 0)).matrix(), light=Light(intensity=200.0))
    scene = replace(
        base,
        nodes={**base.nodes, lamp.path: lamp},
        sun=Sun(*map(math.radians, sun)),
        environment=replace(base.environment, **environment),
    )
    raster, seconds = RasterRenderer(), []
    for _ in range(2):
        started = time.process_time()
        raster.full(scene, View(*VIEW))
        seconds.append(time.process_time() - started)
    raster.close()
    return {"condition": condition, "first": seconds[0], "again": seconds[1], "compiled": seconds[0] - seconds[1]}


def rows() -> Iterator[JsonObject]:
    """Measure each condition in a process of its own."""
    for condition in CONDITIONS:
        command = [sys.executable, "-m", "benchmarks.bench_shaders", "--condition", condition]
        environment = {**os.environ, "MESA_SHADER_CACHE_DISABLE": "true"}
        yield json.loads(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--condition", choices=list(CONDITIONS))
    condition = parser.parse_args().condition
    if condition:
        print(json.dumps(first_frames(condition)))
    else:
        results.write("shaders", {"cpu_seconds": results.print_rows(rows())})


if __name__ == "__main__":
    main()
