"""Measure CPU seconds per frame with a rolling shutter: 960 × 540, `urban-street`, one walking person.

Lines are read every 20 µs, with a standing camera also every 100 and 1,000 µs; the camera stands, turns by 30° per second (a
bend) or drives at 10 m/s. The frame's background, layer and truth are not counted. ``python -m benchmarks.bench_rolling_shutter``
writes ``var/bench/rolling-shutter.json``.
"""

from __future__ import annotations

import time
from functools import partial

from benchmarks import results
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.scanning import Readout, scan
from valerie.scene.assets.asset import load_asset
from valerie.scene.graph.model import Scene
from valerie.scene.variation.variant import apply
from valerie.sensing.sensor import read_lines
from valerie.sensing.settings import SensorSetting

VIEW = View("camera-1", 960, 540)
#: Turn rate in degrees per second, and speed in metres per second, of each camera.
CAMERAS = {"stands": (0.0, 0.0), "turns": (30.0, 0.0), "drives": (0.0, 10.0)}
LINE_TIMES_US = (20, 100, 1000)


def main() -> None:
    """Measure each camera and line time once, after a first measurement that loads the engine."""
    asset, engine, truth_pass = load_asset("urban-street"), RasterRenderer(), TruthPass()
    start = float(asset.manifest.by_path["scene.camera-1.pos.y"].default)

    def moment(camera: str, seconds: float) -> Scene:
        turns, drives = CAMERAS[camera]
        return apply(
            {
                "scene.person-1.pos.x": 1.5 * seconds, "scene.person-1.pos.y": max(start, 0.0) + 10.0,
                "scene.camera-1.yaw": turns * seconds, "scene.camera-1.pos.y": start + drives * seconds,
            },
            asset,
        )  # fmt: skip

    figures: dict[str, float] = {}
    for camera in ("stands", *CAMERAS):
        now = moment(camera, 0.0)
        frame = engine.layer(now, VIEW).over(engine.background(now, VIEW)), truth_pass.truth(now, VIEW)
        for line_time in LINE_TIMES_US:
            if line_time != LINE_TIMES_US[0] and camera != "stands":
                continue  # minutes: at 1,000 us, each line is a slice
            reading = Readout(read_lines(SensorSetting(), VIEW.width, VIEW.height), line_time * 1e-6)
            began = time.process_time()
            scan(engine, truth_pass, partial(moment, camera), VIEW, frame, reading)
            figures[f"{camera}, {line_time} us"] = round(time.process_time() - began, 2)
            print(camera, line_time, figures[f"{camera}, {line_time} us"], flush=True)
    results.write("rolling-shutter", {"cpu_seconds": figures})


if __name__ == "__main__":
    main()
