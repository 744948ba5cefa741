"""Measure `valerie run examples/first-run.yaml` in a new data folder: wall time, and CPU seconds by process and by product.

``python -m benchmarks.bench_first_run [--beside CHECKOUT] [--repeats 1]``. With ``--beside``, the code of another checkout runs
the same spec in turn, so that both compete with the same load on a busy machine. The last columns are the wall time that an
otherwise idle machine would have taken, and its ratio to the wall time if every core had worked throughout. It is estimated from
samples: CPU time passes at the rate of as many cores as the run has threads that want one.
"""

from __future__ import annotations

import argparse
import os
import resource
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from operator import itemgetter
from pathlib import Path
from statistics import median
from typing import Any, Final

import psutil

from benchmarks import results

SPEC: Final = Path("examples/first-run.yaml").absolute()
_HERE: Final = Path(__file__).parents[1]
_LOOK_SECONDS: Final = 0.2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beside", type=Path, metavar="CHECKOUT", help="another checkout to measure in turn")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--spec", type=Path, default=SPEC)
    arguments = parser.parse_args()
    checkouts = {"here": _HERE}
    if arguments.beside:
        checkouts = {"beside": arguments.beside.absolute(), **checkouts}
    figures: dict[str, list[dict[str, Any]]] = {name: [] for name in checkouts}
    for _ in range(arguments.repeats):
        for name, checkout in checkouts.items():
            figures[name].append(measure(checkout, arguments.spec.absolute()))
            show(name, figures[name][-1])
    cores = os.cpu_count() or 1
    for name, runs in figures.items():
        wall, cpu, idle = (median(run[key] for run in runs) for key in ("wall_s", "cpu_s", "idle_machine_wall_s"))
        ratio = f"{idle * cores / cpu:.2f} × CPU seconds / cores"
        print(f"{name:7} {wall:7.1f} s wall {cpu:7.1f} CPU s   on an idle machine {idle:.1f} s, {ratio}")
    results.write("first_run", figures)


def measure(checkout: Path, spec: Path) -> dict[str, Any]:
    """Run the spec once with the code of a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_WAIT_POLICY", "LP_NUM_THREADS"):
        environment.pop(name, None)  # those of `valerie run`
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        command = [sys.executable, "-m", "valerie", "run", str(spec), "--data-dir", folder, "--json"]
        before, started = _children_cpu(), time.monotonic()
        process = subprocess.Popen(
            command, env=environment, cwd=checkout, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        watch = _Watch(process.pid)
        _, complaints = process.communicate()
        wall, cpu = time.monotonic() - started, _children_cpu() - before
        if process.returncode:
            raise SystemExit(complaints)
        with sqlite3.connect(Path(folder) / "valerie.sqlite3") as database:
            rows = database.execute("select kind, sum(cpu_seconds) from products group by kind").fetchall()
    return {
        "wall_s": round(wall, 1),
        "cpu_s": round(cpu, 1),
        "products_cpu_s": {kind: round(seconds, 1) for kind, seconds in rows if seconds},
        "processes_cpu_s": watch.finish(),
        "idle_machine_wall_s": round(watch.idle_wall_s, 1),
    }


def _children_cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class _Watch:
    """Samples the CPU times of all descendants of a process; CPU time after a process's last sample is missing."""

    def __init__(self, pid: int) -> None:
        self._root = psutil.Process(pid)
        self._seconds: dict[tuple[str, int], float] = {}
        self.idle_wall_s = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def finish(self) -> dict[str, float]:
        """Return CPU seconds by kind of process, the largest first."""
        self._stop.set()
        self._thread.join()
        sums: defaultdict[str, float] = defaultdict(float)
        for (name, _), seconds in self._seconds.items():
            sums[name] += seconds
        return {name: round(seconds, 1) for name, seconds in sorted(sums.items(), key=itemgetter(1), reverse=True)}

    def _run(self) -> None:
        cores = os.cpu_count() or 1
        looked = time.monotonic()
        while not self._stop.wait(_LOOK_SECONDS):
            try:
                processes = [self._root, *self._root.children(recursive=True)]
            except psutil.NoSuchProcess:
                return
            before, passed = sum(self._seconds.values()), time.monotonic() - looked
            looked, wanting = looked + passed, sum(_wanting(process.pid) for process in processes)
            for process in processes:
                try:
                    times, words = process.cpu_times(), process.cmdline()
                    kind = "child" if self._is_fork(process) else "main"
                except psutil.Error:
                    continue
                if not words:  # it has ended, and was counted under its name
                    continue
                module = words[words.index("-m") + 1 :][:3] if "-m" in words else words[:1]
                parent = "" if "probe" in " ".join(module) else f" ({kind})"
                self._seconds[" ".join(module[: 1 if parent else 3]) + parent, process.pid] = times.user + times.system
            used = sum(self._seconds.values()) - before
            # On an idle machine, each thread that wants a core has one; where none does, the run waits for something else.
            self.idle_wall_s += used / min(max(wanting, 1), cores) + (0.0 if wanting else passed)

    @staticmethod
    def _is_fork(process: psutil.Process) -> bool:
        parent = process.parent()
        return parent is not None and parent.cmdline() == process.cmdline()


def _wanting(pid: int) -> int:
    """Return the number of a process's threads that run or wait for a core."""
    count = 0
    for path in Path(f"/proc/{pid}/task").glob("*/stat"):
        try:
            count += path.read_text().rpartition(")")[2].split()[0] in "RD"
        except OSError:  # it has ended
            continue
    return count


def show(name: str, run: dict[str, Any]) -> None:
    """Print one run."""
    print(f"{name}: {run['wall_s']} s wall, {run['cpu_s']} CPU s")
    for title in ("products", "processes"):
        parts = ", ".join(f"{kind} {seconds}" for kind, seconds in run[f"{title}_cpu_s"].items() if seconds >= 0.05)
        print(f"  CPU s of {title}: {parts}", flush=True)


if __name__ == "__main__":
    main()
