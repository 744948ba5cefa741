"""Plan damaged specs over REST: ``python -m tests.hostile [--specs 20000] [--first 1]``.

The exit code is 1 if an answer is neither a plan nor a problem in words, or if the server grows too much. The longest times
are printed.
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
import psutil

from services.api.app import create_app
from tests.hostile.mutations import hostile_text, specs
from tests.world.drawn import DrawnWorld
from tests.world.serving import served
from tests.world.world import settings_of

EXAMPLES: Final = Path(__file__).parents[2] / "examples"
PATIENCE_SECONDS: Final = 60
MOST_MB: Final = 300.0


def complaint(answer: httpx.Response) -> str:
    """Return what is wrong with an answer; empty if nothing is."""
    if answer.status_code == 200:
        return "" if answer.json()["variants"] >= 0 else "a plan without variants"
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
    whole, process = specs(EXAMPLES), psutil.Process()
    with tempfile.TemporaryDirectory(prefix="valerie-hostile-") as folder:
        settings = settings_of(Path(folder), log_level="error")
        DrawnWorld(settings).context.engine.dispose()
        with served(create_app(settings, control=False)) as client:
            client.timeout = httpx.Timeout(PATIENCE_SECONDS)
            for document in whole:
                client.post("/v1/plan", json=document)
            before = most = process.memory_info().rss
            started, statuses = time.monotonic(), Counter[int]()
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
                most = max(most, process.memory_info().rss)
                statuses[answer.status_code] += 1
                slow.append((took, seed))
                if found := complaint(answer):
                    wrong += 1
                    print(f"seed {seed}: {found}", flush=True)
                if seed % 1000 == 0:
                    rate = len(slow) / (time.monotonic() - started)
                    print(f"{len(slow):,} specs, {rate:.0f}/s, slowest {max(slow)}", flush=True)
    grown = (most - before) / 2**20
    slow.sort(reverse=True)
    print(f"{len(slow):,} specs: {dict(statuses)}; slowest (CPU s, seed) {slow[:3]}; {grown:.0f} MB more")
    if wrong or grown > MOST_MB:
        sys.exit(1)


if __name__ == "__main__":
    main()
