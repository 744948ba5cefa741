"""Ask several questions about the domain of ``examples/guided.yaml``, and keep the report of each in ``docs/guided/``.

``make guided`` calls this. Stored products are reused, so an interrupted command goes on where it stopped. The verdicts of the
boundary's map are judged by the variants of the plain Monte Carlo estimate, which it does not know.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Final

import numpy as np
import yaml

from valerie.db import studies
from valerie.db.engine import reading
from valerie.guided.map import Call, Map
from valerie.local.deployment import context_of
from valerie.pipeline.control.studies.advancing import informed_pursuit
from valerie.pipeline.control.studies.resolving import resolve_row
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
    ids: dict[str, str] = {}
    for name, changes in STUDIES.items():
        file = MADE / f"guided-{name}.yaml"
        file.write_text(yaml.safe_dump({**example, **changes, "name": name}, sort_keys=False))
        command = [sys.executable, "-m", "valerie", "study", "run", str(file), "--json"]
        command += ["--report", str(KEPT / f"{name}.html")]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            raise SystemExit(done.returncode)
        study = json.loads(done.stdout.splitlines()[-1])
        ids[name] = study["id"]
        batches = [batch for batch in study["batches"] if batch["legal"]]
        seconds = sum(batch["cpu_seconds"] or 0 for batch in batches)
        print(f"{name}: {sum(batch['legal'] for batch in batches)} variants, {seconds:.0f} CPU-s")
        print(*study["result"]["sentences"], sep="\n", flush=True)
    print(judged(ids["boundary"], ids["failure-rate-plain"]))


def judged(boundary: str, plain: str) -> str:
    """Return a sentence on the wrong verdicts of a map, by the variants of another study of its domain.

    Args:
        boundary, plain: ids of the studies.
    """
    with context_of(None) as context:
        with reading(context.engine) as connection:
            study, batches = studies.get(connection, boundary), studies.batches(connection, boundary)
            others = studies.batches(connection, plain)
        strategy = informed_pursuit(resolve_row(context, study), batches).strategy
    assert isinstance(strategy, Map)
    points = np.concatenate([np.asarray(batch.points) for batch in others if batch.outcomes])
    scores = np.concatenate([np.asarray(batch.outcomes.values) for batch in others if batch.outcomes])
    calls = strategy.calls(points)
    true = np.select([np.isnan(scores), scores < strategy.at_least], [Call.UNDEFINED, Call.FAIL], Call.PASS)
    called = calls != Call.NOT_KNOWN
    wrong = np.count_nonzero(calls[called] != true[called])
    return f"boundary: {wrong} of its {np.count_nonzero(called)} verdicts on {len(points)} other variants are wrong"


if __name__ == "__main__":
    main()
