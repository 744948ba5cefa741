"""Measure coverage and width of the intervals, and of other methods, on planted data with a known true mean.

``make bench-coverage``, or ``python -m benchmarks.bench_coverage [--repetitions N --family reported|tuning]``. A cell of the
table is a design, a world (`benchmarks.planted`) and a number of units. `valerie.statistics.intervals.mean_interval` gets
the data of every repetition in the form of a run's. Its choice of method and its refusals are part of the measurement.
A cell fails

- if the printed intervals cover less than 94 %, by a one-sided binomial test at 0.1 %;
- if they are on average wider than 1.3 × the narrowest other method that passes this test in this cell;
- if more than 5 % are refused, from 50 units on.

The goal applies to means and shares. The benchmark also measures pooled ratios, whose units have different weights, and
Sobol' and Latin hypercube designs without replicates (in one piece). The other methods are here and not in the package,
since each fails in some cell or is wider.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, expit, logit, ndtr, ndtri, stdtrit
from scipy.stats import binomtest

from benchmarks import planted, results
from valerie.plain import JsonObject
from valerie.statistics.intervals import Interval, Refusal, mean_interval
from valerie.statistics.replicates import replicates
from valerie.statistics.units import sampling_units

Floats = NDArray[np.float64]
#: Lower and upper bounds, (repetitions,) each.
Bounds = tuple[Floats, Floats]

#: Quantities to which the goal applies, and quantities measured without a goal.
GOALS: Final = ("mean", "share")
BESIDE: Final = ("pooled", "one piece")
UNITS: Final = (6, 10, 20, 50, 200)
GOAL: Final = 0.94
SIGNIFICANCE: Final = 0.001
WIDEST: Final = 1.3
REFUSED: Final = 0.05
#: Refusals count from this number of units on.
ENOUGH: Final = 50
TAIL: Final = 0.025
RESAMPLES: Final = 999
#: Number of repetitions in memory at a time.
CHUNK: Final = 250
#: Designs that consist of replicates.
EVEN: Final = ("sobol", "latin hypercube")
#: The designs' names for `sampling_units`; for a grid, the sites are passed too.
NAMES: Final = {
    "independent": "random",
    "clustered": "random",
    "sobol": "sobol",
    "latin hypercube": "latin_hypercube",
}


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over units: (repetitions, units) of scores and of row weights; (repetitions,) of row weights."""

    scores: Floats
    sizes: Floats

    @property
    def units(self) -> int:
        return int(self.scores.shape[1])

    @property
    def rows(self) -> Floats:
        return np.asarray(self.sizes.sum(axis=1))

    @property
    def mean(self) -> Floats:
        return np.asarray(self.scores.sum(axis=1) / self.rows)

    @property
    def variance(self) -> Floats:
        residuals = self.scores - self.mean[:, None] * self.sizes
        return np.asarray((residuals**2).sum(axis=1) / self.rows**2 * self.units / (self.units - 1))

    def floored(self) -> tuple[Floats, Floats]:
        """Return the mean and its variance after half a unit of mean size is added at each end."""
        size = self.rows / self.units
        rows = self.rows + size
        mean = (self.scores.sum(axis=1) + size / 2) / rows
        squares = ((self.scores - mean[:, None] * self.sizes) ** 2).sum(axis=1)
        squares += size**2 * (mean**2 + (1 - mean) ** 2) / 2
        return mean, squares / rows**2 * (self.units + 1) / self.units


def student(sums: Sums) -> Bounds:
    half = -stdtrit(sums.units - 1, TAIL) * np.sqrt(sums.variance)
    return sums.mean - half, sums.mean + half


def unseen_cluster(sums: Sums) -> Bounds:
    """Return Student's t interval, widened for one unseen unit at 0 or 1."""
    low, high = student(sums)
    share = 1 - TAIL ** (1 / sums.units)
    return np.minimum(low, (1 - share) * sums.mean), np.maximum(high, sums.mean + share * (1 - sums.mean))


@cache
def _draws(units: int) -> Floats:
    equal = np.full(units, 1 / units)
    return np.random.default_rng(0).multinomial(units, equal, RESAMPLES).astype(np.float64).T


def bootstrap(sums: Sums) -> Bounds:
    """Return the cluster bootstrap interval with expanded percentiles (Hesterberg 2015, doi:10.1080/00031305.2015.1089789)."""
    weights, units = _draws(sums.units), sums.units
    tail = float(ndtr(np.sqrt(units / (units - 1)) * stdtrit(units - 1, TAIL)))
    low, high = np.quantile((sums.scores @ weights) / (sums.sizes @ weights), (tail, 1 - tail), axis=1)
    return low, high


def bootstrap_t(sums: Sums) -> Bounds:
    """Return the interval of a studentised cluster bootstrap; half a unit at each end keeps the variances above 0."""
    weights = _draws(sums.units)
    rows = sums.sizes @ weights
    mean = (sums.scores @ weights) / rows
    squares = (sums.scores**2) @ weights - 2 * mean * ((sums.scores * sums.sizes) @ weights)
    squares += mean**2 * ((sums.sizes**2) @ weights)
    size = sums.rows[:, None] / sums.units
    deviations = np.sqrt(np.maximum(squares, 0) + size**2 * (mean**2 + (1 - mean) ** 2) / 2) / rows
    _, variance = sums.floored()
    low, high = np.quantile((mean - sums.mean[:, None]) / deviations, (TAIL, 1 - TAIL), axis=1)
    return sums.mean - high * np.sqrt(variance), sums.mean - low * np.sqrt(variance)


def logit_t(sums: Sums) -> Bounds:
    """Return Student's t interval on the logit of the mean, shrunken by half a unit at each end."""
    mean, variance = sums.floored()
    error = np.sqrt(np.maximum(sums.variance, variance / 2)) / (mean * (1 - mean))
    half = -stdtrit(sums.units - 1, TAIL) * error
    return expit(logit(mean) - half), expit(logit(mean) + half)


def variance_floor(sums: Sums) -> Bounds:
    mean, variance = sums.floored()
    half = -stdtrit(sums.units - 1, TAIL) * np.sqrt(variance)
    return mean - half, mean + half


def betting(sums: Sums) -> Bounds:
    """Return the interval of a hedged capital process on the units' means.

    Waudby-Smith and Ramdas 2024, doi:10.1093/jrsssb/qkad009.
    """
    means = sums.scores / sums.sizes
    grid = np.linspace(0.005, 0.995, 100)[None, :]
    gains, losses = np.zeros((len(means), 100)), np.zeros((len(means), 100))
    total, squares = np.full((len(means), 1), 0.5), np.full((len(means), 1), 0.25)
    for number in range(sums.units):
        value = means[:, number, None]
        bet = np.sqrt(2 * np.log(2 / (2 * TAIL)) * (number + 1) / (sums.units * squares))
        gains += np.log1p(np.minimum(bet, 0.75 / grid) * (value - grid))
        losses += np.log1p(-np.minimum(bet, 0.75 / (1 - grid)) * (value - grid))
        total += value
        squares += (value - total / (number + 2)) ** 2
    inside = np.maximum(gains, losses) < np.log(1 / TAIL)
    step = 0.01
    low = grid[0, inside.argmax(axis=1)] - step
    high = grid[0, 99 - inside[:, ::-1].argmax(axis=1)] + step
    return low, high


def wilson_rows(sums: Sums) -> Bounds:
    """Return Wilson's interval, as if rows were independent."""
    z, rows, mean = -ndtri(TAIL), sums.rows, sums.mean
    centre = (mean + z * z / (2 * rows)) / (1 + z * z / rows)
    half = z / (1 + z * z / rows) * np.sqrt(mean * (1 - mean) / rows + z * z / (4 * rows * rows))
    return centre - half, centre + half


def korn_graubard(sums: Sums) -> Bounds:
    """Return the Clopper-Pearson interval with the effective number of rows.

    Korn and Graubard 1998, *Survey Methodology* 24, 193-201.
    """
    mean, rows = sums.mean, sums.rows
    equal = mean * (1 - mean) < 1e-12
    with np.errstate(divide="ignore", invalid="ignore"):
        effective = mean * (1 - mean) / sums.variance * rows / np.maximum(rows - 1, 1)
    heavier = stdtrit(rows - 1, TAIL) / stdtrit(sums.units - 1, TAIL)
    effective = np.where(equal, sums.units, np.minimum(effective * heavier**2, rows))
    hits, misses = effective * mean, effective * (1 - mean)
    low = betaincinv(np.maximum(hits, 1e-9), misses + 1, TAIL)
    high = betaincinv(hits + 1, np.maximum(misses, 1e-9), 1 - TAIL)
    return np.where(mean <= 0, 0.0, low), np.where(mean >= 1, 1.0, high)


Method = Callable[[Sums], Bounds]
OTHERS: Final[dict[str, Method]] = {
    "Student's t": student,
    "bootstrap": bootstrap,
    "bootstrap-t": bootstrap_t,
    "logit t": logit_t,
    "variance floor": variance_floor,
    "unseen cluster": unseen_cluster,
    "betting": betting,
}
OF_SHARES: Final[dict[str, Method]] = {
    "Wilson of rows": wilson_rows,
    "Korn-Graubard": korn_graubard,
    "bootstrap": bootstrap,
    "logit t": logit_t,
    "variance floor": variance_floor,
    "unseen cluster": unseen_cluster,
}


@dataclass(slots=True)
class Tally:
    """Counts of intervals, printed and correct, and the sum of their widths."""

    printed: int = 0
    held: int = 0
    widths: float = 0.0

    def count(self, low: Floats, high: Floats, truth: float) -> None:
        low, high = np.clip(low, 0, 1), np.clip(high, 0, 1)
        self.printed += len(low)
        self.held += int(np.count_nonzero((low <= truth + 1e-9) & (truth <= high + 1e-9)))
        self.widths += float((high - low).sum())

    @property
    def coverage(self) -> float:
        return self.held / self.printed if self.printed else float("nan")

    @property
    def width(self) -> float:
        return self.widths / self.printed if self.printed else float("nan")

    @property
    def passes(self) -> bool:
        """Return True unless the test rejects the goal's coverage; no interval printed counts as a pass."""
        if not self.printed:
            return True
        return binomtest(self.held, self.printed, GOAL, alternative="less").pvalue >= SIGNIFICANCE


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of the table.

    Attributes:
        quantity: ``mean``; ``share`` of scores of at least 0.5; ``pooled``, the mean weighted by pixels; ``one piece``, the mean
            of a design without replicates.
        design, world, units: the planted data.
        estimand: the quantity that the interval is for.
        truth: the true value.
        coverage, width: figures of the printed intervals.
        refused: share of repetitions without an interval.
        best, ratio: the narrowest other method that covers, and the width relative to its width.
        failures: the parts of the goal that the cell misses.
        others: coverage and width of the other methods.
    """

    quantity: str
    design: str
    world: str
    units: int
    estimand: str
    truth: float
    coverage: float
    width: float
    refused: float
    best: str
    ratio: float
    failures: tuple[str, ...]
    others: dict[str, tuple[float, float]]


def measure(
    quantity: str, design: str, name: str, units: int, *, worlds: Mapping[str, planted.World], repetitions: int
) -> Cell:
    """Measure one cell."""
    world = planted.passed(worlds[name]) if quantity == "share" else worlds[name]
    weigh = planted.pixels if quantity == "pooled" else planted.alike
    truth = planted.truth(world, design, weigh)
    methods = OF_SHARES if quantity == "share" else OTHERS
    tallies = {other: Tally() for other in methods}
    replicate = np.sort(replicates(units)) if design in EVEN and quantity != "one piece" else None
    own, refused, estimand = Tally(), 0, ""
    for start in range(0, repetitions, CHUNK):
        draws = planted.draw(
            world,
            design,
            units=units,
            repetitions=min(CHUNK, repetitions - start),
            seed=crc32(f"{quantity} {design} {name} {units} {start}".encode()),
            replicates=replicate,
            weigh=weigh,
        )
        ends = []
        for interval in intervals(draws, design):
            estimand = str(interval.estimand)
            if isinstance(interval, Interval):
                ends.append((interval.low, interval.high))
            else:
                refused += 1
        if ends:
            low, high = np.array(ends).T
            own.count(low, high, truth)
        sums = Sums((draws.values * draws.weights).sum(axis=2), draws.weights.sum(axis=2))
        for other, method in methods.items():
            tallies[other].count(*method(sums), truth)
        if replicate is not None:
            starts = np.flatnonzero(np.diff(replicate, prepend=-1))
            whole = Sums(np.add.reduceat(sums.scores, starts, axis=1), np.add.reduceat(sums.sizes, starts, axis=1))
            tallies.setdefault("t of replicates", Tally()).count(*student(whole), truth)
    covering = {other: tally.width for other, tally in tallies.items() if tally.passes}
    best = min(covering, key=covering.__getitem__, default="")
    ratio = own.width / covering[best] if best else float("nan")
    failures = {
        "coverage": not own.passes,
        "width": ratio > WIDEST,
        "refusals": units >= ENOUGH and refused > REFUSED * repetitions,
    }
    return Cell(
        quantity=quantity,
        design=design,
        world=name,
        units=units,
        estimand=estimand,
        truth=truth,
        coverage=own.coverage,
        width=own.width,
        refused=refused / repetitions,
        best=best,
        ratio=ratio,
        failures=tuple(part for part, missed in failures.items() if missed),
        others={other: (tally.coverage, tally.width) for other, tally in tallies.items()},
    )


def intervals(draws: planted.Draws, design: str) -> Iterator[Interval | Refusal]:
    """Return the interval of every repetition."""
    _, count, rows = draws.values.shape
    unit, row = np.indices((count, rows)).reshape(2, -1)
    replicate = None if draws.replicate is None else draws.replicate[unit]
    if design == "crossed grid":
        units = sampling_units("grid", unit * rows + row, sites=unit)
    else:
        units = sampling_units(NAMES[design], unit, replicate=replicate)
    for values, weights in zip(draws.values, draws.weights, strict=True):
        present = weights.ravel() > 0
        of_rows = units if present.all() else units.of(present)
        yield mean_interval(values.ravel()[present], of_rows, weights=weights.ravel()[present])


def show(cells: list[Cell]) -> None:
    """Print the table: coverage in per cent and width ratio, by number of units."""
    columns = sorted({cell.units for cell in cells})
    print(f"{'':40}" + "".join(f"{units:>6} units   " for units in columns))
    rows: dict[tuple[str, str, str], dict[int, Cell]] = {}
    for cell in cells:
        rows.setdefault((cell.quantity, cell.design, cell.world), {})[cell.units] = cell
    for (quantity, design, world), row in rows.items():
        texts = [f"{100 * cell.coverage:5.1f} ×{cell.ratio:4.2f}{_marks(cell):4}" for cell in row.values()]
        print(f"{quantity:11}{design:17}{world:12}" + " ".join(texts))


def _marks(cell: Cell) -> str:
    """Return the initials of the failures."""
    return "".join(part[0].upper() for part in cell.failures)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=2000)
    parser.add_argument("--family", choices=("reported", "tuning"), default="reported")
    arguments = parser.parse_args()
    started = time.process_time()
    worlds = planted.REPORTED if arguments.family == "reported" else planted.TUNING
    cells = [
        measure(quantity, design, name, units, worlds=worlds, repetitions=arguments.repetitions)
        for quantity in (*GOALS, *BESIDE)
        for design in (EVEN if quantity == "one piece" else planted.DESIGNS)
        for name in worlds
        for units in UNITS
    ]
    print(
        "Coverage in %, width relative to the narrowest other method that covers; "
        "C, W, R: fails by coverage, width, refusals"
    )
    show(cells)
    failed = [cell for cell in cells if cell.failures]
    for cell in failed:
        print(
            f"fails ({', '.join(cell.failures)}): {cell.quantity}, {cell.design}, {cell.world}, {cell.units} units: "
            f"coverage {100 * cell.coverage:.1f} %, width {cell.width:.3f}, {cell.ratio:.2f} × {cell.best}, "
            f"refused {100 * cell.refused:.1f} %"
        )
    for quantity in (*GOALS, *BESIDE):
        all_cells = [cell for cell in cells if cell.quantity == quantity]
        print(f"{quantity}: {sum(not cell.failures for cell in all_cells)} of {len(all_cells)} cells meet the goal")
    print(f"{time.process_time() - started:.0f} CPU seconds")
    name = "coverage" if arguments.family == "reported" else "coverage-tuning"
    results.write(name, {"repetitions": arguments.repetitions, "cells": [asdict(cell) for cell in cells]})
    results.write_table(name, [_published(cell) for cell in cells])


def _published(cell: Cell) -> JsonObject:
    """Return the figures of a cell that docs/coverage.csv keeps."""
    return {
        "quantity": cell.quantity,
        "design": cell.design,
        "scores": cell.world,
        "units": cell.units,
        "estimand": cell.estimand,
        "coverage": cell.coverage,
        "width": cell.width,
        "width / narrowest other": cell.ratio,
        "narrowest other": cell.best,
        "refused": cell.refused,
        "fails": " ".join(cell.failures),
    }


if __name__ == "__main__":
    main()
