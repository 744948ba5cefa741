"""CPU seconds per frame of `raster` and `pyrender` on the same variants, side by side, each engine in its own process.

A frame is a movable layer and its ground truth; backgrounds are timed apart. ``python benchmarks/bench_renderers.py
[--frames N] [--width W --height H]``
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from statistics import median

from benchmarks import results

ENGINES = ("raster", "pyrender")


def measure(engine: str, frames: int, width: int, height: int) -> dict[str, object]:
    """In this process: one engine on ``frames`` variants."""
    from valerie import plugins
    from valerie.rendering.base import View
    from valerie.scene.asset import load_asset
    from valerie.scene.variation import apply

    asset = load_asset("urban-street")
    renderer, truth = plugins.create_renderer(engine), plugins.create_truth_pass("")
    triangles = sum(len(mesh.faces) for node in asset.base.nodes.values() for mesh in node.meshes)
    view = View("camera-1", width, height)
    scenes = [
        apply({"scene.person-1.pos.x": 1.5 + 0.3 * (i % 8), "scene.person-1.pos.y": 8.0 + i % 18}, asset)
        for i in range(frames + 1)
    ]

    def seconds(call: object) -> float:
        started = time.process_time()
        call()  # type: ignore[operator]
        return time.process_time() - started

    background = seconds(lambda: renderer.background(scenes[0], view))
    renderer.layer(scenes[0], view)
    truth.truth(scenes[0], view)
    layers = [seconds(lambda s=scene: renderer.layer(s, view)) for scene in scenes[1:]]
    truths = [seconds(lambda s=scene: truth.truth(s, view)) for scene in scenes[1:]]
    return {
        "numeric_class": renderer.numeric_class,
        "triangles": triangles,
        "background_cpu_s": round(background, 3),
        "layer_cpu_s": round(median(layers), 4),
        "truth_cpu_s": round(median(truths), 4),
        "cpu_s_per_frame": round(median(layers) + median(truths), 4),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--width", type=int, default=960)
    parser.add_argument("--height", type=int, default=540)
    parser.add_argument("--engine", choices=ENGINES, help="one engine, in this process, as JSON")
    arguments = parser.parse_args()
    if arguments.engine:
        print(json.dumps(measure(arguments.engine, arguments.frames, arguments.width, arguments.height)))
        return
    figures: dict[str, object] = {"width": arguments.width, "height": arguments.height, "frames": arguments.frames}
    size = [f"--frames={arguments.frames}", f"--width={arguments.width}", f"--height={arguments.height}"]
    for engine in ENGINES:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.bench_renderers", f"--engine={engine}", *size],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1"},
        )
        figures[engine] = json.loads(done.stdout.strip().splitlines()[-1])
        print(f"{engine:10}", json.dumps(figures[engine]))
    ratio = figures["pyrender"]["cpu_s_per_frame"] / figures["raster"]["cpu_s_per_frame"]  # type: ignore[index]
    figures["ratio"] = round(ratio, 1)
    print(f"pyrender takes {ratio:.1f} times the CPU seconds of raster per frame")
    results.write("renderers", figures)


if __name__ == "__main__":
    main()
