"""`python -m tests.chaos --seed 17 --schedules 1` repeats one schedule; more schedules have the seeds that follow."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable

from benchmarks import results
from tests.chaos.faults import DIALS, FAULTS, MOUNTED, POSTGRES
from tests.chaos.schedule import DATABASES, Outcome, drawn, play
from valerie.plain import JsonObject

#: Set in the process that has its own view of the mounted file systems.
_OWN_MOUNTS = "VALERIE_TEST_OWN_MOUNTS"


def main() -> int:
    """Return 1 where an invariant was violated."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("--schedules", type=int, default=10, help="number of seeds to try on each database")
    parser.add_argument("--database", action="append", choices=DATABASES, help="only this one; may be repeated")
    parser.add_argument("--fault", action="append", choices=sorted(FAULTS), help="only this one; may be repeated")
    arguments = parser.parse_args()
    lacking = lacking_here()
    for fault, reason in lacking.items():
        print(f"left out: {fault} ({reason})")
    options = "".join(f" --fault '{fault}'" for fault in arguments.fault or ())
    outcomes: list[Outcome] = []
    for database in arguments.database or DATABASES:
        faults = [fault for fault in arguments.fault or FAULTS if fault not in lacking]
        faults = [fault for fault in faults if database == "postgres" or fault not in POSTGRES]
        calm = reported(play(database, 0, (), outcomes[0] if outcomes else None), options)
        outcomes.append(calm)
        seeds = range(arguments.seed, arguments.seed + arguments.schedules)
        outcomes += [reported(play(database, seed, drawn(seed, faults), calm), options) for seed in seeds]
    worst = longest(outcomes)
    print(f"\n{'fault':32} times  longest standstill after it")
    for name, found in worst.items():
        print(
            f"{name:32} {found['times']:5}  {found['standstill_s']:4.1f} s (seed {found['seed']}, {found['database']})"
        )
    failed = sum(bool(outcome.violations) for outcome in outcomes)
    print(f"{len(outcomes)} schedules, {failed} failed")
    results.write("chaos", {"faults": worst, "schedules": [figures(outcome) for outcome in outcomes]})
    return int(failed > 0)


def lacking_here() -> dict[str, str]:
    """Return the faults that this machine does not permit, with the reason of each; starts again with mounts of its own."""
    private = ["unshare", "--mount"]
    if _OWN_MOUNTS not in os.environ and subprocess.run([*private, "true"], capture_output=True).returncode == 0:
        command = [*private, sys.executable, "-m", "tests.chaos", *sys.argv[1:]]
        os.execvpe(private[0], command, {**os.environ, _OWN_MOUNTS: "1"})
    lacking = {} if _OWN_MOUNTS in os.environ else dict.fromkeys(MOUNTED, "this user may not mount a file system")
    return lacking | ({} if shutil.which("cc") else dict.fromkeys(DIALS, "there is no C compiler cc"))


def reported(outcome: Outcome, options: str) -> Outcome:
    """Print a line for a schedule and, if it failed, the command with ``options`` that repeats it."""
    name = f"seed {outcome.seed}" if outcome.faults else "calm"
    duration = f"start {outcome.start_seconds:4.1f} s, run {outcome.seconds:5.1f} s"
    stood = ", ".join(f"{fault.standstill:.1f} s after {fault.name}" for fault in (outcome.start, *outcome.faults))
    verdict = "FAILED" if outcome.violations else "ok"
    print(f"{outcome.database:8} {name:8} {verdict:6} {duration}; longest standstills: {stood}", flush=True)
    for violation in outcome.violations:
        print(f"  {violation}")
    if outcome.violations:
        print(f"  logs: {outcome.folder / 'data' / 'logs'}")
        print(
            f"  python -m tests.chaos --database {outcome.database} --seed {outcome.seed} --schedules 1{options}",
            flush=True,
        )
    return outcome


def longest(outcomes: Iterable[Outcome]) -> dict[str, JsonObject]:
    """Return for each fault how often it happened, and the longest standstill after it with its schedule."""
    worst: dict[str, JsonObject] = {}
    for outcome in outcomes:
        for fault in outcome.faults:
            before = worst.get(fault.name, {"times": 0, "standstill_s": -1.0})
            found = {"standstill_s": round(fault.standstill, 1), "seed": outcome.seed, "database": outcome.database}
            later = found if fault.standstill > before["standstill_s"] else {}
            worst[fault.name] = before | later | {"times": before["times"] + 1}
    return dict(sorted(worst.items()))


def figures(outcome: Outcome) -> JsonObject:
    """Return the figures of one schedule."""
    return {
        "database": outcome.database,
        "seed": outcome.seed,
        "faults": [
            {"name": fault.name, "share": round(fault.share, 3), "standstill_s": round(fault.standstill, 1)}
            for fault in outcome.faults
        ],
        "start_s": round(outcome.start_seconds, 1),
        "seconds": round(outcome.seconds, 1),
        "standstill_s": round(outcome.standstill.standstill, 1),
        "retries": outcome.retries,
        "violations": outcome.violations,
    }


if __name__ == "__main__":
    sys.exit(main())
