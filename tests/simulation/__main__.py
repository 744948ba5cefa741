"""`python -m tests.simulation --seed 17` repeats one schedule and prints its trace; without a seed, it tries many."""

from __future__ import annotations

import argparse
import logging
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import structlog

from tests.simulation.bugs import BUGS
from tests.simulation.world import AFTER_OUTAGE, FAULTS, OUTAGE, Outcome, Simulation, run_schedule

#: Schedules within which a planted bug must be found.
_SOON = 20


def main() -> int:
    """Return 1 where an invariant was violated."""
    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=__doc__)
    parser.add_argument("--seed", type=int, help="run this schedule only, and print its trace")
    parser.add_argument("--schedules", type=int, default=100, help="number of seeds to try")
    parser.add_argument("--processes", type=int, default=1, help="number of processes that share the seeds")
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
    # Settings of the shell must not decide what happens, and the order of sets must be reproducible, too.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("VALERIE_")}
    environment["PYTHONHASHSEED"] = "0"
    if os.environ != environment:
        command = [sys.executable, "-m", "tests.simulation", *sys.argv[1:]]
        os.execve(sys.executable, command, environment)
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    calm = Simulation(0, ()).run()
    assert not calm.violations, calm.violations
    faults = arguments.fault or FAULTS
    with BUGS[arguments.bug].plant() if arguments.bug else nullcontext():
        if arguments.seed is not None:
            outcome, _ = tried(arguments.seed, faults, calm, outage=arguments.outage)
            print("\n".join(outcome.trace), *outcome.violations, sep="\n")
            return int(bool(outcome.violations))
        seeds = range(arguments.first, arguments.first + arguments.schedules)
        with multiprocessing.get_context("fork").Pool(arguments.processes) as pool:
            outcomes = pool.imap(partial(tried, faults=faults, calm=calm, outage=arguments.outage), seeds)
            options = " ".join(
                [f"--fault '{fault}'" for fault in arguments.fault or ()] + ["--outage"] * arguments.outage
            )
            violated = many(zip(seeds, outcomes, strict=True), calm, options)
    missed = [name for name in BUGS if arguments.prove and not found(name, calm)]
    return int(violated or bool(missed))


def judged(outcome: Outcome, calm: Outcome) -> Outcome:
    """Return the outcome, with a violation if its results differ from those of the calm schedule."""
    if outcome.violations or outcome.digest == calm.digest:
        return outcome
    text = f"the results {outcome.digest} are not those of a calm run, {calm.digest}"
    return replace(outcome, violations=(text,))


def tried(seed: int, faults: Sequence[str], calm: Outcome, *, outage: bool) -> tuple[Outcome, float]:
    """Return the judged outcome of a seed, and the CPU seconds that it took; after an outage, rendering must go on in time."""
    started = time.process_time()
    run = Simulation(seed, (), planned=OUTAGE).run() if outage else run_schedule(seed, faults)
    outcome = judged(run, calm)
    if outage and not outcome.violations and (outcome.first is None or outcome.first > AFTER_OUTAGE):
        text = f"nothing was rendered in time after the outage: {outcome.first} s"
        outcome = replace(outcome, violations=(text,))
    return outcome, time.process_time() - started


def many(tries: Iterable[tuple[int, tuple[Outcome, float]]], calm: Outcome, options: str) -> bool:
    """Print figures of seeds and the command that repeats each failure, and return True if a seed failed."""
    outcomes, seconds, failed = dict[int, Outcome](), 0.0, 0
    for seed, (outcome, took) in tries:
        outcomes[seed], seconds = replace(outcome, trace=()), seconds + took
        if outcome.violations:
            failed += 1
            print(
                f"seed {seed}: {outcome.violations[0]}\n  python -m tests.simulation --seed {seed} {options}",
                flush=True,
            )
    felt, drawn = (sum(getattr(each, name) for each in outcomes.values()) for name in ("felt", "drawn"))
    worst = max(outcomes, key=lambda seed: outcomes[seed].standstill)
    print(
        f"{len(outcomes)} schedules of {calm.products} products, {felt} of {drawn} faults felt "
        f"(at least {min(each.felt for each in outcomes.values())} in each), "
        f"{sum(each.steps for each in outcomes.values())} steps, {seconds:.1f} CPU-s: {failed} failed; "
        f"longest standstill {outcomes[worst].standstill:.1f} s (seed {worst}), "
        f"longest wait for a rendered product {max(each.first or 0.0 for each in outcomes.values()):.1f} s"
    )
    return failed > 0


def found(name: str, calm: Outcome) -> bool:
    """Return True if a schedule finds a planted bug, and print the first that does."""
    bug = BUGS[name]
    with bug.plant():
        for seed in range(1, _SOON + 1):
            outcome = judged(run_schedule(seed, (bug.fault,)), calm)
            if outcome.violations:
                print(f"{name} is found by --bug {name} --fault '{bug.fault}' --seed {seed}: {outcome.violations[0]}")
                return True
    print(f"{name} is not found in {_SOON} schedules of the fault '{bug.fault}'")
    return False


if __name__ == "__main__":
    sys.exit(main())
