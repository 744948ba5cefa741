"""Measure the overhead per product: real processes and queues, engines of negligible cost.

Starts the one-machine mode (Redis, API with control loop, one worker per queue) with the blank engine and function on a tiny
asset, and reads the CPU time of every process:

- *feeding*: 30,000 variants in this process, as the control loop feeds them: every row written, every message sent to Redis,
  nothing processed;
- *running*: runs of growing size. ``--largest N`` sets the largest (default 30,000 variants of one camera: 120,001
  products; 100,000 take ten to twenty minutes of CPU);
- *beside*: with ``--beside N`` this only: a run of 8 frames alone, and in the middle of one of N products.
"""

from __future__ import annotations

import argparse
import itertools
import math
import statistics
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

from benchmarks import results
from tests.acceptance.system import System
from tests.world.boxes import write_box_street
from valerie.db import runs
from valerie.db.engine import reading, writing
from valerie.db.migrate import migrate
from valerie.embedded import redis_server
from valerie.pipeline.base.context import open_context
from valerie.pipeline.base.pinning import choose_pins
from valerie.pipeline.control.feeding import Feeder
from valerie.pipeline.control.submit import submit
from valerie.pipeline.functions.probe import probe_engine, probe_function
from valerie.runs.products.states import RunState
from valerie.runs.resolving.spec import parse
from valerie.settings import load_settings

SIZES = (1_000, 10_000, 30_000, 100_000)
FED = 30_000
#: Small runs of each kind.
BESIDE = 5


def document(variants: int) -> dict[str, Any]:
    """Return the spec of a run of exactly ``variants`` legal variants with one camera."""
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
    """Return the CPU seconds of each service so far, including its running and ended child processes."""
    return {name: tree_seconds(pid) for name, pid in system.supervisor.pids().items()}


def tree_seconds(pid: int) -> float:
    """Return the CPU seconds of a process so far, including its running and ended child processes."""
    total = 0.0
    for process in [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]:
        try:
            times = process.cpu_times()
        except psutil.NoSuchProcess:
            continue
        total += times.user + times.system + times.children_user + times.children_system
    return total


def redis_megabytes(system: System) -> float:
    """Return the resident memory of the broker."""
    process = psutil.Process(system.supervisor.pids()["redis"])
    return sum(p.memory_info().rss for p in [process, *process.children(recursive=True)]) / 1e6


def measure(system: System, variants: int) -> dict[str, Any]:
    """Measure one run."""
    before = cpu_seconds(system)
    started = time.perf_counter()
    run = system.submit(document(variants))
    accepted = time.perf_counter() - started
    broker = redis_megabytes(system)
    while True:
        progress = system.progress(run)
        broker = max(broker, redis_megabytes(system))
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
        "cpu_ms_per_product": round(1000 * sum(spent.values()) / products, 3),
        "cpu_ms_per_product_by_service": {name: round(1000 * value / products, 3) for name, value in spent.items()},
        "broker_mb": round(broker, 1),
        "poll_cpu_ms": round(1000 * poll, 2),
    }


def measure_beside(system: System, products: int) -> dict[str, Any]:
    """Measure small runs alone, then one after another while a large one is in work."""
    seeds = itertools.count()
    few_s(system, next(seeds))  # workers load the function
    alone = [few_s(system, next(seeds)) for _ in range(BESIDE)]
    large = system.submit(document(products // 4))
    system.wait(
        large, until=lambda progress: progress["stages"].get("eval", {}).get("done", 0) > products // 40, seconds=3600
    )
    before = system.progress(large)["stages"]["eval"]["done"]
    beside = [few_s(system, next(seeds)) for _ in range(BESIDE)]
    progress = system.progress(large)
    assert progress["state"] == "running", "the large run ended too early"
    system.client.post(f"/v1/runs/{large}/cancel").raise_for_status()
    return {
        "products": products,
        "alone": _medians(alone),
        "beside": _medians(beside),
        "evaluations_of_the_large_run_meanwhile": progress["stages"]["eval"]["done"] - before,
    }


def _medians(times: Sequence[tuple[float, float]]) -> dict[str, float]:
    firsts, ends = zip(*times, strict=True)
    return {"first_s": round(statistics.median(firsts), 2), "end_s": round(statistics.median(ends), 2)}


def few_s(system: System, seed: int) -> tuple[float, float]:
    """Return the seconds until a new run of 8 frames has its first product done, and until its end."""
    started, first = time.perf_counter(), math.inf

    def until(progress: dict[str, Any]) -> bool:
        nonlocal first
        if progress["stages"].get("render", {}).get("done", 0):
            first = min(first, time.perf_counter() - started)
        return False

    state = system.wait(system.submit(document(8) | {"seed": 1_000 + seed}), until=until)
    assert state == "completed", state
    ended = time.perf_counter() - started
    return min(first, ended), ended


def measure_feeding(folder: Path, assets: Path) -> dict[str, Any]:
    """Measure the feeding of `FED` variants: CPU seconds of this process for the rows, and for the messages."""
    folder.mkdir()
    socket = folder / "redis.sock"
    settings = load_settings(
        {},
        data_dir=folder,
        asset_dir=assets,
        broker_url=redis_server.server_url(socket),
        testing_engines=True,
        min_free_mb=0,
    )
    command = redis_server.server_command(redis_server.find_server(settings), socket, folder)
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        redis_server.wait_until_it_answers(socket, seconds=30)
        context = open_context(settings)
        migrate(context.engine)
        spec = parse(document(FED))
        pins, reason = choose_pins(spec, [*probe_engine("blank"), *probe_function("blank")], {})
        assert pins is not None, reason
        run_id = submit(context, spec)
        with writing(context.engine) as connection:
            runs.change_state(connection, run_id, expected=(RunState.SUBMITTED,), state=RunState.RUNNING, pins=pins)
        with reading(context.engine) as connection:
            run = runs.get(connection, run_id)
        rows = messages = 0.0
        feeder = Feeder(run, settings)
        following = 0
        while following < FED:
            started = time.process_time()
            fed = feeder.feed(context.engine, following, time.time())
            writing_ended = time.process_time()
            context.broker.send_products(fed.ready)
            rows += writing_ended - started
            messages += time.process_time() - writing_ended
            with reading(context.engine) as connection:
                following = runs.fed(connection, run_id).next_index
    finally:
        server.terminate()
        server.wait()
    return {"variants": FED, "rows_cpu_s": round(rows, 2), "messages_cpu_s": round(messages, 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=30_000)
    parser.add_argument("--beside", type=int, metavar="N")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        assets = Path(folder) / "assets"
        write_box_street(assets / "box-street")
        if chosen.beside:
            with System(Path(folder) / "data", assets) as system:
                beside = measure_beside(system, chosen.beside)
            print(beside)
            results.write("control-plane-beside", beside)
            return
        feeding = measure_feeding(Path(folder) / "fed", assets)
        print("feeding:", feeding)
        with System(Path(folder) / "data", assets) as system:
            runs = []
            for size in [size for size in SIZES if size <= chosen.largest]:
                runs.append(measure(system, size))
                print(runs[-1])
    results.write("control-plane", {"feeding": feeding, "runs": runs})


if __name__ == "__main__":
    main()
