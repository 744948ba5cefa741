"""Ask several questions about the domain of ``examples/guided.yaml``, and keep the report of each in ``docs/guided/``.

``make guided`` calls this. Stored products are reused, so an interrupted command goes on where it stopped.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Final

import yaml

from valerie.plain import JsonObject

ROOT: Final = Path(__file__).parents[1]
SPEC: Final = ROOT / "examples" / "guided.yaml"
KEPT: Final = ROOT / "docs" / "guided"
#: Studies that are made here.
MADE: Final = ROOT / "var"
#: Variants of the plain Monte Carlo estimate: ten times those of the guided one.
PLAIN: Final = 2560
#: Fields of each study that differ from the example.
STUDIES: Final[dict[str, JsonObject]] = {
    "failure-rate": {},
    "failure-rate-plain": {
        "goal": {"name": "estimate", "first": PLAIN},
        "budget": {"variants": PLAIN},
        "batch": 256,
        "seed": 1,
    },
    "boundary": {"goal": "map"},
    "ranking": {"goal": "rank", "budget": {"variants": 512}},
    **{
        f"pair-{number}": {"goal": "explain", "budget": {"variants": 96}, "batch": 16, "seed": number}
        for number in range(1, 6)
    },
}


def main() -> None:
    """Run every study in turn and print its answer and cost."""
    example = yaml.safe_load(SPEC.read_text())
    MADE.mkdir(exist_ok=True)
    KEPT.mkdir(exist_ok=True)
    for name, changes in STUDIES.items():
        file = MADE / f"guided-{name}.yaml"
        file.write_text(yaml.safe_dump({**example, **changes, "name": name}, sort_keys=False))
        command = [sys.executable, "-m", "valerie", "study", "run", str(file), "--json"]
        command += ["--report", str(KEPT / f"{name}.html")]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            raise SystemExit(done.returncode)
        study = json.loads(done.stdout.splitlines()[-1])
        batches = [batch for batch in study["batches"] if batch["legal"]]
        seconds = sum(batch["cpu_seconds"] or 0 for batch in batches)
        print(f"{name}: {sum(batch['legal'] for batch in batches)} variants, {seconds:.0f} CPU-s")
        print(*study["result"]["sentences"], sep="\n", flush=True)


if __name__ == "__main__":
    main()
