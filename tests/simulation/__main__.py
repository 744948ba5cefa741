"""`python -m tests.simulation --seed 17` repeats one schedule and prints its trace; without a seed, many are tried."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections.abc import Sequence

import structlog

from tests.simulation.bugs import BUGS, planted
from tests.simulation.world import FAULTS, Outcome, Simulation


def main() -> int:
    """Return 1 where an invariant was violated."""
    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=__doc__)
    parser.add_argument("--seed", type=int, help="run this schedule alone, and print what happens")
    parser.add_argument("--schedules", type=int, default=100, help="how many seeds are tried")
    parser.add_argument("--first", type=int, default=1, help="the first of them")
    parser.add_argument("--bug", choices=sorted(BUGS), help="plant a bug that the simulation must find")
    parser.add_argument("--fault", action="append", choices=sorted(set(FAULTS)), help="only this kind; may be repeated")
    parser.add_argument("--until-failure", action="store_true", help="stop at the first seed that fails")
    arguments = parser.parse_args()
    if os.environ.get("PYTHONHASHSEED") != "0":  # the order of sets must follow from the seed, too
        os.execve(sys.executable, [sys.executable, "-m", "tests.simulation", *sys.argv[1:]],
                  {**os.environ, "PYTHONHASHSEED": "0"})  # fmt: skip
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    calm = Simulation(0, ()).run()
    assert not calm.violations, calm.violations
    faults = arguments.fault or FAULTS
    with planted(arguments.bug):
        if arguments.seed is not None:
            outcome = judged(Simulation(arguments.seed, faults).run(), calm)
            print("\n".join(outcome.trace), *outcome.violations, sep="\n")
            return int(bool(outcome.violations))
        seeds = range(arguments.first, arguments.first + arguments.schedules)
        command = "python -m tests.simulation" + "".join(f" --fault '{fault}'" for fault in arguments.fault or ())
        command += f" --bug {arguments.bug}" if arguments.bug else ""
        return many(seeds, faults, calm, command, until_failure=arguments.until_failure)


def judged(outcome: Outcome, calm: Outcome) -> Outcome:
    """The outcome, with a violation where its results are not those of the calm schedule."""
    if outcome.violations or outcome.digest == calm.digest:
        return outcome
    text = f"the results {outcome.digest} are not those of a calm run, {calm.digest}"
    return Outcome(**{**vars(outcome), "violations": (text,)})


def many(seeds: range, faults: Sequence[str], calm: Outcome, command: str, *, until_failure: bool) -> int:
    """Try seeds; print those that fail with the ``command`` that repeats them, and figures."""
    started, failed, worst, steps, tried, disturbed = time.process_time(), 0, (0.0, 0), 0, 0, 0
    for seed in seeds:
        outcome = judged(Simulation(seed, faults).run(), calm)
        worst = max(worst, (outcome.standstill, seed))
        tried, steps, disturbed = tried + 1, steps + outcome.steps, disturbed + outcome.faults
        if outcome.violations:
            failed += 1
            print(f"seed {seed}: {outcome.violations[0]}\n  {command} --seed {seed}", flush=True)
            if until_failure:
                break
    print(
        f"{tried} schedules of {calm.products} products, {disturbed} faults, {steps} steps, "
        f"{time.process_time() - started:.1f} CPU-s: {failed} failed; "
        f"longest standstill {worst[0]:.1f} s (seed {worst[1]})"
    )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
