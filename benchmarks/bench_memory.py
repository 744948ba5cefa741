"""Measure the memory of each worker over many frames, which must not grow: real processes, the raster engine, both networks.

``python -m benchmarks.bench_memory [--frames 2000]`` samples the resident memory of each worker throughout. The figure is the
median of the last fifth minus the median of the second fifth (the first fifth warms up).

``--rendering-only`` measures only the render worker's part, in this process: layers and truths of small frames with changing
places, suns and cameras, encoded and dropped. It writes ``var/bench/memory_rendering.json``.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
import psutil

from benchmarks import results
from tests.acceptance.system import System
from valerie import plugins
from valerie.parameters.definitions import Value
from valerie.perception.shipped import FUNCTIONS
from valerie.rendering.base import View
from valerie.scene.assets.asset import load_asset
from valerie.scene.variation.variant import apply
from valerie.storage import codecs

#: Consecutive frames with one camera and sun with ``--rendering-only``.
GROUP = 40


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--rendering-only", action="store_true")
    arguments = parser.parse_args()
    frames = arguments.frames
    if frames < 5:
        parser.error(f"--frames {frames}: at least 5, one for each fifth")
    if arguments.rendering_only:
        results.write("memory_rendering", rendering_only(frames))
        return
    side = math.ceil(math.sqrt(frames))
    document = {
        "name": f"memory over {frames} frames",
        "asset": "urban-street",
        "design": "sobol",
        "count": side * side,
        "vary": [["person-1.pos.x", "UNIFORM", 1.4, 3.6], ["person-1.pos.y", "UNIFORM", 5.0, 60.0]],
        "cameras": ["camera-1"],
        "resolution": {"width": 320, "height": 180},
        "functions": list(FUNCTIONS),
    }
    samples: dict[str, list[tuple[int, float]]] = {"render": [], "infer": [], "eval": [], "api": []}
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        settings = {"render_engines": "raster", "infer_functions": ",".join(FUNCTIONS)}
        slow = {"lease_seconds": 60.0, "heartbeat_seconds": 5.0, "visibility_timeout_seconds": 600}
        with System(Path(folder) / "data", Path(folder) / "assets", **settings, **slow) as system:
            run = system.submit(document)
            while (progress := system.progress(run))["state"] in ("submitted", "running", "finishing"):
                done = progress["stages"].get("eval", {}).get("done", 0)
                for name, values in samples.items():
                    values.append((done, sum(p.memory_info().rss for p in system.processes(name)) / 1e6))
                time.sleep(1.0)
            assert progress["state"] == "completed", progress
    figures: dict[str, object] = {"frames": side * side}
    for name, values in samples.items():
        figures[name] = _growth(name, values)
    results.write("memory", figures)


def rendering_only(frames: int) -> dict[str, object]:
    """Measure the memory of the render worker's part over ``frames`` frames of 96 × 54 pixels."""
    asset = load_asset("urban-street")
    engine, truth_pass = plugins.create_renderer("raster"), plugins.create_truth_pass("")
    process, random = psutil.Process(), np.random.default_rng(0)
    values: list[tuple[int, float]] = []
    for i in range(frames):
        group = i // GROUP
        pose: dict[str, Value] = {
            "scene.person-1.pos.x": float(random.uniform(1.4, 3.6)),
            "scene.person-1.pos.y": float(random.uniform(5.0, 60.0)),
            "scene.person-1.heading": float(random.uniform(0.0, 360.0)),
            "scene.person-1.character": ("black-outfit", "yellow-shirt")[i % 2],
            "scene.sun-1.azimuth": 120.0 + 10.0 * (group % 14),
        }
        scene, view = apply(pose, asset), View(f"camera-{1 + group % 3}", 96, 54)
        if i % GROUP == 0:
            codecs.encode_image(engine.background(scene, view))
        codecs.encode_layer(engine.layer(scene, view))
        statics, truth = truth_pass.parts(scene, view)
        codecs.encode_truth_layer(truth, codecs.statics_digest(statics))
        values.append((i, process.memory_info().rss / 1e6))
    return {"frames": frames, "frames_per_camera_and_sun": GROUP, "rendering": _growth("rendering", values)}


def _growth(name: str, values: list[tuple[int, float]]) -> dict[str, float]:
    """Return and print the growth of (frames done, megabytes) from the second fifth to the last."""
    total = max(done for done, _ in values)
    early = median(mb for done, mb in values if 0.2 * total <= done < 0.4 * total)
    late = median(mb for done, mb in values if done >= 0.8 * total)
    print(f"{name:9} {early:7.0f} MB → {late:7.0f} MB")
    return {
        "early_mb": round(early),
        "late_mb": round(late),
        "growth_percent": round(100 * (late / early - 1), 1),
    }


if __name__ == "__main__":
    main()
