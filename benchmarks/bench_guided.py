"""Measure guided validation on planted scores, compared with plain Monte Carlo.

``make bench-guided``, or ``python -m benchmarks.bench_guided [--seed S --repetitions N --rate P --budget N --batch N
--families NAME…]``.
The planted scores (`benchmarks.planted_scores`) follow from the seed, which differs between repetitions. For each family:

- *estimate*: coverage of both intervals and of plain Monte Carlo with the same number of points, their widths relative to plain
  Monte Carlo's, the share of repetitions in which the model-assisted number may be used, and its coverage there. Scores in
  covariates are measured with them, with them in pools of `FEW` points, and without them.

A line is marked if a coverage is below 94 % by a one-sided binomial test at 0.1 %, or if plain Monte Carlo needs fewer than
1 / 1.5 of the points for the same width.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from scipy.stats import binomtest

from benchmarks import (
    guided_goals,
    guided_overhead,
    guided_peers,
    planted_modes,
    planted_scores,
    planted_streets,
    results,
)
from valerie.guided.domain import Cube
from valerie.guided.estimate import Estimate
from valerie.guided.strategy import pursue
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.units import sampling_units

GOAL: Final = 0.94
SIGNIFICANCE: Final = 0.001
MOST_LOST: Final = 1.5
#: Points of a small pool.
FEW: Final = 2000
#: Arguments of `Estimate` for scores in covariates, by their name.
SEEN: Final[dict[str, dict[str, Any]]] = {
    "covariates": {"seen": True},
    "in small pools": {"seen": True, "pool": FEW},
    "not used": {"seen": False},
}
#: From this budget on, a search for modes is repeated a tenth as often.
LARGE: Final = 10_000
#: Number of estimates per planted score.
DRAWS: Final = 5
GOALS: Final = ("find", "map", "compare", "cascade", "rank", "pairs", "rates", "overhead", "estimate")
#: Failure rate, budget and batch of the cells.
CELLS: Final = ((1e-2, 2048, 512), (1e-3, 8192, 2048), (1e-1, 2048, 512), (1e-4, 65_536, 8192))


@dataclass(frozen=True, slots=True)
class Row:
    """Figures of one family.

    Attributes:
        family: family of planted scores.
        rate, budget, batch: failure rate, number of evaluations, largest number of evaluations at a time.
        seed: seed of the first repetition.
        repetitions: number of estimates, `DRAWS` per planted score.
        coverage_free, coverage_assisted, coverage_plain: coverage of the two intervals, and of plain Monte Carlo's.
        width_free, width_assisted: mean widths relative to plain Monte Carlo's.
        calibrated: share of repetitions in which the rule allows the model-assisted number.
        coverage_calibrated: coverage of the model-assisted interval there; None if there are none.
        overhead: CPU seconds of a batch, without the evaluations.
        failures: the goals that are missed.
    """

    family: str
    rate: float
    budget: int
    batch: int
    seed: int
    repetitions: int
    coverage_free: float
    coverage_assisted: float
    coverage_plain: float
    width_free: float
    width_assisted: float
    calibrated: float
    coverage_calibrated: float | None
    overhead: float
    failures: tuple[str, ...]


def measure(
    family: str,
    *,
    seed: int,
    repetitions: int,
    rate: float,
    budget: int,
    batch: int,
    seen: bool = False,
    pool: int | None = None,
) -> Row:
    """Measure one family; ``seen`` if the strategy is given the covariates, in pools of a size."""
    held: dict[str, list[bool]] = {"assumption-free": [], "assisted": [], "plain": []}
    widths: dict[str, list[float]] = {"assumption-free": [], "assisted": [], "plain": []}
    calibrated: list[bool] = []
    spent, batches = 0.0, 0
    for repetition in range(repetitions):
        if repetition % DRAWS == 0:
            planted = planted_scores.plant(family, seed + repetition, rate)
        strategy = Estimate(
            Cube(planted.dimensions),
            at_least=planted_scores.AT_LEAST,
            seed=seed + repetition,
            pool=pool,
            covariates=planted.covariates if seen else None,
        )
        started = time.process_time()
        pursue(strategy, planted.score, budget=budget, batch=batch)
        known = strategy.rate()
        spent += time.process_time() - started
        batches += len(strategy.draws)
        draws = np.random.default_rng([seed + repetition, 1, 3]).random((budget, planted.dimensions))
        failing = planted.score(draws) < planted_scores.AT_LEAST
        plain = mean_interval(failing, sampling_units("random", np.arange(budget)))
        for name, interval in zip(held, (known.assumption_free, known.assisted, plain), strict=True):
            assert isinstance(interval, Interval), "there are enough points"
            held[name].append(interval.low <= planted.rate <= interval.high)
            widths[name].append(interval.high - interval.low)
        calibrated.append(known.calibrated)
    of_calibrated = [hit for hit, allowed in zip(held["assisted"], calibrated, strict=True) if allowed]
    width = float(np.mean(widths["plain"]))
    assisted = float(np.mean(widths["assisted"])) / width
    failures = {
        "assumption-free coverage": low(held["assumption-free"]),
        "assisted coverage": low(held["assisted"]),
        "calibrated coverage": low(of_calibrated),
        "renders": assisted**2 > MOST_LOST,
    }
    return Row(
        family,
        rate,
        budget,
        batch,
        seed,
        repetitions,
        float(np.mean(held["assumption-free"])),
        float(np.mean(held["assisted"])),
        float(np.mean(held["plain"])),
        float(np.mean(widths["assumption-free"])) / width,
        assisted,
        float(np.mean(calibrated)),
        float(np.mean(of_calibrated)) if of_calibrated else None,
        spent / batches,
        tuple(name for name, missed in failures.items() if missed),
    )


def low(hits: Sequence[bool]) -> bool:
    """Return True if the test rejects the goal's coverage."""
    return bool(hits) and binomtest(sum(hits), len(hits), GOAL, alternative="less").pvalue < SIGNIFICANCE


def show(rows: Sequence[Row]) -> None:
    print(f"{'':18}{'free':>14}{'assisted':>14}{'plain':>7}{'calibrated: share, coverage':>29}{'CPU s/batch':>13}")
    for row in rows:
        calibrated = "–" if row.coverage_calibrated is None else f"{100 * row.coverage_calibrated:.1f}"
        print(
            f"{row.family:18}{100 * row.coverage_free:8.1f} ×{row.width_free:4.2f}{100 * row.coverage_assisted:8.1f} ×"
            f"{row.width_assisted:4.2f}{100 * row.coverage_plain:7.1f}{100 * row.calibrated:20.0f} %{calibrated:>7}"
            f"{row.overhead:13.2f}  {', '.join(row.failures)}"
        )


def measure_others(
    goals: Sequence[str],
    families: Sequence[str],
    seed: int,
    repetitions: int,
    budgets: Sequence[int],
    cells: Sequence[tuple[float, int, int]],
) -> None:
    """Measure the goals other than estimates, a tenth as often with a large budget; store each line."""
    runs: list[Callable[[], Any]] = []
    if "find" in goals:
        small, large = (tuple(b for b in budgets if (b >= LARGE) == size) for size in (False, True))
        for family in (name for name in planted_modes.FAMILIES if name in families):
            for chosen, times in ((small, repetitions), (large, max(repetitions // 10, 1))):
                if chosen:
                    runs.append(
                        partial(guided_goals.measure_find, family, seed=seed, repetitions=times, budgets=chosen)
                    )
    if "map" in goals:
        runs += [
            partial(guided_goals.measure_map, family, seed=seed, repetitions=repetitions)
            for family in (*planted_scores.MARGINS, *planted_streets.LOADS)
            if family in families
        ]
    if "compare" in goals:
        runs += [
            partial(guided_goals.measure_compare, case, seed=seed, repetitions=repetitions)
            for case in guided_goals.COMPARE_CASES
        ]
    if "cascade" in goals:
        runs += [
            partial(guided_goals.measure_cascade, case, seed=seed, repetitions=repetitions)
            for case in guided_goals.CASCADE_CASES
        ]
    scored = [family for family in planted_scores.MARGINS if family in families]
    if "rank" in goals:
        runs += [
            partial(guided_peers.measure_rank, family, seed=seed, repetitions=repetitions, draws=DRAWS, rows=rows)
            for rows in guided_peers.ROWS
            for family in scored
        ]
    if "pairs" in goals:
        runs += [partial(guided_peers.measure_pairs, family, seed=seed, repetitions=repetitions) for family in scored]
    if "rates" in goals:
        runs += [
            partial(
                guided_peers.measure_rates,
                family,
                seed=seed,
                repetitions=repetitions,
                rate=rate,
                budget=budget,
                draws=DRAWS,
            )
            for rate, budget, _ in cells
            for family in scored
        ]
    if "overhead" in goals:
        runs += [
            partial(guided_overhead.measure_overhead, goal, batch, car=car)
            for car in (False, True)
            for goal in guided_overhead.GOALS
            for batch in guided_overhead.BATCHES
        ]
    rows: list[dict[str, Any]] = []
    for run in runs:
        found = run()
        for row in found if isinstance(found, tuple) else (found,):
            rows.append(asdict(row))
            print(" · ".join(f"{name} {_shown(value)}" for name, value in rows[-1].items()), flush=True)
        results.write("guided_goals", {"seed": seed, "rows": rows})


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return " / ".join(map(_shown, value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED", "0")))
    parser.add_argument("--repetitions", type=int, default=300)
    parser.add_argument("--rate", type=float, help="one cell alone, with --budget and --batch")
    parser.add_argument("--budget", type=int, default=1024)
    parser.add_argument("--batch", type=int, default=128)
    every = (*planted_scores.MARGINS, planted_scores.COVARIATES, *planted_streets.LOADS, *planted_modes.FAMILIES)
    parser.add_argument("--families", nargs="+", choices=every, default=every, help="of scores and modes")
    parser.add_argument("--budgets", nargs="+", type=int, default=(500, 2000, 10_000), help="of the searches for modes")
    parser.add_argument("--goals", nargs="+", choices=GOALS, default=GOALS)
    chosen = parser.parse_args()
    cells = CELLS if chosen.rate is None else ((chosen.rate, chosen.budget, chosen.batch),)
    others = [name for name in chosen.goals if name != "estimate"]
    if others:
        measure_others(others, chosen.families, chosen.seed, chosen.repetitions, chosen.budgets, cells)
    if "estimate" not in chosen.goals:
        return
    print("Coverage in % × width in units of plain Monte Carlo's with as many evaluations")
    rows: list[Row] = []
    for rate, budget, batch in cells:
        print(f"rate {rate:g}, {budget} evaluations in batches of {batch}")
        seed, repetitions = chosen.seed, chosen.repetitions
        cell = partial(measure, seed=seed, repetitions=repetitions, rate=rate, budget=budget, batch=batch)
        for family in (name for name in planted_scores.MARGINS if name in chosen.families):
            rows.append(cell(family))
            show(rows[-1:])
            results.write("guided", {"cells": [asdict(row) for row in rows]})
        if planted_scores.COVARIATES in chosen.families:
            rows += [replace(cell(planted_scores.COVARIATES, **how), family=name) for name, how in SEEN.items()]
            show(rows[-len(SEEN) :])
            results.write("guided", {"cells": [asdict(row) for row in rows]})


if __name__ == "__main__":
    main()
