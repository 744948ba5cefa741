"""Measure the goals find, map, compare and cascade on planted truth.

*find* (`benchmarks.planted_modes`): number of planted modes with a repeated failure, compared with as many scrambled Sobol'
points, as many random ones, restarts of CMA-ES where the package ``cma`` is installed (Hansen 2016, arXiv:1604.00772), and
MAP-Elites where ``ribs`` is (Tjanaka and others 2023, doi:10.1145/3583131.3590374). Each failure is repeated once within the
budget. Batch k of `Find` knows the scores up to batch k − 2, the last two know every score at once. CMA-ES starts at random
points with a deviation of 0.2, and again after each repeated failure. MAP-Elites keeps the lowest score in each of `CELLS`
cells around random points, and a quarter of its points are random.

*map* (`benchmarks.planted_scores` in six dimensions, 30 % failing, and `benchmarks.planted_streets`): wrong calls with
243 points, compared with an interpolated grid of 729 and with the same models on Sobol' points only. *compare* and *cascade*:
coverage.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final
from unittest import mock

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.special import logit

from benchmarks import planted_modes, planted_scores, planted_streets
from benchmarks.guided_peers import package
from valerie.analysis.rows.table import EvaluationTable
from valerie.guided import map as mapping
from valerie.guided.cascade import Cascade
from valerie.guided.compare import Compare
from valerie.guided.domain import Cube, Domain
from valerie.guided.exploration import SpaceFilling
from valerie.guided.find import Find
from valerie.guided.map import Call, Map
from valerie.guided.strategy import pursue
from valerie.guided.surrogate import Covariates
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.units import sampling_units

Floats = np.typing.NDArray[np.float64]

AT_LEAST: Final = 0.5
MAP_DIMENSIONS: Final = 6
GRID: Final = 3
MAP_BUDGET: Final = GRID**MAP_DIMENSIONS // 3
BATCHES: Final = 32
#: Cells of MAP-Elites, and its points at a time.
CELLS: Final = 512
ELITES: Final = 16
_CHECKED: Final = 4_000


@dataclass(frozen=True, slots=True)
class FindRow:
    """Mean numbers of modes found after each budget.

    Attributes:
        found, reported: by `Find`: modes with a repeated failure, and modes in its result.
        blind: by `Find` without covariates; empty for families that have none.
        sobol, random, evolution, elites: modes with a repeated failure by the other searches; the last two are empty without
            their packages.
        failed: shares of repetitions in which `Find` found fewer modes than the Sobol' points.
        error: standard errors of ``found`` less ``sobol``; 0 for one repetition.
        overhead: CPU seconds of `Find` per batch.
    """

    goal: str
    family: str
    repetitions: int
    budgets: tuple[int, ...]
    found: tuple[float, ...]
    reported: tuple[float, ...]
    blind: tuple[float, ...]
    sobol: tuple[float, ...]
    random: tuple[float, ...]
    evolution: tuple[float, ...]
    elites: tuple[float, ...]
    failed: tuple[float, ...]
    error: tuple[float, ...]
    overhead: float


def measure_find(family: str, *, seed: int, repetitions: int, budgets: tuple[int, ...]) -> FindRow:
    """Measure searches for modes, with covariates if the family has them; a batch is a 32nd of the budget."""
    table, overhead = [], []
    peers = {name: package(name) for name in ("cma", "ribs")}
    for repetition in range(seed, seed + repetitions):
        planted = planted_modes.Planted(family, repetition)
        # The points with which `Find` explores, so that the difference is not that of two scramblings.
        sobol = SpaceFilling(Cube(planted.dimensions), repetition).take(2**14)
        random = np.random.default_rng([repetition, 4]).random(sobol.shape)
        row = []
        for budget in budgets:
            known = planted.covariates if family == "covariates" else None
            modes, clusters, seconds = _search(planted, repetition, budget, known)
            unaided = modes if known is None else _search(planted, repetition, budget, None)[0]
            even, drawn = (_met(planted, points, budget) for points in (sobol, random))
            evolved = _evolve(planted, repetition, budget) if peers["cma"] else 0
            kept = _illuminate(planted, repetition, budget) if peers["ribs"] else 0
            row.append((modes, clusters, unaided, even, drawn, evolved, kept, modes < even))
            overhead.append(seconds)
        table.append(row)
    values = np.array(table, np.float64)
    means = [tuple(column.tolist()) for column in values.mean(axis=0).T]
    found, reported, blind, by_sobol, by_random, by_evolution, by_elites, failed = means
    return FindRow(
        "find",
        family,
        repetitions,
        budgets,
        found,
        reported,
        blind if family == "covariates" else (),
        by_sobol,
        by_random,
        by_evolution if peers["cma"] else (),
        by_elites if peers["ribs"] else (),
        failed,
        tuple(((values[:, :, 0] - values[:, :, 3]).std(axis=0) / np.sqrt(max(repetitions - 1, 1))).tolist()),
        float(np.mean(overhead)),
    )


def _met(planted: planted_modes.Planted, points: Floats, budget: int) -> int:
    """Return the number of modes that points hit in their order, where each failure is repeated within the budget."""
    fails = planted.score(points) < AT_LEAST
    within = np.arange(1, len(points) + 1) + np.cumsum(fails) <= budget
    return int(planted.modes(points[within]).any(axis=0).sum())


def _evolve(planted: planted_modes.Planted, seed: int, budget: int) -> int:
    """Return the number of modes that restarts of CMA-ES find."""
    cma: Any = import_module("cma")
    rng = np.random.default_rng([seed, 5])
    spent, repeated = 0, list[Floats]()
    while spent < budget:
        options = {"bounds": [0, 1], "seed": int(rng.integers(1, 2**31)), "verbose": -9}
        search = cma.CMAEvolutionStrategy(rng.random(planted.dimensions), 0.2, options)
        met = False
        while spent < budget and not met and not search.stop():
            points = np.array(search.ask())
            scores = planted.score(points)
            search.tell(list(points), scores.tolist())
            failing = points[scores < AT_LEAST]
            spent += len(points) + len(failing)
            if len(failing) and spent <= budget:
                again = failing[planted.score(failing, 1) < AT_LEAST]
                repeated += list(again)
                met = bool(len(again))
    return int(planted.modes(np.array(repeated)).any(axis=0).sum()) if repeated else 0


def _illuminate(planted: planted_modes.Planted, seed: int, budget: int) -> int:
    """Return the number of modes that MAP-Elites finds, with all parameters as its measures."""
    archives, emitters = (import_module(f"ribs.{part}") for part in ("archives", "emitters"))
    rng = np.random.default_rng([seed, 6])
    ranges = [(0.0, 1.0)] * planted.dimensions
    archive = archives.CVTArchive(
        solution_dim=planted.dimensions, centroids=rng.random((CELLS, planted.dimensions)), ranges=ranges, seed=seed
    )
    start = rng.random((budget // 4, planted.dimensions))
    emitter = emitters.IsoLineEmitter(archive, initial_solutions=start, bounds=ranges, seed=seed, batch_size=ELITES)
    spent, repeated = 0, list[Floats]()
    while spent < budget:
        points = emitter.ask()
        scores = planted.score(points)
        archive.add(points, -scores, points)
        failing = points[scores < AT_LEAST]
        within = spent + np.arange(1, len(points) + 1) + np.cumsum(scores < AT_LEAST) <= budget
        again = points[within & (scores < AT_LEAST)]
        spent += len(points) + len(failing)
        if len(again):
            repeated += list(again[planted.score(again, 1) < AT_LEAST])
    return int(planted.modes(np.array(repeated)).any(axis=0).sum()) if repeated else 0


def _search(
    planted: planted_modes.Planted, seed: int, budget: int, covariates: Covariates | None
) -> tuple[int, int, float]:
    """Return the numbers of modes found and reported, and the CPU seconds per batch."""
    strategy = Find(Cube(planted.dimensions), at_least=AT_LEAST, seed=seed, covariates=covariates)
    told, asked = _Told(), Counter[bytes]()
    waiting: list[Floats] = []
    spent, batches, seconds = 0, 0, 0.0
    while spent < budget or waiting:
        before = time.process_time()
        if spent < budget:
            waiting.append(strategy.ask(min(budget // BATCHES, budget - spent)).points)
            spent += len(waiting[-1])
            batches += 1
        seconds += time.process_time() - before
        if len(waiting) == 2 or spent >= budget:
            points = waiting.pop(0)
            scores = _scores(planted, asked, points, told)
            before = time.process_time()
            strategy.tell(points, scores)
            seconds += time.process_time() - before
    known = strategy.result
    return told.modes(planted), len(known.modes) if known else 0, seconds / batches


class _Told:
    """Points that failed under a second seed."""

    def __init__(self) -> None:
        self.failed: set[bytes] = set()
        self.repeated: list[Floats] = []

    def modes(self, planted: planted_modes.Planted) -> int:
        return int(planted.modes(np.array(self.repeated)).any(axis=0).sum()) if self.repeated else 0


def _scores(planted: planted_modes.Planted, asked: Counter[bytes], points: Floats, told: _Told) -> Floats:
    repeats = []
    for point in points:
        repeats.append(asked[point.tobytes()])
        asked[point.tobytes()] += 1
    scores = np.empty(len(points))
    for repeat in set(repeats):
        chosen = np.array(repeats) == repeat
        scores[chosen] = planted.score(points[chosen], repeat)
    for point, repeat, score in zip(points, repeats, scores, strict=True):
        if score < AT_LEAST and repeat == 0:
            told.failed.add(point.tobytes())
        elif score < AT_LEAST and point.tobytes() in told.failed:
            told.repeated.append(point)
    return scores


@dataclass(frozen=True, slots=True)
class MapRow:
    """Mean shares of wrong calls (of a map, among the points that it calls) and of points that a map leaves unknown.

    Attributes:
        worst: largest share of wrong calls of a map.
        failed: share of maps with more wrong calls than `mapping.WRONG`.
        sobol_wrong, sobol_not_known: of maps of Sobol' points only.
        grid_wrong: of interpolated grids; NaN for domains with choices.
    """

    goal: str
    family: str
    repetitions: int
    evaluations: int
    wrong: float
    not_known: float
    worst: float
    failed: float
    sobol_wrong: float
    sobol_not_known: float
    grid_wrong: float
    overhead: float


def measure_map(family: str, *, seed: int, repetitions: int, batch: int = 60) -> MapRow:
    """Measure maps."""
    table, overhead = [], []
    for repetition in range(seed, seed + repetitions):
        domain, score = _planted_map(family, repetition)
        points = np.random.default_rng([repetition, 3]).random((_CHECKED, domain.dimensions))
        truth = score(points)
        row = []
        for exploring in (mapping.EXPLORING, 1.0):
            with mock.patch.object(mapping, "EXPLORING", exploring):
                strategy = Map(domain, at_least=AT_LEAST, seed=repetition)
                started = time.process_time()
                pursue(strategy, score, budget=MAP_BUDGET, batch=batch)
                calls = strategy.calls(points)
                if exploring < 1:
                    overhead.append((time.process_time() - started) * batch / MAP_BUDGET)
            row += _wrong(calls, truth)
        table.append([*row, np.nan if isinstance(domain, Domain) else _grid_wrong(score, points, truth)])
    rows = np.array(table)
    means, wrong = rows.mean(axis=0), rows[:, 0]
    return MapRow(
        "map",
        family,
        repetitions,
        MAP_BUDGET,
        float(means[0]),
        float(means[1]),
        float(wrong.max()),
        float(np.mean(wrong > mapping.WRONG)),
        float(means[2]),
        float(means[3]),
        float(means[4]),
        float(np.mean(overhead)),
    )


def _planted_map(family: str, seed: int) -> tuple[Cube, Callable[[Floats], Floats]]:
    if family in planted_streets.LOADS:
        street = planted_streets.plant(family, seed)
        return street.domain, street.score
    return Cube(MAP_DIMENSIONS), planted_scores.plant(family, seed, 0.3, MAP_DIMENSIONS).score


def _wrong(calls: np.typing.NDArray[np.str_], truth: Floats) -> list[float]:
    """Return the share of wrong calls among the called points, and the share of unknown points."""
    right = np.where(np.isnan(truth), Call.UNDEFINED, np.where(truth < AT_LEAST, Call.FAIL, Call.PASS))
    known = calls != Call.NOT_KNOWN
    return [float(np.mean(calls[known] != right[known])) if known.any() else 0.0, float(np.mean(~known))]


def _grid_wrong(score: Callable[[Floats], Floats], points: Floats, truth: Floats) -> float:
    nodes = (np.arange(GRID) + 0.5) / GRID
    mesh = np.stack(np.meshgrid(*[nodes] * MAP_DIMENSIONS, indexing="ij"), axis=-1)
    scores = score(mesh.reshape(-1, MAP_DIMENSIONS))
    values = logit(np.clip(np.nan_to_num(scores, nan=AT_LEAST), 0.003, 0.997)).reshape(mesh.shape[:-1])
    grid = RegularGridInterpolator([nodes] * MAP_DIMENSIONS, values, bounds_error=False, fill_value=None)
    return float(np.mean(((grid(points) < 0) != (truth < AT_LEAST))[~np.isnan(truth)]))


@dataclass(frozen=True, slots=True)
class CoverageRow:
    """Coverage of an interval, and its mean number of pairs.

    Attributes:
        gain: for cascades, the ratio of the squared width of plain Monte Carlo's interval from scores of the costly engine
            alone, at the same cost, to the mean squared width.
    """

    goal: str
    case: str
    repetitions: int
    coverage: float
    pairs: float
    gain: float


def measure_compare(case: str, *, seed: int, repetitions: int) -> CoverageRow:
    """Measure the coverage of differences that stop at a half-width of 0.02, or 0.005 for rare flips."""
    flips = {"mild": None, "flips in 5 %": 0.05, "flips in 0.5 %": 0.005}[case]
    within = 0.02 if flips is None or flips > 0.01 else 0.005

    def scores(points: Floats) -> Floats:
        if flips is None:
            return np.column_stack([points[:, 0], np.clip(points[:, 0] + 0.3 * points[:, 1] - 0.1, 0, 1)])
        return np.column_stack([np.ones(len(points)), points[:, 0] >= flips])

    truth = -flips if flips is not None else float(np.diff(scores(np.random.default_rng(1).random((2**22, 2)))).mean())
    held, pairs = [], []
    for repetition in range(seed, seed + repetitions):
        strategy = Compare(Cube(2), within=within, seed=repetition)
        pursue(strategy, scores, budget=100_000, batch=100)
        known = strategy.result
        assert known is not None, "there are scores"
        held.append(known.low <= truth <= known.high)
        pairs.append(known.pairs)
    return CoverageRow("compare", case, repetitions, float(np.mean(held)), float(np.mean(pairs)), float("nan"))


@dataclass(frozen=True, slots=True)
class _TwoEngines:
    """Scores by two engines: of (n, 2) points by an engine, the true mean or failure rate, and True for a rate."""

    scores: Callable[[Floats, int], Floats]
    truth: float
    rate: bool


def _correlated(correlation: float, repetition: int) -> _TwoEngines:
    del repetition
    # The costly score mixes the cheap one, of deviation 0.6 / √12, and noise of deviation 1 / √12.
    noise = 0.6 * (1 / correlation**2 - 1) ** 0.5
    spread = noise / (1 + noise)

    def scores(points: Floats, level: int) -> Floats:
        cheap = 0.2 + 0.6 * points[:, 0]
        return cheap if level == 0 else (1 - spread) * cheap + spread * points[:, 1]

    return _TwoEngines(scores, 0.5, rate=False)


def _failing(cheap: float, missed: float, others: float) -> _TwoEngines:
    """Return failures of a rate by the cheap engine, of which the costly one passes some, and fails others."""

    def scores(points: Floats, level: int) -> Floats:
        u = points[:, 0]
        return np.where(u < cheap if level == 0 else (u > missed) & (u < cheap + others), 0.1, 0.9)

    return _TwoEngines(scores, cheap - missed + others, rate=True)


def _drawn(repetition: int) -> _TwoEngines:
    rng = np.random.default_rng([repetition, 8])
    cheap = float(np.exp(rng.uniform(np.log(0.005), np.log(0.3))))
    return _failing(cheap, cheap * rng.uniform(0.02, 0.7), float(np.exp(rng.uniform(np.log(5e-4), np.log(0.05)))))


@cache
def _kept_pairs(function: str) -> Floats:
    """Return (2, n) pACC by raster and by Cycles where both are defined."""
    kept = Path(__file__).parents[1] / "docs" / "experiment"
    tables = [EvaluationTable.from_parquet(kept / f"paper-cycles{end}.parquet") for end in ("-raster", "")]
    pairs = np.stack([table.numbers("pacc")[table.codes("function").where(function)] for table in tables])
    return np.asarray(pairs[:, ~np.isnan(pairs).any(axis=0)])


def _measured(function: str, repetition: int, *, rate: bool) -> _TwoEngines:
    """Return draws from the pACC of a network on the kept frames of ``make paper-cycles``, by raster and Cycles."""
    del repetition
    pairs = _kept_pairs(function)

    def scores(points: Floats, level: int) -> Floats:
        return np.asarray(pairs[level, (points[:, 0] * pairs.shape[1]).astype(np.int64)])

    return _TwoEngines(scores, float(np.mean(pairs[1] < AT_LEAST if rate else pairs[1])), rate)


def measure_cascade(case: str, *, seed: int, repetitions: int) -> CoverageRow:
    """Measure estimates from two engines with costs of 1 and `COSTLY`, in 40 batches of 60."""
    held, pairs, squares, plain = [], [], [], []
    for repetition in range(seed, seed + repetitions):
        engines = CASCADE_CASES[case](repetition)
        strategy = Cascade(Cube(2), seed=repetition, costs=(1, COSTLY), at_least=AT_LEAST if engines.rate else None)
        cost = 0
        for _ in range(40):
            proposal = strategy.ask(60)
            strategy.tell(proposal.points, engines.scores(proposal.points, proposal.level))
            cost += len(proposal) * (COSTLY if proposal.level else 1)
        alone = engines.scores(np.random.default_rng([repetition, 7]).random((cost // COSTLY, 2)), 1)
        units = sampling_units("random", np.arange(len(alone)))
        interval = mean_interval(alone < AT_LEAST if engines.rate else alone, units)
        assert isinstance(interval, Interval), "there are enough points"
        plain.append((interval.high - interval.low) ** 2)
        known = strategy.result
        assert known is not None, "there are enough pairs"
        held.append(known.low <= engines.truth <= known.high)
        pairs.append(known.costly)
        squares.append((known.high - known.low) ** 2)
    gain = float(np.mean(plain) / np.mean(squares))
    return CoverageRow("cascade", case, repetitions, float(np.mean(held)), float(np.mean(pairs)), gain)


COMPARE_CASES: Final = ("mild", "flips in 5 %", "flips in 0.5 %")
#: Name to the engines of a repetition.
CASCADE_CASES: Final[dict[str, Callable[[int], _TwoEngines]]] = {
    "correlation 0.8": partial(_correlated, 0.8),
    "correlation 0.95": partial(_correlated, 0.95),
    "rare failures": lambda _: _failing(0.02, 0.005, 0.005),
    "any rates": _drawn,
    **{
        f"Cycles, {function}, {'rate' if rate else 'mean'}": partial(_measured, function, rate=rate)
        for function in ("semantic-fpn-small", "deeplabv3plus-small")
        for rate in (False, True)
    },
}
#: Cost of the costly engine, in units of the cheap one's.
COSTLY: Final = 25
