"""What a product costs beside its computation: real processes, real queues, engines that cost nothing.

Starts the one-machine mode (Redis, API with control loop, one worker per queue) with the blank engine and function on a tiny
asset, submits runs of growing size and reads the CPU time of every process. ``--largest N`` sets the largest run (default
30,000 variants of one camera: 120,001 products; 100,000 take about an hour of CPU).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from benchmarks import results
from tests.acceptance.system import System, write_box_street

SIZES = (1_000, 10_000, 30_000, 100_000)


def document(variants: int) -> dict[str, Any]:
    """A run of exactly ``variants`` legal variants seen by one camera."""
    return {
        "name": f"{variants} variants",
        "asset": "box-street",
        "seed": variants,
        "design": "random",
        "count": variants,
        "vary": [
            ["person-1.pos.x", "UNIFORM", -3.0, 0.7],
            ["person-1.pos.y", "UNIFORM", 2.0, 11.0],
        ],
        "cameras": ["camera-1"],
        "renderer": "blank",
        "functions": ["blank"],
        "resolution": {"width": 32, "height": 18},
    }


def cpu_seconds(system: System) -> dict[str, float]:
    """CPU seconds that each service used so far, its children included, the dead ones too."""
    used: dict[str, float] = {}
    for name, pid in system.supervisor.pids().items():
        total = 0.0
        for process in [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]:
            try:
                times = process.cpu_times()
            except psutil.NoSuchProcess:
                continue
            total += times.user + times.system + times.children_user + times.children_system
        used[name] = total
    return used


def redis_megabytes(system: System) -> float:
    """Resident memory of the broker."""
    process = psutil.Process(system.supervisor.pids()["redis"])
    return sum(p.memory_info().rss for p in [process, *process.children(recursive=True)]) / 1e6


def measure(system: System, variants: int) -> dict[str, Any]:
    """One run."""
    before = cpu_seconds(system)
    started = time.perf_counter()
    run = system.submit(document(variants))
    accepted = time.perf_counter() - started
    broker = redis_megabytes(system)
    fed: dict[str, float] | None = None
    while True:
        progress = system.progress(run)
        broker = max(broker, redis_megabytes(system))
        if fed is None and progress["variants"]["fed"] == variants:
            fed = cpu_seconds(system)
        if progress["state"] not in ("submitted", "running", "finishing"):
            break
        time.sleep(0.5)
    assert progress["state"] == "completed", progress
    after = cpu_seconds(system)
    products = 4 * variants + 1
    polls = 50
    poll_before = cpu_seconds(system)["api"]
    for _ in range(polls):
        system.progress(run)
    poll = (cpu_seconds(system)["api"] - poll_before) / polls
    spent = {name: after[name] - before[name] for name in after}
    return {
        "variants": variants,
        "products": products,
        "accepted_s": round(accepted, 3),
        "feed_cpu_s": round((fed or after)["api"] - before["api"], 2),
        "cpu_ms_per_product": round(1000 * sum(spent.values()) / products, 3),
        "cpu_ms_per_product_by_service": {name: round(1000 * value / products, 3) for name, value in spent.items()},
        "broker_mb": round(broker, 1),
        "poll_cpu_ms": round(1000 * poll, 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=30_000)
    largest = parser.parse_args().largest
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        write_box_street(Path(folder) / "assets" / "box-street")
        with System(Path(folder) / "data", Path(folder) / "assets") as system:
            runs = []
            for size in [size for size in SIZES if size <= largest]:
                runs.append(measure(system, size))
                print(runs[-1])
    results.write("control-plane", {"runs": runs})


if __name__ == "__main__":
    main()
