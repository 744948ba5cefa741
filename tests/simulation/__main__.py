"""`python -m tests.simulation --seed 17` repeats one schedule and prints its trace; without a seed, it tries many."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace

import structlog

from tests.simulation.bugs import BUGS
from tests.simulation.world import AFTER_OUTAGE, FAULTS, OUTAGE, Outcome, Simulation

#: Schedules within which a planted bug must be found.
_SOON = 20


def main() -> int:
    """Return 1 where an invariant was violated."""
    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=__doc__)
    parser.add_argument("--seed", type=int, help="run this schedule only, and print its trace")
    parser.add_argument("--schedules", type=int, default=100, help="number of seeds to try")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument(
        "--fault", action="append", choices=sorted(set(FAULTS)), help="use only this fault; may be repeated"
    )
    parser.add_argument(
        "--outage", action="store_true", help="play the same faults in each schedule, which stop all rendering"
    )
    parser.add_argument("--bug", choices=sorted(BUGS), help="plant a bug")
    parser.add_argument("--prove", action="store_true", help="also plant each bug, and fail unless it is found")
    arguments = parser.parse_args()
    if os.environ.get("PYTHONHASHSEED") != "0":  # the order of sets must be reproducible, too
        command = [sys.executable, "-m", "tests.simulation", *sys.argv[1:]]
        os.execve(sys.executable, command, {**os.environ, "PYTHONHASHSEED": "0"})
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    calm = Simulation(0, ()).run()
    assert not calm.violations, calm.violations
    faults = arguments.fault or FAULTS
    with BUGS[arguments.bug].plant() if arguments.bug else nullcontext():
        if arguments.seed is not None:
            outcome = played(arguments.seed, faults, calm, outage=arguments.outage)
            print("\n".join(outcome.trace), *outcome.violations, sep="\n")
            return int(bool(outcome.violations))
        seeds = range(arguments.first, arguments.first + arguments.schedules)
        options = " ".join(f"--fault '{fault}'" for fault in arguments.fault or ())
        violated = many(seeds, faults, calm, options, outage=arguments.outage)
    missed = [name for name in BUGS if arguments.prove and not found(name, calm)]
    return int(violated or bool(missed))


def played(seed: int, faults: Sequence[str], calm: Outcome, *, outage: bool) -> Outcome:
    """Return the judged outcome of a schedule; after an outage, rendering must go on in time."""
    if not outage:
        return judged(Simulation(seed, faults).run(), calm)
    outcome = judged(Simulation(seed, (), planned=OUTAGE).run(), calm)
    if outcome.violations or (outcome.first is not None and outcome.first <= AFTER_OUTAGE):
        return outcome
    return replace(outcome, violations=(f"nothing was rendered in time after the outage: {outcome.first} s",))


def judged(outcome: Outcome, calm: Outcome) -> Outcome:
    """Return the outcome, with a violation if its results differ from those of the calm schedule."""
    if outcome.violations or outcome.digest == calm.digest:
        return outcome
    text = f"the results {outcome.digest} are not those of a calm run, {calm.digest}"
    return replace(outcome, violations=(text,))


def many(seeds: range, faults: Sequence[str], calm: Outcome, options: str, *, outage: bool) -> bool:
    """Try seeds, print figures and the command that repeats each failure, and return whether a seed failed."""
    started, failed, worst, first, steps, disturbed = time.process_time(), 0, (0.0, 0), (0.0, 0), 0, 0
    for seed in seeds:
        outcome = played(seed, faults, calm, outage=outage)
        first = max(first, (outcome.first or 0.0, seed))
        worst = max(worst, (outcome.standstill, seed))
        steps, disturbed = steps + outcome.steps, disturbed + outcome.faults
        if outcome.violations:
            failed += 1
            command = f"python -m tests.simulation --seed {seed} {options}{'--outage' * outage}"
            print(f"seed {seed}: {outcome.violations[0]}\n  {command}", flush=True)
    print(
        f"{len(seeds)} schedules of {calm.products} products, {disturbed} faults, {steps} steps, "
        f"{time.process_time() - started:.1f} CPU-s: {failed} failed; "
        f"longest standstill {worst[0]:.1f} s (seed {worst[1]}), "
        f"longest wait for a rendered product {first[0]:.1f} s (seed {first[1]})"
    )
    return failed > 0


def found(name: str, calm: Outcome) -> bool:
    """Return whether a schedule finds a planted bug, and print the first that does."""
    bug = BUGS[name]
    with bug.plant():
        for seed in range(1, _SOON + 1):
            outcome = judged(Simulation(seed, (bug.fault,)).run(), calm)
            if outcome.violations:
                print(f"{name} is found by --bug {name} --fault '{bug.fault}' --seed {seed}: {outcome.violations[0]}")
                return True
    print(f"{name} is not found in {_SOON} schedules of the fault '{bug.fault}'")
    return False


if __name__ == "__main__":
    sys.exit(main())
