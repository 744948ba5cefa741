"""Measure libraries on the planted truth of guided validation, beside the strategies that answer the same question.

*rates* (`benchmarks.planted_scores`): intervals of a failure rate by plain Monte Carlo, by randomised Sobol' points in eight
replicates, and by two methods of the package ``openturns`` (Baudin and others 2017, doi:10.1007/978-3-319-12385-1_64), as that
package gives them. These are subset sampling (Au and Beck 2001, doi:10.1016/S0266-8920(01)00019-4) and nonparametric adaptive
importance sampling (Morio 2011, *Reliab. Eng. Syst. Saf.* 96, 178-183). Both divide the budget by the number of levels that
the known rate needs, and may exceed it. Undefined scores pass. A width is in units of plain Monte Carlo's with as many
evaluations, which falls with their root.

*rank*: the indices of `Rank` and of the package ``SALib`` (Iwanaga and others 2022, doi:10.18174/sesmo.18155) with as many
evaluations, compared with indices from `REFERENCE` blocks.

*pairs*: evaluations of `Explain`, and of delta debugging (Zeller and Hildebrandt 2002, doi:10.1109/32.988498) by the package
``picire``, which drops changes but does not move numbers to the boundary.

A package that is not installed is named, and its figures stay empty. `Find` has its peers in `benchmarks.guided_goals`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from scipy.special import ndtr
from scipy.stats import qmc

from benchmarks import planted_scores
from valerie.guided import rank as ranking
from valerie.guided.domain import Cube, Domain
from valerie.guided.explain import Explain
from valerie.guided.strategy import pursue
from valerie.parameters.blocks import Variation
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Uniform
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.units import sampling_units

Floats = np.typing.NDArray[np.float64]

REPLICATES: Final = 8
#: Multiple of the budget at which a peer is stopped; it has no interval then, and so misses.
MOST: Final = 2
#: Blocks of the indices that count as true.
REFERENCE: Final = 2**15
#: Rows of SALib's designs.
ROWS: Final = (64, 128)
#: Failure rate of the planted scores whose parameters are ranked.
RANKED_RATE: Final = 0.1
#: Random points among which a failing and a passing one are sought for a minimal pair.
SOUGHT: Final = 2**14


@cache
def package(name: str) -> bool:
    """Return True if a package is installed; otherwise say once what stays empty."""
    installed = find_spec(name) is not None
    if not installed:
        print(f"the package {name} is not installed, so its figures stay empty (pip install {name})")
    return installed


@dataclass(frozen=True, slots=True)
class RateRow:
    """Intervals of a failure rate by one method.

    Attributes:
        evaluations: mean number of them.
        coverage: in the repetitions.
        width: see the module.
    """

    goal: str
    family: str
    method: str
    rate: float
    seed: int
    repetitions: int
    evaluations: float
    coverage: float
    width: float


def measure_rates(
    family: str, *, seed: int, repetitions: int, rate: float, budget: int, draws: int
) -> tuple[RateRow, ...]:
    """Measure the methods, ``draws`` times on each planted score."""
    found: dict[str, list[tuple[float, float, float]]] = {}
    for repetition in range(seed, seed + repetitions):
        if (repetition - seed) % draws == 0:
            planted = planted_scores.plant(family, repetition, rate)
        intervals = {"plain": _plain(planted, repetition, budget), "Sobol'": _sobol(planted, repetition, budget)}
        if package("openturns"):
            for method in ("subset", "NAIS"):
                intervals[method] = _simulated(planted, repetition, budget, method)
        for method, (low, high, evaluations) in intervals.items():
            found.setdefault(method, []).append((low <= planted.rate <= high, high - low, evaluations))
    means = {method: [_mean(column) for column in zip(*rows, strict=True)] for method, rows in found.items()}
    return tuple(
        RateRow(
            "rates",
            family,
            method,
            rate,
            seed,
            repetitions,
            evaluations,
            coverage,
            width / means["plain"][1] * math.sqrt(evaluations / budget),
        )
        for method, (coverage, width, evaluations) in means.items()
    )


def _mean(column: Iterable[float]) -> float:
    known = [value for value in column if not math.isnan(value)]
    return float(np.mean(known)) if known else math.nan


def _plain(planted: planted_scores.Planted, seed: int, budget: int) -> tuple[float, float, int]:
    points = np.random.default_rng([seed, 1, 3]).random((budget, planted.dimensions))
    interval = mean_interval(_fails(planted, points), sampling_units("random", np.arange(budget)))
    assert isinstance(interval, Interval), "there are enough points"
    return interval.low, interval.high, budget


def _sobol(planted: planted_scores.Planted, seed: int, budget: int) -> tuple[float, float, int]:
    size = budget // REPLICATES
    points = np.concatenate(
        [
            qmc.Sobol(planted.dimensions, rng=np.random.default_rng([seed, 1, 4, replicate])).random(size)
            for replicate in range(REPLICATES)
        ]
    )
    replicate = np.repeat(np.arange(REPLICATES), size)
    units = sampling_units("sobol", np.arange(len(points)), replicate=replicate)
    interval = mean_interval(_fails(planted, points), units)
    assert isinstance(interval, Interval), "there are enough replicates"
    return interval.low, interval.high, len(points)


def _fails(planted: planted_scores.Planted, points: Floats) -> np.typing.NDArray[np.bool_]:
    return np.asarray(planted.score(points) < planted_scores.AT_LEAST)


def _simulated(planted: planted_scores.Planted, seed: int, budget: int, method: str) -> tuple[float, float, int]:
    """Return OpenTURNS's interval of a rate, and its number of evaluations."""
    ot: Any = import_module("openturns")
    ot.RandomGenerator.SetSeed(seed)
    ot.Log.Show(ot.Log.NONE)
    spent = 0

    def score(sample: Any) -> Any:
        nonlocal spent
        points = np.minimum(ndtr(np.asarray(sample)), np.nextafter(1.0, 0.0))
        spent += len(points)
        if spent > MOST * budget:
            raise RuntimeError("no level comes closer")
        return np.nan_to_num(planted.score(points), nan=1.0)[:, None]

    function = ot.PythonFunction(planted.dimensions, 1, func_sample=score)
    # Normal parameters, since the importance sampling needs an unbounded domain.
    drawn = ot.RandomVector(ot.Normal(planted.dimensions))
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, drawn), ot.Less(), planted_scores.AT_LEAST)
    # Each level has a tenth of the failures of the one before; the last one is shorter on average.
    levels = math.ceil(-math.log10(planted.rate) - 0.05)
    size = budget // levels
    search = ot.SubsetSampling(event) if method == "subset" else ot.NAIS(event, 0.1)
    search.setMaximumOuterSampling(1 if method == "subset" else size)
    search.setBlockSize(size if method == "subset" else 1)
    try:
        search.run()
    except RuntimeError:
        if spent > MOST * budget:
            return math.nan, math.nan, spent
        raise
    result = search.getResult()
    estimate, half = result.getProbabilityEstimate(), result.getConfidenceLength(0.95) / 2
    return estimate - half, estimate + half, spent


@dataclass(frozen=True, slots=True)
class RankRow:
    """Indices by `Rank` and by SALib with as many evaluations; the latter's figures are None without it.

    Attributes:
        rows: SALib's number of rows, which sets the number of evaluations.
        evaluations: mean number of them.
        coverage: of the intervals of total shares; of the parameters that were not screened out.
        coverage_alone, coverage_shapley: of those of the shares alone and of the Shapley effects.
        width: mean width of the intervals of total shares.
        first: share of repetitions in which the parameter with the largest share is named.
        screened: largest true total share of a parameter that was screened out.
        refused: share of repetitions without indices.
    """

    goal: str
    family: str
    seed: int
    repetitions: int
    rows: int
    evaluations: float
    coverage: float
    coverage_alone: float
    coverage_shapley: float
    width: float
    first: float
    screened: float
    refused: float
    coverage_peer: float | None
    width_peer: float | None
    first_peer: float | None
    refused_peer: float | None


def measure_rank(family: str, *, seed: int, repetitions: int, draws: int, rows: int) -> RankRow:
    """Measure ``draws`` rankings of each planted score, of which a tenth fails; ``rows`` are those of SALib."""
    own: list[tuple[float, ...]] = []
    peer: list[tuple[float, ...]] = []
    for repetition in range(seed, seed + repetitions):
        if (repetition - seed) % draws == 0:
            planted = planted_scores.plant(family, repetition, RANKED_RATE)
            truth = true_shares(planted, repetition)
        own.append(_ranked(planted, repetition, rows * (planted.dimensions + 2), truth))
        if package("SALib"):
            peer.append(_by_salib(planted, repetition, truth[1], rows))
    coverage, of_alone, of_shapley, width, first, screened, refused, evaluations = np.array(own).T
    peers = [_mean(column) for column in np.array(peer).T] if peer else [None] * 4
    return RankRow(
        "rank",
        family,
        seed,
        repetitions,
        rows,
        float(evaluations.mean()),
        _mean(coverage),
        _mean(of_alone),
        _mean(of_shapley),
        _mean(width),
        _mean(first),
        float(screened.max()),
        float(refused.mean()),
        peers[0],
        peers[1],
        peers[2],
        peers[3],
    )


def true_shares(planted: planted_scores.Planted, seed: int) -> Floats:
    """Return the shares alone, in total and of Shapley among points with scores, (3, dimensions)."""
    rng = np.random.default_rng([seed, 1, 6])
    dimensions = planted.dimensions
    first, second = rng.random((2, REFERENCE, dimensions))
    paths = rng.permuted(np.tile(np.arange(dimensions), (REFERENCE, 1)), axis=1)
    columns = [planted.score(first), planted.score(second)]
    moved = np.zeros(first.shape, np.bool_)
    along = []
    for place in range(dimensions - 1):
        np.put_along_axis(moved, paths[:, [place]], np.True_, axis=1)
        if place:
            along.append(planted.score(np.where(moved, second, first)))
    for dimension in range(dimensions):
        mixed = first.copy()
        mixed[:, dimension] = second[:, dimension]
        columns.append(planted.score(mixed))
    table = np.column_stack([*columns, *along])
    whole = ~np.isnan(table).any(axis=1)
    return ranking.indices(table[whole], paths[whole])


def _ranked(planted: planted_scores.Planted, seed: int, budget: int, truth: Floats) -> tuple[float, ...]:
    strategy = ranking.Rank(Cube(planted.dimensions), seed=seed)
    spent = pursue(strategy, planted.score, budget=budget, batch=256)
    known, totals = strategy.result, truth[1]
    assert known is not None, "the screening has ended"
    screened = float(totals[list(known.screened_out)].max()) if known.screened_out else 0.0
    effects = [effect for effect in known.effects if effect.dimension is not None and effect.total is not None]
    if not effects:
        return (*[math.nan] * 5, screened, 1.0, spent)
    held: dict[str, list[bool]] = {"alone": [], "total": [], "shapley": []}
    for effect in effects:
        for (kind, covered), true in zip(held.items(), truth[:, effect.dimension], strict=True):
            share = getattr(effect, kind)
            covered.append(share.low <= true <= share.high)
    coverage = [float(np.mean(held[kind])) for kind in ("total", "alone", "shapley")]
    width = float(np.mean([effect.total.high - effect.total.low for effect in effects if effect.total]))
    first = known.effects[0].dimension == np.argmax(totals)
    return (*coverage, width, first, screened, 0.0, spent)


def _by_salib(planted: planted_scores.Planted, seed: int, totals: Floats, rows: int) -> tuple[float, ...]:
    """Return coverage and width of SALib's intervals; True if it names the first parameter; True if it has no indices."""
    sample, analyze = (import_module(f"SALib.{part}.sobol") for part in ("sample", "analyze"))
    dimensions = planted.dimensions
    problem = {
        "num_vars": dimensions,
        "names": [f"x{i}" for i in range(dimensions)],
        "bounds": [[0.0, 1.0]] * dimensions,
    }
    points = sample.sample(problem, rows, calc_second_order=False, seed=seed)
    shares = analyze.analyze(problem, planted.score(points), calc_second_order=False, seed=seed)
    estimates, halves = np.asarray(shares["ST"]), np.asarray(shares["ST_conf"])
    if not estimates.any():  # with an undefined score, all its shares are 0
        return math.nan, math.nan, math.nan, 1.0
    held = np.abs(estimates - totals) <= halves
    return float(held.mean()), float(2 * halves.mean()), float(np.argmax(estimates) == np.argmax(totals)), 0.0


@dataclass(frozen=True, slots=True)
class PairRow:
    """Minimal pairs by `Explain` and by delta debugging; the latter's figures are None without ``picire``.

    Attributes:
        evaluations: median, and largest number.
        changes: mean number of changes that remain.
        evaluations_peer, changes_peer: the same, without the way to the boundary.
    """

    goal: str
    family: str
    seed: int
    repetitions: int
    evaluations: tuple[float, float]
    changes: float
    evaluations_peer: tuple[float, float] | None
    changes_peer: float | None


def measure_pairs(family: str, *, seed: int, repetitions: int, rate: float = 0.01) -> PairRow:
    """Measure minimal pairs, each from one failing and one passing point of a planted score."""
    own, peer = [], []
    for repetition in range(seed, seed + repetitions):
        planted = planted_scores.plant(family, repetition, rate)
        points = np.random.default_rng([repetition, 1, 2]).random((SOUGHT, planted.dimensions))
        scores = planted.score(points)
        failing, passing = points[scores < planted_scores.AT_LEAST][0], points[scores >= planted_scores.AT_LEAST][0]
        strategy = Explain(cube(planted.dimensions), failing, passing, at_least=planted_scores.AT_LEAST)
        spent = pursue(strategy, planted.score, budget=1000, batch=1)
        assert strategy.result is not None, "the budget is ample"
        own.append((spent, len(strategy.result.changed)))
        if package("picire"):
            peer.append(_by_picire(planted, failing, passing))
    counts, changes = np.array(own).T
    of_peer = np.array(peer).T if peer else None
    return PairRow(
        "pairs",
        family,
        seed,
        repetitions,
        (float(np.median(counts)), float(counts.max())),
        float(changes.mean()),
        None if of_peer is None else (float(np.median(of_peer[0])), float(of_peer[0].max())),
        None if of_peer is None else float(of_peer[1].mean()),
    )


def cube(dimensions: int) -> Domain:
    """Return a domain of uniform parameters in 0…1."""
    definitions = [
        ParameterDefinition.model_validate(
            {"path": f"scene.x{i}", "type": "FLOAT", "minimum": 0, "maximum": 1, "default": 0, "affects": "geometry"}
        )
        for i in range(dimensions)
    ]
    return Domain(definitions, [Variation(definition.path, Uniform()) for definition in definitions])


def _by_picire(planted: planted_scores.Planted, failing: Floats, passing: Floats) -> tuple[int, int]:
    """Return the numbers of evaluations of delta debugging and of the changes that it keeps."""
    picire: Any = import_module("picire")
    spent = 0

    def outcome(changes: list[int], _: object) -> Any:
        nonlocal spent
        spent += 1
        point = passing.copy()
        point[changes] = failing[changes]
        fails = planted.score(point[None])[0] < planted_scores.AT_LEAST
        return picire.Outcome.FAIL if fails else picire.Outcome.PASS

    kept = picire.DD(outcome)(list(range(planted.dimensions)))
    return spent, len(kept)
