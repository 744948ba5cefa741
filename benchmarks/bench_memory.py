"""Memory of each worker over many frames: real processes with the raster engine and both networks; it must be flat.

``python -m benchmarks.bench_memory [--frames 2000]``: the resident memory of each worker is sampled all along; the figure is
how much the median of the last fifth lies above the median of the second fifth (the first fifth warms up).
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path
from statistics import median

from benchmarks import results
from tests.acceptance.system import System


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=2000)
    frames = parser.parse_args().frames
    side = math.ceil(math.sqrt(frames))
    document = {
        "name": f"memory over {frames} frames",
        "asset": "urban-street",
        "design": "sobol",
        "count": side * side,
        "vary": [["person-1.pos.x", "UNIFORM", 1.4, 3.6], ["person-1.pos.y", "UNIFORM", 5.0, 60.0]],
        "cameras": ["camera-1"],
        "resolution": {"width": 320, "height": 180},
        "functions": ["deeplabv3plus-small", "semantic-fpn-small"],
    }
    samples: dict[str, list[tuple[int, float]]] = {"render": [], "infer": [], "eval": [], "api": []}
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        settings = {"render_engines": "raster", "infer_functions": ",".join(document["functions"])}
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
        total = max(done for done, _ in values)
        early = median(mb for done, mb in values if 0.2 * total <= done < 0.4 * total)
        late = median(mb for done, mb in values if done >= 0.8 * total)
        figures[name] = {
            "early_mb": round(early),
            "late_mb": round(late),
            "growth_percent": round(100 * (late / early - 1), 1),
        }
        print(f"{name:8} {early:7.0f} MB → {late:7.0f} MB")
    results.write("memory", figures)


if __name__ == "__main__":
    main()
