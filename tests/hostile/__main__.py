"""Plan damaged specs over REST: ``python -m tests.hostile [--specs 20000] [--first 1]``.

The exit code is 1 if an answer is neither a plan nor a problem in words, if one takes too much CPU time, or if the server's
memory peaks too high. The longest times are printed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Final

import httpx

from services.api.app import create_app
from tests.hostile.mutations import hostile_text, specs
from tests.world.drawn import DrawnWorld
from tests.world.serving import served
from tests.world.world import settings_of

EXAMPLES: Final = Path(__file__).parents[2] / "examples"
PATIENCE_SECONDS: Final = 60
#: CPU time of an answer: another process may hold up the clock on the wall.
MOST_SECONDS: Final = 2.0
#: CPU time beyond that per moment of a variant where a plan examines all of them.
SECONDS_PER_MOMENT: Final = 0.001
MOST_MB: Final = 300.0


def peak_mb() -> float:
    """Return the largest memory of this process, the server's, since `forget_peak`."""
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 1024


def forget_peak() -> None:
    """Begin `peak_mb` again at the present memory."""
    Path("/proc/self/clear_refs").write_text("5")


def complaint(answer: httpx.Response, seconds: float) -> str:
    """Return what is wrong with an answer that took CPU seconds; empty if nothing is."""
    plan = answer.json() if answer.status_code == 200 else None
    examined = plan["variants"] * plan["moments"] if plan and not plan["estimated"] else 0
    most = MOST_SECONDS + SECONDS_PER_MOMENT * examined
    if seconds > most:
        return f"{seconds:.1f} CPU-s; limit: {most:.1f}"
    if plan:
        return "" if plan["variants"] >= 0 else "a plan without variants"
    if answer.status_code not in (413, 422):
        return f"status {answer.status_code}: {answer.text[:200]}"
    detail = answer.json().get("detail", "")
    if not 0 < len(detail) < 20_000 or "Traceback" in answer.text:
        return f"no problem in words: {answer.text[:200]}"
    return ""


def main() -> None:
    """Plan the specs, and print what is wrong with the answers."""
    parser = argparse.ArgumentParser(prog="tests.hostile", description=__doc__)
    parser.add_argument("--specs", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=1, help="seed of the first spec")
    arguments = parser.parse_args()
    whole = specs(EXAMPLES)
    with tempfile.TemporaryDirectory(prefix="valerie-hostile-") as folder:
        settings = settings_of(Path(folder), log_level="error")
        DrawnWorld(settings).context.engine.dispose()
        with served(create_app(settings, control=False)) as client:
            client.timeout = httpx.Timeout(PATIENCE_SECONDS)
            for document in whole:
                client.post("/v1/plan", json=document)
            forget_peak()
            before, started, statuses = peak_mb(), time.monotonic(), Counter[int]()
            slow: list[tuple[float, int]] = []
            wrong = 0
            for seed in range(arguments.first, arguments.first + arguments.specs):
                text = hostile_text(whole, seed)
                asked = time.process_time()
                try:
                    answer = client.post("/v1/plan", content=text)
                except httpx.TimeoutException:
                    sys.exit(f"seed {seed}: no answer within {PATIENCE_SECONDS} s")
                took = time.process_time() - asked
                statuses[answer.status_code] += 1
                slow.append((took, seed))
                if found := complaint(answer, took):
                    wrong += 1
                    print(f"seed {seed}: {found}", flush=True)
                if seed % 1000 == 0:
                    rate = len(slow) / (time.monotonic() - started)
                    print(f"{len(slow):,} specs, {rate:.0f}/s, slowest {max(slow)}", flush=True)
            grown = peak_mb() - before
    slow.sort(reverse=True)
    print(
        f"{len(slow):,} specs: {dict(statuses)}; slowest (CPU s, seed) {slow[:3]}; peak {grown:.0f} MB above the start"
    )
    if wrong or grown > MOST_MB:
        sys.exit(1)


if __name__ == "__main__":
    main()
