"""Measure error rates and power of findings, verdicts, the gate and curves on planted truth.

``make bench-findings``, or ``python -m benchmarks.bench_findings [--repetitions N]``. The worlds are those of
`benchmarks.planted` that were not used to choose methods, one with heavy tails, and separate curves. The tables show failures
and successes alike. *Confirmed* counts findings of `valerie.statistics.confirmation.find`. *Named* counts effects by Holm's
procedure over all main effects and all places at once: the result without confirmation.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, expit, ndtr
from scipy.stats import qmc

from benchmarks import planted, results
from benchmarks.planted import REPORTED, World
from benchmarks.planted_grids import planted_grid
from tests.planted_tables import drawn_space, planted_table, requirement
from valerie.analysis.findings.search import find_findings
from valerie.analysis.rows.design import Design
from valerie.analysis.verdicts.verdicts import judge_requirements
from valerie.plain import JsonObject
from valerie.statistics.confirmation import find, holm
from valerie.statistics.contrasts import contrasts
from valerie.statistics.curves import Shape, contradicted_bins, fit_curve
from valerie.statistics.gates import compare_versions, places_for_gate
from valerie.statistics.importance import measured_importance, variance_shares
from valerie.statistics.observations import Observations, bin_codes, observe
from valerie.statistics.power import places_needed
from valerie.statistics.verdicts import Outcome, judge_sample, units_to_decide

Floats = NDArray[np.float64]
Row = JsonObject
Generator = np.random.Generator


def _heavy(u: Floats) -> Floats:
    """Return sums of Student's t with two degrees of freedom, without variance or bounds."""
    t = (2 * u - 1) / np.sqrt(2 * u * (1 - u))
    return np.asarray(0.7 + 0.06 * t.sum(axis=-1))


WORLDS: Final[dict[str, World]] = {**REPORTED, "heavy tails": _heavy}
#: Numbers of places across, places along, suns, characters and cameras.
FIRST_RUN: Final = (3, 4, 2, 2, 3)
GRID: Final = (6, 8, 4, 2, 3)
#: As many places as one heading of `examples/paper-small.yaml` has without those where a person would stand in a thing.
PAPER_SMALL: Final = (10, 12, 4, 2, 3)
_SHAPES: Final = {" x ".join(map(str, shape)): shape for shape in (PAPER_SMALL, GRID, FIRST_RUN)}


# Scores without an effect of any factor -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Rows:
    """Planted rows: scores, places and factors; and positions, if the analysis is to look for places that are alike."""

    values: Floats
    places: NDArray[np.int64]
    factors: dict[str, NDArray[np.int64]]
    positions: Floats | None = None

    def observed(self) -> Observations:
        return observe(self.values, self.places, self.factors, self.positions)


def crossed(
    world: World, shape: tuple[int, ...], rng: Generator, reach_m: float | None = None, *, effects: bool = False
) -> Rows:
    """Return the rows of a grid: places differ, suns and characters act differently at each, and rows vary randomly.

    Args:
        world: function of hidden numbers that no factor changes.
        shape: numbers as in `PAPER_SMALL`.
        rng: source of all random numbers.
        reach_m: correlation length of the first three numbers over places 3 m apart, whose positions the analysis knows; 0 or
            None: places are independent; None: the analysis takes them so.
        effects: whether the numbers of each sun and character correlate likewise, so that their effects are alike among
            neighbours, with the mean 0 over streets.
    """
    x, y, sun, character, camera = (axis.ravel() for axis in np.meshgrid(*map(np.arange, shape), indexing="ij"))
    place = x * shape[1] + y
    u = rng.random((len(x), 6))
    reach = reach_m or 0.0
    of_effects = reach if effects else 0.0
    u[:, :3] = correlated_field(shape, reach, 3, rng)[place]
    u[:, 3] = correlated_field(shape, of_effects, shape[2], rng)[place, sun]
    u[:, 4] = correlated_field(shape, of_effects, shape[3], rng)[place, character]
    factors = {"x": x, "y": y, "sun": sun, "character": character, "camera": camera}
    positions = None if reach_m is None else np.asarray(3.0 * np.column_stack([x, y]), np.float64)
    return Rows(world(u), place, factors, positions)


def correlated_field(shape: tuple[int, ...], reach_m: float, numbers: int, rng: Generator) -> Floats:
    """Return (G, numbers) uniform numbers of correlated random fields over places 3 m apart; 0: independent numbers."""
    if not reach_m:
        return rng.random((shape[0] * shape[1], numbers))
    x, y = (3.0 * axis.ravel() for axis in np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij"))
    distance = np.hypot(x[:, None] - x, y[:, None] - y)
    root = np.linalg.cholesky(np.exp(-distance / reach_m) + 1e-9 * np.eye(len(x)))
    return np.asarray(ndtr(root @ rng.standard_normal((len(x), numbers))))


def drawn(world: World, design: str, units: int, rng: Generator) -> Rows:
    """Return variants of six factors without effects, one row each."""
    if design == "sobol":
        position = qmc.Sobol(6, rng=rng).random(units)
    elif design == "latin hypercube":
        position = qmc.LatinHypercube(6, rng=rng).random(units)
    else:
        position = rng.random((units, 6))
    factors = {f"factor-{k}": bin_codes(position[:, k], 3) for k in range(6)}
    return Rows(world(rng.random((units, 6))), np.arange(units), factors)


def clustered(world: World, units: int, rng: Generator) -> Rows:
    """Return places with 2 to 8 rows; three factors are drawn per place, three per row."""
    place = np.repeat(np.arange(units), rng.integers(2, 9, units))
    u = rng.random((units, 6))[place]
    u[:, 4:] = rng.random((len(place), 2))
    factors = {f"factor-{k}": rng.integers(0, 3, units)[place] for k in range(3)}
    factors |= {f"row-factor-{k}": rng.integers(0, 3, len(place)) for k in range(3)}
    return Rows(world(u), place, factors)


def lowered(rows: Rows, factor: str, points: float, rng: Generator, *, kind: str) -> Rows:
    """Lower the mean of a factor's last level by ``points``: all scores in proportion, or all scores of some places to 0."""
    where = rows.factors[factor] == rows.factors[factor].max()
    share = points / rows.values[where].mean()
    values = rows.values.copy()
    if kind == "all places a little":
        values[where] *= 1 - share
    else:
        fails = rng.random(rows.places.max() + 1) < share
        values[where & fails[rows.places]] = 0.0
    return replace(rows, values=values)


# Findings -----------------------------------------------------------------------------------------------------------------


def false_findings(repetitions: int) -> Iterator[Row]:
    makers: dict[str, Callable[[World, Generator], Rows]] = {
        "independent, 200": lambda world, rng: drawn(world, "random", 200, rng),
        "clustered, 60 places": lambda world, rng: clustered(world, 60, rng),
        "sobol, 256": lambda world, rng: drawn(world, "sobol", 256, rng),
        "latin hypercube, 200": lambda world, rng: drawn(world, "latin hypercube", 200, rng),
    }
    for design, make in makers.items():
        for name, world in WORLDS.items():
            yield _no_effect(design, name, partial(make, world), repetitions)
    for size, shape in _SHAPES.items():
        for name, world in WORLDS.items():
            yield _no_effect(f"grid {size}", name, partial(crossed, world, shape), repetitions)
    for reach in (4.0, 15.0):
        for effects in (False, True):
            alike = partial(crossed, REPORTED["mild"], GRID, reach_m=reach, effects=effects)
            what = "places and effects" if effects else "places"
            yield _no_effect(f"grid 6 x 8, {what} alike over {reach:g} m", "mild", alike, repetitions)


def _no_effect(design: str, world: str, make: Callable[[Generator], Rows], repetitions: int) -> Row:
    rng = np.random.default_rng(11)
    confirmed = named = 0
    for repetition in range(repetitions):
        observations = make(rng).observed()
        confirmed += any(item.confirmed for item in find(observations, seed=repetition).items)
        named += bool((holm([c.p_value for c in contrasts(observations, interactions=False)]) <= 0.05).any())
    return {
        "design": design,
        "world": world,
        "false confirmed": confirmed / repetitions,
        "false named": named / repetitions,
    }


def true_findings(repetitions: int) -> Iterator[Row]:
    for size, shape in _SHAPES.items():
        for name, world in REPORTED.items():
            for kind in ("all places a little", "some places to 0"):
                yield _effect(size, shape, name, world, "sun", kind, repetitions)
    # An effect between places: the last row along the street.
    for size, shape in _SHAPES.items():
        yield _effect(size, shape, "mild", REPORTED["mild"], "y", "all places a little", repetitions)


def _effect(
    size: str, shape: tuple[int, ...], name: str, world: World, factor: str, kind: str, repetitions: int
) -> Row:
    rng = np.random.default_rng(12)
    confirmed = named = others = 0
    needed = []
    for repetition in range(repetitions):
        observations = lowered(crossed(world, shape, rng), factor, 0.2, rng, kind=kind).observed()
        holding = [item.candidate for item in find(observations, seed=repetition).items if item.confirmed]
        confirmed += any(item.changes[0].factor == factor and len(item.changes) == 1 for item in holding)
        # A loss at some places changes interactions too: only findings on other factors are false.
        others += any(all(change.factor != factor for change in item.changes) for item in holding)
        main = contrasts(observations, interactions=False)
        adjusted = holm([c.p_value for c in main])
        named += any(c.changes[0].factor == factor and p <= 0.05 for c, p in zip(main, adjusted, strict=True))
        last = int(observations.levels[factor].max())
        ours = next(c for c in main if c.changes[0].factor == factor and c.changes[0].after == last)
        alpha = 0.025 / len(main)
        needed.append(places_needed(0.2, ours.deviation, alpha=alpha, parameters=ours.parameters) or np.inf)
    return {
        "grid": size,
        "world": name,
        "factor": factor,
        "20 points": kind,
        "confirmed": confirmed / repetitions,
        "named": named / repetitions,
        "other confirmed (false)": others / repetitions,
        "places needed, median": float(np.median(needed)),
    }


def from_tables(repetitions: int) -> Iterator[Row]:
    """Yield results of the analysis of whole runs of two functions, from long table to findings."""
    for size, shape in _SHAPES.items():
        for name in ("mild", "piled"):
            for points in (0.0, 0.2):
                yield _from_tables(size, shape, name, points, repetitions)


def _from_tables(size: str, shape: tuple[int, ...], name: str, points: float, repetitions: int) -> Row:
    rng = np.random.default_rng(18)
    confirmed = others = 0
    for repetition in range(repetitions):
        rows = crossed(REPORTED[name], shape, rng)
        if points:
            rows = lowered(rows, "sun", points, rng, kind="all places a little")
        second = crossed(REPORTED[name], shape, rng)
        table = planted_grid({"lowered": rows.values, "plain": second.values}, rows.factors)
        items = find_findings(table, seed=repetition).items
        sun = [item.function == "lowered" and item.steps[0].factor == "sun-1.azimuth" for item in items]
        confirmed += any(sun)
        others += any(item.function == "plain" or not points for item in items)
    return {
        "grid": size,
        "world": name,
        "points of a sun": 100 * points,
        "sun confirmed": confirmed / repetitions,
        "others confirmed (false)": others / repetitions,
    }


# Verdicts -----------------------------------------------------------------------------------------------------------------

#: True shares, against a bound of 0.95.
BOUND: Final = 0.95
SHARES: Final = (0.90, 0.93, 0.97, 0.98, 0.99)
MOST_UNITS: Final = 3000


def verdicts(repetitions: int) -> Iterator[Row]:
    for truth in SHARES:
        yield _verdicts("independent units", truth, repetitions, pass_or_fail, 1)
    for truth in (BOUND - 1e-9, BOUND):
        yield _verdicts("independent units", truth, repetitions, pass_or_fail, 1)
        yield _verdicts("24 rows a place, alike", truth, repetitions, _alike, 24)
        yield _verdicts("places of two kinds", truth, repetitions, _two_kinds, 6)


def pass_or_fail(truth: float, units: int, rows: int, rng: Generator) -> Floats:
    return (rng.random((units, rows)) < truth).astype(float)


def _alike(truth: float, units: int, rows: int, rng: Generator) -> Floats:
    """Return rows whose shares by place follow a Beta distribution with an intraclass correlation of 0.5."""
    return (rng.random((units, rows)) < rng.beta(truth, 1 - truth, (units, 1))).astype(float)


def _two_kinds(truth: float, units: int, rows: int, rng: Generator) -> Floats:
    """Return rows with failure rates of 9 times the mean in a tenth of the places, and of a ninth of the mean in the others."""
    hard = rng.random((units, 1)) < 0.1
    share = np.where(hard, 1 - 9 * (1 - truth), 1 - (1 - truth) / 9)
    return (rng.random((units, rows)) < share).astype(float)


def _verdicts(
    kind: str, truth: float, repetitions: int, make: Callable[[float, int, int, Generator], Floats], rows: int
) -> Row:
    rng = np.random.default_rng(13)
    units = np.repeat(np.arange(MOST_UNITS), rows)
    outcomes: Counter[Outcome] = Counter()
    ends = []
    for _ in range(repetitions):
        verdict = judge_sample(make(truth, MOST_UNITS, rows, rng).ravel(), units, at_least=BOUND)
        outcomes[verdict.outcome] += 1
        ends.append(verdict.decided_after or MOST_UNITS)
    false = Outcome.NOT_MET if truth >= BOUND else Outcome.MET
    return {
        "units": kind,
        "true share": round(truth, 6),
        "is met": truth >= BOUND,
        "false verdicts": outcomes[false] / repetitions,
        "undecided after 3,000": outcomes[Outcome.UNDECIDED] / repetitions,
        "mean units": float(np.mean(ends)),
        "units said before": units_to_decide(truth, at_least=BOUND),
    }


#: Design to numbers of variants; fewer than 20 variants of an even design are independent.
DRAWN: Final = {"random": (50, 400), "sobol": (16, 64, 256), "halton": (256,), "latin_hypercube": (50, 200)}
#: Person-rows of one variant; the first share of the variants failed for good.
ROWS: Final = 4
LOST: Final = 0.03


def table_verdicts(repetitions: int) -> Iterator[Row]:
    """Judge a requirement whose bound is the truth, from the tables of whole runs; then every verdict is false."""
    for design, counts in DRAWN.items():
        for count in counts:
            for name, world in REPORTED.items():
                for statistic in ("mean(pacc)", "share(pacc >= 0.5)"):
                    for lost in (0.0, LOST) if design == "random" else (0.0,):
                        yield _table_verdicts(design, count, name, world, statistic, lost, repetitions)


def _table_verdicts(
    design: str, count: int, name: str, world: World, statistic: str, lost: float, repetitions: int
) -> Row:
    rng = np.random.default_rng(16)
    share = statistic.startswith("share")
    # Rows of a variant share all hidden numbers but the last two; the region contains the first half of them.
    bound = planted.truth(planted.passed(world) if share else world, "independent")
    required = requirement(f"{statistic} >= {bound!r}", where="distance_m < 20")
    outcomes: Counter[Outcome] = Counter()
    variants = np.repeat(np.arange(count), ROWS)
    distance = np.tile(np.where(np.arange(ROWS) < ROWS / 2, 10.0, 30.0), count)
    for repetition in range(repetitions):
        space = drawn_space(design, count, dimensions=4, seed=repetition)
        u = np.array([list(values.values()) for _, values in space.values(0, count)])
        hidden = np.concatenate([np.repeat(u / 1000, ROWS, axis=0), rng.random((count * ROWS, 2))], axis=1)
        scores = world(hidden)
        gone = np.repeat(rng.random(count) < lost, ROWS)
        table = planted_table(scores[~gone], variants[~gone], distance_m=distance[~gone])
        rows = [
            {
                "variant_index": variant,
                "function": "net",
                "distance_m": far,
                "undefined_reason": None,
                "pixel_area": None,
            }
            for variant, far in zip(variants[gone].tolist(), distance[gone].tolist(), strict=True)
        ]
        (verdict,) = judge_requirements(
            [required], table, Design(((design, count),)), regions={"R": distance[~gone] < 20}, lost=rows
        )
        outcomes[verdict.outcome] += 1
    false = (outcomes[Outcome.MET] + outcomes[Outcome.NOT_MET]) / repetitions
    # If the true rate is 5 %, one row in 1,000 exceeds it by chance.
    limit = 0.05 + 3.1 * float(np.sqrt(0.05 * 0.95 / repetitions))
    return {
        "design": f"{design}, {count}",
        "world": name,
        "required": statistic,
        "lost": lost,
        "false met": outcomes[Outcome.MET] / repetitions,
        "false not met": outcomes[Outcome.NOT_MET] / repetitions,
        "holds": "yes" if false <= limit else "NO",
    }


# The gate -----------------------------------------------------------------------------------------------------------------

SLICES: Final = 20
WORSE: Final = 4
#: Standard deviation of a place's change between nearly equal versions, such as two trainings on almost the same data.
NEAR: Final = 0.03


def gates(repetitions: int) -> Iterator[Row]:
    for name, world in WORLDS.items():
        for places, change in ((12, "none"), (48, "none"), (48, "5 points, all rows"), (48, "5 points, few rows")):
            yield _gate(name, places, change, repetitions, partial(_two_versions, world))
    # The number of places that the gate requires, from the spread of an earlier comparison.
    rng = np.random.default_rng(14)
    before, after = _two_versions(REPORTED["mild"], 2000, "none", rng)
    deviation = float((after[0] - before[0]).mean(axis=1).std(ddof=1))
    needed = places_for_gate(0.05, deviation, SLICES) or 0
    yield _gate("mild", needed, "5 points, all rows", repetitions, partial(_two_versions, REPORTED["mild"]))
    for change in ("none", "1 point of one slice", "1 point of one slice, few large flips"):
        for places in (100, 250, 1000, 2000):
            yield _gate("nearly equal", places, change, repetitions, _near_versions)


def _near_versions(places: int, change: str, rng: Generator) -> tuple[Floats, Floats]:
    """Return (slices, places, 6) scores of two nearly equal versions; the first slice becomes worse, unless ``change`` is none.

    Large flips are persons that the second version no longer sees.
    """
    scores = rng.normal(0.8, 0.1, (SLICES, places, 1)) + rng.normal(0, 0.03, (SLICES, places, 6))
    # Both are clipped alike, so that without a change they are exchangeable.
    before, after = scores + rng.normal(0, NEAR / np.sqrt(2), (2, SLICES, places, 1))
    if change == "1 point of one slice":
        after[:1] -= 0.01
    elif change != "none":
        after[:1] -= 0.8 * (rng.random((1, places, 1)) < 0.01 / 0.8)
    return np.clip(before, 0, 1), np.clip(after, 0, 1)


def _two_versions(world: World, places: int, change: str, rng: Generator) -> tuple[Floats, Floats]:
    """Return (slices, places, 6) scores of two versions on the same frames, which differ in two of six numbers.

    The first `WORSE` slices become worse, unless ``change`` is none.
    """
    u = rng.random((SLICES, places, 6, 6))
    u[..., :3] = u[:, :, :1, :3]
    other = u.copy()
    other[..., 4] = rng.random((SLICES, places, 1))
    other[..., 5] = rng.random(u.shape[:3])
    before, after = world(u), world(other)
    if change == "5 points, all rows":
        after[:WORSE] -= 0.05
    elif change == "5 points, few rows":
        after[:WORSE] -= 0.8 * (rng.random(after[:WORSE].shape) < 0.05 / 0.8)
    return before, after


def _gate(
    name: str,
    places: int,
    change: str,
    repetitions: int,
    versions: Callable[[int, str, Generator], tuple[Floats, Floats]],
) -> Row:
    rng = np.random.default_rng(15)
    code = np.repeat(np.arange(SLICES * places), 6)
    slices = {str(k): code // places == k for k in range(SLICES)}
    worse = 0 if change == "none" else 1 if "one slice" in change else WORSE
    false, power = [], []
    for _ in range(repetitions):
        before, after = versions(places, change, rng)
        gate = compare_versions(before.ravel(), after.ravel(), code, slices)
        named = np.array([item.worse for item in gate.slices])
        false.append(named[worse:].sum() / max(named.sum(), 1))
        power.append(named[:worse].mean() if worse else np.nan)
    return {
        "world": name,
        "places a slice": places,
        "change": change,
        "false discoveries": float(np.mean(false)),
        "power": float(np.mean(power)),
    }


# Curves -------------------------------------------------------------------------------------------------------------------

CURVES: Final[dict[str, Callable[[Floats], Floats]]] = {
    "flat": lambda x: np.full_like(x, 0.7),
    "slope": lambda x: 0.9 - 0.4 * x,
    "sigmoid": lambda x: 0.08 + 0.86 * expit((0.45 - x) / 0.06),
    "cliff": lambda x: np.where(x < 0.62, 0.6, 0.2),
    "hump": lambda x: 0.35 + 0.45 * np.exp(-(((x - 0.4) / 0.18) ** 2)),
}


def curves(repetitions: int) -> Iterator[Row]:
    for scores in ("mild", "piled"):
        for within, places in ((True, 12), (True, 48), (True, 200), (False, 48)):
            for name, curve in CURVES.items():
                yield _curve(name, curve, scores, places, within, repetitions)


def _curve(
    name: str, curve: Callable[[Floats], Floats], scores: str, places: int, within: bool, repetitions: int
) -> Row:
    rng = np.random.default_rng(16)
    place = np.repeat(np.arange(places), 6)
    shapes: Counter[str] = Counter()
    inside, widths, errors, contradicted = [], [], [], 0
    for repetition in range(repetitions):
        x = (rng.random((places, 6)) if within else np.repeat(rng.random((places, 1)), 6, axis=1)).ravel()
        # Rows of a place are alike: their ranks among all scores at that x correlate by 0.4.
        rank = ndtr(0.4**0.5 * rng.standard_normal(places)[place] + 0.6**0.5 * rng.standard_normal(len(x)))
        mean = curve(x)
        values = betaincinv(4 * mean, 4 * (1 - mean), rank) if scores == "mild" else (rank < mean).astype(float)
        fit = fit_curve(x, values, place, seed=repetition)
        if fit is None:
            continue
        shapes[fit.shape.value] += 1
        at, low, high = np.array(fit.x), np.array(fit.low), np.array(fit.high)
        truth = _bin_averages(curve, fit.bins.low, at) if fit.shape is Shape.FREE else curve(at)
        inside.append((low - 1e-9 <= truth) & (truth <= high + 1e-9))
        widths.append(float((high - low).mean()))
        errors.append(float(np.sqrt(((np.array(fit.y) - curve(at)) ** 2).mean())))
        drawn_at_rows = np.interp(x, at, fit.y)
        contradicted += fit.shape is not Shape.FREE and bool(
            contradicted_bins(drawn_at_rows, x, values, place, seed=repetition)
        )
    held = np.array(inside)
    return {
        "curve": name,
        "scores": scores,
        "places": places,
        "x varies": "within places" if within else "between places",
        "band holds everywhere": float(held.all(axis=1).mean()),
        "worst point": float(held.mean(axis=0).min()),
        "mean width": float(np.mean(widths)),
        "error of the curve": float(np.mean(errors)),
        "contradicted": contradicted / repetitions,
        "shapes": dict(shapes),
    }


def _bin_averages(curve: Callable[[Floats], Floats], lows: tuple[float, ...], at: Floats) -> Floats:
    """Return the curve's average over each point's bin, which a free curve estimates."""
    edges = np.array([*lows, 1.0])
    averages = np.array([curve(np.linspace(a, b, 200)).mean() for a, b in pairwise(edges.tolist())])
    return np.asarray(averages[np.searchsorted(edges[1:-1], at, side="right")])


# Importance ---------------------------------------------------------------------------------------------------------------

#: Correlations of the decoys with the contrast.
DECOYS: Final = np.linspace(0.5, 0.9, 10)
#: Standard deviation of the scores at one contrast.
NOISE: Final = 0.05


def importance(repetitions: int) -> Iterator[Row]:
    """Yield how often contrast, the only cause, and its decoys are named; and the errors of shares with known truth."""
    for rows in (1, 5):
        for count in (100, 300, 1000):
            for name in ("slope", "hump"):
                yield _named_columns(name, count, rows, repetitions)
    for design in ("grid", "random"):
        for noise in (0.0, 0.2):
            yield _shares(design, noise, repetitions)


def _named_columns(name: str, count: int, rows: int, repetitions: int) -> Row:
    """Plant ``count`` rows, ``rows`` per place; the rows of a place share half of the variance of contrast."""
    rng = np.random.default_rng(21)
    curves: dict[str, Callable[[Floats], Floats]] = {
        "slope": lambda u: 0.2 + 0.6 * u,
        "hump": lambda u: 0.2 + 0.6 * np.exp(-(((u - 0.5) / 0.2) ** 2)),
    }
    curve = curves[name]
    place = np.arange(count) // rows
    hits, false = 0, []
    for repetition in range(repetitions):
        of_place, own = rng.standard_normal((2, count))
        contrast = own if rows == 1 else 0.5**0.5 * (of_place[place] + own)
        decoys = DECOYS * contrast[:, None] + np.sqrt(1 - DECOYS**2) * rng.standard_normal((count, len(DECOYS)))
        scores = np.clip(curve(ndtr(contrast)) + NOISE * rng.standard_normal(count), 0, 1)
        columns = {"contrast": contrast, **{f"decoy-{k}": decoys[:, k] for k in range(len(DECOYS))}}
        results = measured_importance(scores, place, columns, seed=repetition)
        names = {result.column for result in results if result.named}
        hits += "contrast" in names
        false.append(len(names - {"contrast"}) / max(len(names), 1))
    return {
        "contrast": name,
        "rows": count,
        "rows a place": rows,
        "named": hits / repetitions,
        "false discoveries": float(np.mean(false)),
        "any decoy named": float(np.mean(np.array(false) > 0)),
    }


def _shares(design: str, noise: float, repetitions: int) -> Row:
    """Plant a main effect and an interaction whose Shapley effects are known; return the errors of the estimates."""
    rng = np.random.default_rng(20)
    errors = []
    for _ in range(repetitions):
        crossed_levels = np.stack([axis.ravel() for axis in np.indices((6, 8, 4, 2))])
        if design == "random":
            crossed_levels = np.stack([rng.integers(0, levels, 384) for levels in (6, 8, 4, 2)])
        a, _, c, d = crossed_levels
        parts = 0.4 * a / 5, 0.1 * c, 0.2 * (2 * (c % 2) - 1) * (2 * d - 1)
        scores = np.sum(parts, axis=0) + noise * rng.standard_normal(len(a))
        # Variances of the parts over equally frequent levels; the interaction is split equally between c and d.
        variances = np.array([0.08**2 * 35 / 12, 0.0, 0.1**2 * 15 / 12 + 0.02, 0.02])
        truth = variances / (variances.sum() + noise**2)
        factors = dict(zip("abcd", crossed_levels, strict=True))
        totals = {share.factor: share.total for share in variance_shares(observe(scores, np.arange(len(a)), factors))}
        errors.append([totals[name] - share for name, share in zip("abcd", truth, strict=True)])
    return {
        "design": design,
        "noise": noise,
        "largest bias": float(np.abs(np.mean(errors, axis=0)).max()),
        "largest standard deviation": float(np.std(errors, axis=0).max()),
    }


PARTS: Final[dict[str, Callable[[int], Iterator[Row]]]] = {
    "false findings": false_findings,
    "true findings": true_findings,
    "findings of tables": from_tables,
    "verdicts": verdicts,
    "verdicts from tables": table_verdicts,
    "gate": gates,
    "curves": curves,
    "importance": importance,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=1000)
    parser.add_argument("--only", choices=PARTS, help="one part; nothing is written")
    arguments = parser.parse_args()
    figures: dict[str, Any] = {"repetitions": arguments.repetitions}
    for part, rows in PARTS.items():
        if arguments.only not in {None, part}:
            continue
        print(f"\n{part}")
        figures[part] = results.print_rows(rows(arguments.repetitions))
    if arguments.only is None:
        results.write("findings", figures)


if __name__ == "__main__":
    main()
