"""Measure large runs, many workers, and a long time: real processes with engines of negligible cost, on Postgres.

``python -m benchmarks.bench_scale [runs] [workers] [soak]`` (default: all three, about two hours):

- *runs*: a run of 1,000,000 variants while it is submitted, followed, read and cancelled; a run of ``--products`` beside one of
  10,000: CPU time per product, memory of Redis, time to read a page of frames, and how long others wait while it is deleted.
- *workers*: products a second by 4 to 64 workers (a third per stage), the share of looks at which a session of the database
  waited for another's lock, and the CPU time per product.
- *soak*: ``--products`` in runs of 10,001, one after another over ``--hours``; each is deleted two runs later. Memory and open
  files of every process, the size of the database and the memory of Redis must not grow, and no log may have an error.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any, Final

import httpx
import psutil
import psycopg

from benchmarks import results
from benchmarks.bench_control_plane import cpu_seconds, document, measure, redis_megabytes, tree_seconds
from tests.acceptance.system import ENDED, System
from tests.world.boxes import write_box_street
from tests.world.postgres import PostgresServer
from valerie.embedded.guarded_process import python_command
from valerie.embedded.supervisor import WORKERS, service_environment
from valerie.pipeline.base.context import open_context
from valerie.pipeline.control import gc

PARTS: Final = ("runs", "workers", "soak")
MILLION: Final = 1_000_000
SMALL: Final = 2_500
MANY: Final = (4, 16, 64)
#: Variants for each number of workers, and as many more as joined, so that no run shares products with another.
WORKED: Final = 5_000
#: Pause between looks at the sessions of the database.
_LOOK_SECONDS: Final = 0.05


@contextmanager
def running(**settings: Any) -> Iterator[tuple[System, str]]:
    """Start a system on a Postgres server of its own; yield it with the URL of its database."""
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as name:
        folder = Path(name)
        folder.chmod(0o755)
        write_box_street(folder / "assets" / "box-street")
        (folder / "postgres").mkdir(mode=0o755)
        with PostgresServer(folder / "postgres", connections=400) as server:
            with psycopg.connect(server.url("postgres"), autocommit=True) as connection:
                connection.execute("CREATE DATABASE valerie")
            url = server.url("valerie")
            calm = {"lease_seconds": 60.0, "heartbeat_seconds": 5.0, "visibility_timeout_seconds": 600}
            with System(folder / "data", folder / "assets", database_url=url, **calm, **settings) as system:
                yield system, url


def timed(call: Callable[[], Any]) -> float:
    """Return the wall seconds of a call."""
    started = time.perf_counter()
    call()
    return time.perf_counter() - started


def measure_runs(products: int) -> dict[str, Any]:
    """Measure a run of a million variants, and one that is worked off."""
    with running() as (system, _):
        few = measure(system, SMALL)
        many = measure(system, products // 4)
        print(few, many, sep="\n", flush=True)
        run = system.client.get("/v1/runs", params={"limit": 1}).json()["items"][0]["id"]
        page = timed(lambda: system.client.get(f"/v1/runs/{run}/frames", params={"limit": 50}).raise_for_status())
        deleted, waited = _deleted(system, run)
        submitted = time.perf_counter()
        run = system.submit(document(MILLION))
        accepted = time.perf_counter() - submitted
        system.wait(run, until=lambda progress: progress["stages"].get("eval", {}).get("done", 0) > 0)
        poll = median(timed(lambda: system.progress(run)) for _ in range(50))
        first = timed(lambda: system.client.get(f"/v1/runs/{run}/frames", params={"limit": 50}).raise_for_status())
        cancelled = timed(lambda: system.client.post(f"/v1/runs/{run}/cancel").raise_for_status())
    return {
        "few": few,
        "many": many,
        "page_s": round(page, 3),
        "delete_s": round(deleted, 1),
        "longest_wait_while_deleting_s": round(waited, 3),
        "million": {
            "accepted_s": round(accepted, 3),
            "poll_ms": round(1000 * poll, 1),
            "page_s": round(first, 3),
            "cancel_s": round(cancelled, 3),
        },
    }


def _deleted(system: System, run: str) -> tuple[float, float]:
    """Delete a run; return the seconds, and the longest of the changes by another client meanwhile."""
    ended, waits = threading.Event(), [0.0]

    def change() -> None:
        with httpx.Client(base_url=system.supervisor.url, timeout=600) as client:
            while not ended.wait(0.05):
                waits.append(timed(lambda: client.post("/v1/runs", json=document(1)).raise_for_status()))

    thread = threading.Thread(target=change)
    thread.start()
    with httpx.Client(base_url=system.supervisor.url, timeout=3600) as client:
        seconds = timed(lambda: client.delete(f"/v1/runs/{run}").raise_for_status())
    ended.set()
    thread.join()
    return seconds, max(waits)


def measure_workers() -> list[dict[str, Any]]:
    """Measure growing numbers of workers on one run each."""
    rows = []
    with running() as (system, url):
        joined: list[subprocess.Popen[bytes]] = []
        try:
            for count in MANY:
                while len(joined) + len(WORKERS) < count:
                    name = list(WORKERS)[len(joined) % len(WORKERS)]
                    joined.append(_worker(system, name))
                _await_workers(system, count)
                rows.append({"workers": count, **_worked(system, url, joined)})
                print(rows[-1], flush=True)
        finally:
            for process in joined:
                process.terminate()
            for process in joined:
                process.wait()
    return rows


def _worker(system: System, name: str) -> subprocess.Popen[bytes]:
    with (system.supervisor.logs / f"further-{name}.log").open("ab") as log:
        environment = service_environment(name, system.supervisor.settings)
        return subprocess.Popen(python_command(WORKERS[name]), env=environment, stdout=log, stderr=log)


def _await_workers(system: System, count: int) -> None:
    deadline = time.monotonic() + 600
    while len(system.client.get("/v1/workers").json()) < count:
        assert time.monotonic() < deadline, f"{count} workers did not start"
        time.sleep(1)


def _worked(system: System, url: str, joined: list[subprocess.Popen[bytes]]) -> dict[str, Any]:
    """Work off one run; return its figures."""
    waiting: Counter[str] = Counter()
    looks = 0
    before, started = _cpu(system, joined), time.perf_counter()
    variants = WORKED + len(joined)
    run = system.submit(document(variants))
    with psycopg.connect(url, autocommit=True) as connection:
        while system.progress(run)["state"] not in ENDED:
            looks += 1
            states = connection.execute(
                "SELECT DISTINCT wait_event_type FROM pg_stat_activity WHERE state = 'active' AND pid <> pg_backend_pid()"
            )
            waiting.update(state for (state,) in states if state)
            time.sleep(_LOOK_SECONDS)
    seconds = time.perf_counter() - started
    products = 4 * variants + 1
    return {
        "products_per_second": round(products / seconds),
        "cpu_ms_per_product": round(1000 * (_cpu(system, joined) - before) / products, 2),
        "waits_for_locks": round(waiting["Lock"] / looks, 3),
        "processor": round((_cpu(system, joined) - before) / seconds, 2),
    }


def _cpu(system: System, joined: list[subprocess.Popen[bytes]]) -> float:
    return sum(cpu_seconds(system).values()) + sum(tree_seconds(worker.pid) for worker in joined)


def soak(products: int, hours: float) -> dict[str, Any]:
    """Work off runs of equal size over hours, and measure what grows."""
    size = 4 * SMALL + 1
    count = max(products // size, 5)
    pause = 3600 * hours / count
    samples: dict[str, list[float]] = defaultdict(list)
    with running() as (system, url):
        ids: list[str] = []
        started = time.monotonic()
        for number in range(count):
            ids.append(system.submit(document(SMALL)))
            assert system.wait(ids[-1], seconds=3600) == "completed"
            if len(ids) > 2:
                system.client.delete(f"/v1/runs/{ids.pop(0)}", timeout=600).raise_for_status()
                gc.collect(open_context(system.settings))
            for name, value in _sizes(system, url).items():
                samples[name].append(value)
            print(
                f"{number + 1} of {count}", {name: round(values[-1], 1) for name, values in samples.items()}, flush=True
            )
            time.sleep(max(0.0, started + (number + 1) * pause - time.monotonic()))
        errors = _errors(system.supervisor.logs)
    fifth = max(count // 5, 1)
    growth = {
        name: {"early": round(early, 1), "late": round(late, 1), "growth_percent": round(100 * (late / early - 1), 1)}
        for name, values in samples.items()
        for early, late in [(median(values[fifth : 2 * fifth]), median(values[-fifth:]))]
    }
    return {"products": size * count, "hours": hours, "growth": growth, "errors": errors}


def _sizes(system: System, url: str) -> dict[str, float]:
    """Return memory in MB and open files of every service, and the sizes of Redis and of the database in MB."""
    sizes: dict[str, float] = {}
    for name, pid in system.supervisor.pids().items():
        parent = psutil.Process(pid)
        processes = [parent, *parent.children(recursive=True)]
        sizes[f"{name} MB"] = sum(process.memory_info().rss for process in processes) / 1e6
        sizes[f"{name} files"] = float(sum(process.num_fds() for process in processes))
    sizes["redis MB"] = redis_megabytes(system)
    with psycopg.connect(url) as connection:
        row = connection.execute("SELECT pg_database_size(current_database())").fetchone()
    assert row is not None
    sizes["database MB"] = row[0] / 1e6
    return sizes


def _errors(logs: Path) -> list[str]:
    """Return the lines of the logs that tell of an error."""
    pattern = re.compile(r"error|critical|traceback|exception", re.IGNORECASE)
    return [
        f"{path.name}: {line[:300]}"
        for path in sorted(logs.glob("*.log"))
        for line in path.read_text(errors="replace").splitlines()
        if pattern.search(line)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=PARTS)
    parser.add_argument("--products", type=int, default=200_000)
    parser.add_argument("--hours", type=float, default=2.0)
    chosen = parser.parse_args()
    measures: dict[str, Callable[[], Any]] = {
        "runs": lambda: measure_runs(chosen.products),
        "workers": measure_workers,
        "soak": lambda: soak(chosen.products, chosen.hours),
    }
    for part in chosen.parts or PARTS:
        figures = measures[part]()
        print(figures)
        results.write(f"scale_{part}", {part: figures})


if __name__ == "__main__":
    main()
