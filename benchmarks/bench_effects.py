"""Measure the coverage of effects and the power of verdicts on planted truth.

``make bench-effects``, or ``python -m benchmarks.bench_effects [--repetitions N --only PART]``. The worlds are its own: none was
used to choose a method. The tables show failures and successes alike.

====================== =================================================================================================
part                   question
====================== =================================================================================================
contrasts              Do the 95 % intervals of a difference within and between places contain it?
effects of findings    Do the intervals of confirmed findings contain the planted effect (at most 5 % miss)?
two runs               Do the intervals of a paired difference of two runs contain it?
sites and designs      Which share of runs without an effect confirms a finding, on several sites and with Halton points?
places alike           What is claimed of a grid without any effect where neighbouring places and their effects are alike?
causes alike           Which measured columns are named where places are alike and no column acts (limit 5 %), and one that
                       does act, at independent places?
trends                 How often is a rise or fall claimed without one (limit 5 %), and how often found? Do the intervals of
                       the difference between the last third and the first contain it?
one point              How often is a requirement one percentage point off its bound decided, and a drop of one point found?
paper-small            How often is an effect of a sun confirmed in exactly the rows of the paper's grid at one heading?
first place            How often is the one cause first among measured columns, in 100 rows?
====================== =================================================================================================
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.special import betaincinv, ndtr, ndtri
from scipy.stats import qmc, rankdata

from benchmarks import results
from benchmarks.bench_findings import (
    CURVES,
    DECOYS,
    FIRST_RUN,
    GRID,
    NOISE,
    PAPER_SMALL,
    Rows,
    correlated_field,
    crossed,
    pass_or_fail,
)
from benchmarks.planted import World
from valerie.analysis.findings.search import find_findings
from valerie.analysis.rows.table import EvaluationTable
from valerie.plain import JsonObject
from valerie.statistics.confirmation import find
from valerie.statistics.contrasts import Change, contrasts
from valerie.statistics.curves import proven_changes
from valerie.statistics.gates import compare_versions
from valerie.statistics.importance import NAMED, measured_importance
from valerie.statistics.observations import bin_codes, observe
from valerie.statistics.verdicts import Outcome, judge_sample, units_to_decide

Floats = NDArray[np.float64]
Row = JsonObject
Generator = np.random.Generator


def _hazy(u: Floats) -> Floats:
    """Return scores in the middle of the range, skewed to one side."""
    return np.asarray(0.2 + 0.6 * u[..., 0] * np.sqrt(u[..., 1]) + 0.1 * u[..., 3] * u[..., 4] + 0.1 * u[..., 5])


def _split(u: Floats) -> Floats:
    """Return scores of which most are 0 or 1, by place and by row."""
    z = ndtri(0.002 + 0.996 * u)
    return np.asarray(np.clip(0.55 + 1.2 * z[..., 0] + 0.5 * z[..., 3] * z[..., 4] + 0.6 * z[..., 5], 0, 1))


def _seldom(u: Floats) -> Floats:
    """Return scores near 1 with 7 % failures in a band of the places."""
    band = np.abs(u[..., 1] - u[..., 2]) < 0.05 + 0.04 * (u[..., 5] - 0.5)
    return np.asarray(np.where(band & (u[..., 0] < 0.7), 0.4 * u[..., 4], 1 - 0.06 * u[..., 3] * u[..., 5]))


WORLDS: Final[dict[str, World]] = {"hazy": _hazy, "split": _split, "seldom": _seldom}
PLACES: Final = (6, 12, 48, 200)
#: Upper limit of a rate that is 5 %, exceeded by chance in one row of a thousand.
_SURE: Final = 3.1


def _holds(rate: float, repetitions: int) -> str:
    return "yes" if rate <= 0.05 + _SURE * np.sqrt(0.05 * 0.95 / max(repetitions, 1)) else "NO"


# Contrasts ----------------------------------------------------------------------------------------------------------------


def coverage_of_contrasts(repetitions: int) -> Iterator[Row]:
    for name, world in WORLDS.items():
        for places in PLACES:
            for within in (True, False):
                yield _contrast(name, world, places, within, repetitions)


def _with_sun(world: World, u: Floats, after: NDArray[np.bool_]) -> Floats:
    """Return scores that the sun changes: it moves one number of the place, and fails a tenth of what was seen."""
    moved = u.copy()
    moved[..., 0] = np.where(after, u[..., 0] ** 1.5, u[..., 0])
    scores = world(moved)
    return np.where(after & (u[..., 2] > 0.9), 0.5 * scores, scores)


@cache
def _effect_of_sun(world: World) -> float:
    u = qmc.Sobol(6, rng=np.random.default_rng(0)).random_base2(19)
    everywhere = np.ones(len(u), np.bool_)
    return float((_with_sun(world, u, everywhere) - world(u)).mean())


def _contrast(name: str, world: World, places: int, within: bool, repetitions: int) -> Row:
    rng = np.random.default_rng(31)
    truth, missed, widths = _effect_of_sun(world), 0, []
    place = np.repeat(np.arange(places), 4)
    camera = np.tile([0, 1, 0, 1], places)
    for _ in range(repetitions):
        u = np.repeat(rng.random((places, 1, 6)), 4, axis=1).reshape(-1, 6)
        u[:, 3:] = rng.random((len(u), 3))
        sun = np.tile([0, 0, 1, 1], places) if within else (rng.permutation(places) % 2)[place]
        scores = _with_sun(world, u, sun == 1)
        (contrast, *_) = contrasts(observe(scores, place, {"sun": sun, "camera": camera}), interactions=False)
        low, high = contrast.interval()
        missed += not low <= truth <= high
        widths.append(min(high, 1.0) - max(low, -1.0))
    rate = missed / repetitions
    return {
        "world": name, "places": places, "sun varies": "within places" if within else "between places",
        "effect": truth, "missed": rate, "holds": _holds(rate, repetitions), "mean width": float(np.mean(widths)),
    }  # fmt: skip


# Effects of findings ------------------------------------------------------------------------------------------------------


def effects_of_findings(repetitions: int) -> Iterator[Row]:
    for size, shape in (("paper-small", PAPER_SMALL), ("6 x 8", GRID)):
        for name, world in WORLDS.items():
            for points in (0.1, 0.2):
                yield _effects(size, shape, name, world, points, repetitions)


def _effects(size: str, shape: tuple[int, ...], name: str, world: World, points: float, repetitions: int) -> Row:
    """Lower all scores of the last sun by the same number of points; nothing else has an effect."""
    rng = np.random.default_rng(32)
    shares, confirmed, sized, exaggerated = [], 0, 0, []
    for repetition in range(repetitions):
        rows = crossed(world, shape, rng)
        last = rows.factors["sun"].max()
        values = points + (1 - points) * rows.values - points * (rows.factors["sun"] == last)
        items = find(Rows(values, rows.places, rows.factors).observed(), seed=repetition).items
        misses, total, confirmed_here = 0, 0, False
        for item in items:
            if not item.confirmed or item.contrast is None:
                continue
            confirmed_here = True
            if np.isinf(item.low):
                continue
            (first, *further) = item.contrast.changes
            truth = -points if first.factor == "sun" and first.after == last and not further else 0.0
            misses += not item.low <= truth <= item.high
            total += 1
            if truth:
                exaggerated.append(item.contrast.estimate / truth)
        shares.append(misses / max(total, 1))
        confirmed += confirmed_here
        sized += total > 0
    rate = float(np.mean(shares))
    return {
        "grid": size, "world": name, "points of a sun": 100 * points, "runs with a confirmed finding": confirmed / repetitions,
        "runs with an interval": sized / repetitions, "share of intervals that miss": rate, "holds": _holds(rate, repetitions),
        "mean estimate / truth": float(np.mean(exaggerated)) if exaggerated else None,
    }  # fmt: skip


# Two runs -----------------------------------------------------------------------------------------------------------------


def two_runs(repetitions: int) -> Iterator[Row]:
    for name, world in WORLDS.items():
        for places in PLACES:
            yield _two_runs(name, world, places, repetitions)


def _two_runs(name: str, world: World, places: int, repetitions: int) -> Row:
    rng = np.random.default_rng(33)
    truth, missed, widths = _effect_of_sun(world), 0, []
    place = np.repeat(np.arange(places), 6)
    whole = {"all": np.ones(len(place), np.bool_)}
    for _ in range(repetitions):
        u = np.repeat(rng.random((places, 1, 6)), 6, axis=1).reshape(-1, 6)
        u[:, 4:] = rng.random((len(u), 2))
        other = u.copy()
        other[:, 5] = rng.random(len(u))
        (slice_,) = compare_versions(world(u), _with_sun(world, other, np.ones(len(u), np.bool_)), place, whole).slices
        assert slice_.low is not None, "there are enough places"
        assert slice_.high is not None, "there are enough places"
        missed += not slice_.low <= truth <= slice_.high
        widths.append(slice_.high - slice_.low)
    rate = missed / repetitions
    return {
        "world": name, "places": places, "difference": truth, "missed": rate, "holds": _holds(rate, repetitions),
        "mean width": float(np.mean(widths)),
    }  # fmt: skip


# Sites and Halton points --------------------------------------------------------------------------------------------------


def sites_and_designs(repetitions: int) -> Iterator[Row]:
    for name, world in WORLDS.items():
        for sites in (10, 12, 24):
            title = f"grid of 4 places x 2 suns on {sites} sites"
            yield _no_effect(title, name, partial(_on_sites, world, sites), repetitions)
        yield _no_effect("halton, 256", name, partial(_halton, world, 256), repetitions)


def _on_sites(world: World, sites: int, rng: Generator) -> Rows:
    """Return a listed grid on several sites, each of which is a place; its places and suns act alike on all sites."""
    site, place, sun, camera = (axis.ravel() for axis in np.indices((sites, 4, 2, 2)))
    u = rng.random((len(site), 6))
    u[:, :2] = rng.random((sites, 2))[site]
    u[:, 2] = rng.random((sites, 4))[site, place]
    u[:, 3] = rng.random((sites, 2))[site, sun]
    return Rows(world(u), site, {"place": place, "sun": sun, "camera": camera})


def _halton(world: World, units: int, rng: Generator) -> Rows:
    """Return scrambled Halton points: three dimensions without effect are factors, and the others decide the score."""
    u = qmc.Halton(9, rng=rng).random(units)
    factors = {f"factor-{k}": bin_codes(u[:, k], 3) for k in range(3)}
    return Rows(world(u[:, 3:]), np.arange(units), factors)


def _no_effect(design: str, world: str, make: Callable[[Generator], Rows], repetitions: int) -> Row:
    rng = np.random.default_rng(34)
    confirmed = 0
    for repetition in range(repetitions):
        confirmed += _confirms(make(rng), repetition)
    rate = confirmed / repetitions
    return {"design": design, "world": world, "false confirmed": rate, "holds": _holds(rate, repetitions)}


def _confirms(rows: Rows, seed: int) -> bool:
    return any(item.confirmed for item in find(rows.observed(), seed=seed).items)


# Neighbouring places that are alike ---------------------------------------------------------------------------------------

#: What is claimed of a grid without any effect; each with and without the test of likeness.
_CLAIMS: Final = ("finding", "trend over y", "difference of two suns", "lower with the other version")


def places_alike(repetitions: int) -> Iterator[Row]:
    for size, shape in (("10 x 12", PAPER_SMALL), ("6 x 8", GRID), ("3 x 4", FIRST_RUN), ("1 x 30", (1, 30, 4, 2, 3))):
        for name in WORLDS if shape == GRID else ("hazy",):
            for reach in (0.0, 2.0, 4.0, 15.0):
                yield _alike(size, shape, name, WORLDS[name], reach, repetitions)


def _alike(size: str, shape: tuple[int, ...], name: str, world: World, reach: float, repetitions: int) -> Row:
    """Plant a grid without effects; places, effects of suns and characters, and of another version are alike over ``reach``."""
    rng = np.random.default_rng(40)
    tested, blind = np.zeros(len(_CLAIMS)), np.zeros(len(_CLAIMS))
    for repetition in range(repetitions):
        rows = crossed(world, shape, rng, reach, effects=True)
        other = crossed(world, shape, rng, reach, effects=True)
        tested += _claimed(rows, other, repetition)
        blind += _claimed(replace(rows, positions=None), other, repetition)
    rates = (tested / repetitions).tolist()
    return {
        "places": size, "world": name, "alike over, m": reach,
        **dict(zip(_CLAIMS, rates, strict=True)), "holds": _holds(max(rates), repetitions),
        **{f"{claim}, untested": rate for claim, rate in zip(_CLAIMS, (blind / repetitions).tolist(), strict=True)},
    }  # fmt: skip


def _claimed(rows: Rows, other: Rows, seed: int) -> tuple[bool, ...]:
    """Return which of `_CLAIMS` the rows lead to; the other version's scores have the same distribution."""
    changes = proven_changes(rows.factors["y"], rows.values, rows.places, seed=seed, positions=rows.positions)
    trend = changes is not None and (changes.low > 0 or changes.high < 0 or changes.falls or changes.rises)
    (sun, *_) = contrasts(rows.observed(), interactions=False, only=[(Change("sun", 0, 1),)])
    whole = {"all": np.ones(len(rows.values), np.bool_)}
    (version,) = compare_versions(rows.values, other.values, rows.places, whole, positions=rows.positions).slices
    return _confirms(rows, seed), trend, sun.excludes_0(0.95), version.worse


# Measured columns at places that are alike --------------------------------------------------------------------------------


def causes_alike(repetitions: int) -> Iterator[Row]:
    for size, (x, y, *_) in (("10 x 12", PAPER_SMALL), ("6 x 8", GRID)):
        for reach in (0.0, 4.0, 15.0):
            yield _cause(size, (x, y, 2, 1, 2), reach, "", repetitions)
        for cause in ("distance", "occlusion", "light"):
            yield _cause(size, (x, y, 2, 1, 2), 0.0, cause, repetitions)


def _cause(size: str, shape: tuple[int, ...], reach: float, cause: str, repetitions: int) -> Row:
    """Plant places and effects of suns that are alike over ``reach``, and lower scores by 20 points along a column, if any."""
    rng = np.random.default_rng(41)
    counts: Counter[str] = Counter()
    for repetition in range(repetitions):
        rows = crossed(WORLDS["hazy"], shape, rng, reach, effects=True)
        assert rows.positions is not None, "the grid has a reach"
        own = rng.standard_normal((2, len(rows.values)))
        across, along = rows.positions.T
        columns = {
            "distance": np.hypot(across - 2 + 2 * rows.factors["camera"], 15 + along),
            # What stands in the way is alike among neighbours even where scores are not.
            "occlusion": correlated_field(shape, reach or 4.0, 1, rng)[rows.places, 0] + 0.1 * own[0],
            "light": 2.0 * rows.factors["sun"] + 0.5 * own[1],
        }
        lowered = 0.2 * rankdata(columns[cause]) / len(own[0]) if cause else 0.0
        results = measured_importance(
            rows.values - lowered, rows.places, columns, seed=repetition, positions=rows.positions
        )
        for title, names in (
            ("", {one.column for one in results if one.named}),
            (", untested", {one.column for one in results if one.p_value <= NAMED}),
        ):
            counts[f"named{title}"] += cause in names
            counts[f"others named (false){title}"] += bool(names - {cause})
    rates = {what: count / repetitions for what, count in counts.items()}
    return {
        "places": size, "alike over, m": reach, "cause": cause or "none", **rates,
        "holds": _holds(rates["others named (false)"], repetitions),
    }  # fmt: skip


# Trends -------------------------------------------------------------------------------------------------------------------


def trends(repetitions: int) -> Iterator[Row]:
    for scores in ("mild", "piled", "rare"):
        for places in (12, 27, 120):
            for within in (True, False):
                for name in ("flat", "slope", "hump"):
                    yield _trend(name, scores, places, within, repetitions)


def _trend(name: str, scores: str, places: int, within: bool, repetitions: int) -> Row:
    rng = np.random.default_rng(35)
    place = np.repeat(np.arange(places), 6)
    falls = rises = missed = answers = 0
    # Of rare failures, the curve moves between 0.7 and 1.
    curve = CURVES[name] if scores != "rare" else lambda x: 0.7 + 0.3 * CURVES[name](x)
    for repetition in range(repetitions):
        x = (rng.random((places, 6)) if within else np.repeat(rng.random((places, 1)), 6, axis=1)).ravel()
        rank = ndtr(0.6**0.5 * rng.standard_normal(places)[place] + 0.4**0.5 * rng.standard_normal(len(x)))
        mean = curve(x)
        values = betaincinv(4 * mean, 4 * (1 - mean), rank) if scores == "mild" else (rank < mean).astype(float)
        changes = proven_changes(x, values, place, seed=repetition)
        if changes is not None:
            answers += 1
            first, last = np.quantile(x, (1 / 3, 2 / 3))
            truth = float(mean[(x >= last) & (x > first)].mean() - mean[x <= first].mean())
            missed += not changes.low <= truth <= changes.high
            falls += changes.high < 0 and not changes.rises
            rises += changes.low > 0 and not changes.falls
    return {
        "curve": name, "scores": scores, "places": places, "x varies": "within places" if within else "between places",
        "falls": falls / repetitions, "rises": rises / repetitions, "intervals missed": missed / answers,
        "intervals hold": _holds(missed / answers, answers),
        **({"holds": _holds((falls + rises) / repetitions, repetitions)} if name == "flat" else {}),
    }  # fmt: skip


# One percentage point -----------------------------------------------------------------------------------------------------


def one_point(repetitions: int) -> Iterator[Row]:
    most = 10_000
    for bound in (0.9, 0.95):
        for truth in (bound - 0.01, bound + 0.01):
            rng = np.random.default_rng(36)
            outcomes: Counter[Outcome] = Counter()
            ends = []
            for _ in range(repetitions):
                scores = pass_or_fail(truth, most, 1, rng).ravel()
                verdict = judge_sample(scores, np.arange(most), at_least=bound)
                outcomes[verdict.outcome] += 1
                ends.append(verdict.decided_after or most)
            right, wrong = Outcome.MET, Outcome.NOT_MET
            right, wrong = (right, wrong) if truth > bound else (wrong, right)
            yield {
                "required share": bound, "true share": round(truth, 3), "right within 10,000": outcomes[right] / repetitions,
                "wrongly": outcomes[wrong] / repetitions, "mean units": float(np.mean(ends)),
                "units said before": units_to_decide(truth, at_least=bound),
            }  # fmt: skip
    for name, world in WORLDS.items():
        for places in (48, 250, 1000):
            yield _gate_at_one_point(name, world, places, max(repetitions // 10, 10))


def _gate_at_one_point(name: str, world: World, places: int, repetitions: int) -> Row:
    """Let one slice of ten lose a point, in all rows; versions differ in one number of a row besides."""
    rng = np.random.default_rng(37)
    code = np.repeat(np.arange(10 * places), 4)
    slices = {str(k): code // places == k for k in range(10)}
    confirmed = false = 0
    for _ in range(repetitions):
        u = np.repeat(rng.random((10 * places, 1, 6)), 4, axis=1).reshape(-1, 6)
        u[:, 4:] = rng.random((len(u), 2))
        other = u.copy()
        other[:, 5] = rng.random(len(u))
        after = world(other) - 0.01 * (code < places)
        worse = compare_versions(world(u), after, code, slices).worse
        confirmed += "0" in worse
        false += bool(set(worse) - {"0"})
    return {
        "world": name, "places a slice": places, "slice that lost a point named": confirmed / repetitions,
        "another named": false / repetitions, "repetitions": repetitions,
    }  # fmt: skip


# The rows of paper-small --------------------------------------------------------------------------------------------------

_KEPT: Final = Path(__file__).parents[1] / "docs" / "experiment" / "paper-part.parquet"


def paper_small(repetitions: int) -> Iterator[Row]:
    """Plant scores in the kept rows of the paper's grid at one heading: places where a person may stand, four suns."""
    kept = EvaluationTable.from_parquet(_KEPT)
    heading = kept.numbers("scene.person-1.heading")
    metal = np.isfinite(kept.numbers("scene.person-1.cloth.metallic"))
    design = kept.select((heading == 225) & ~metal & np.isfinite(kept.numbers("pacc")))
    place = np.unique(design.places, return_inverse=True)[1]
    sun = design.codes("scene.sun-1.azimuth").index
    for name, world in WORLDS.items():
        for points in (0.0, 0.1, 0.2):
            rng = np.random.default_rng(38)
            own = other = 0
            for repetition in range(repetitions):
                scores = _planted_scores(design, world, place, sun, rng)
                first = design.codes("function").index == 0
                lowered = first & (sun == sun.max())
                scores = np.where(lowered, scores * (1 - points / scores[lowered].mean()), scores)
                items = find_findings(_with_scores(design, scores), seed=repetition).items
                of_sun = [
                    item.function == design.codes("function").names[0] and item.steps[0].factor == "sun-1.azimuth"
                    for item in items
                ]
                own += any(of_sun)
                other += any(item.function == design.codes("function").names[1] or not points for item in items)
            yield {
                "world": name, "points of a sun": 100 * points, "rows": len(design), "places": int(place.max()) + 1,
                "confirmed": own / repetitions, "others confirmed (false)": other / repetitions,
                "repetitions": repetitions,
            }  # fmt: skip


def _planted_scores(
    design: EvaluationTable, world: World, place: NDArray[np.int64], sun: NDArray[np.int64], rng: Generator
) -> Floats:
    u = rng.random((len(design), 6))
    functions = design.codes("function")
    for k in range(len(functions.names)):
        rows = functions.index == k
        u[rows, :3] = rng.random((place.max() + 1, 3))[place[rows]]
        u[rows, 3] = rng.random((place.max() + 1, sun.max() + 1))[place[rows], sun[rows]]
    return np.asarray(world(u))


def _with_scores(design: EvaluationTable, scores: Floats) -> EvaluationTable:
    """Return the table with other scores; all persons are equally large."""
    tp = np.rint(np.clip(scores, 0, 1) * 10_000).astype(np.int64)
    columns = {"tp": tp, "fn": 10_000 - tp, "pacc": tp / 10_000}
    arrow = design.arrow
    for name, column in columns.items():
        position = arrow.column_names.index(name)
        arrow = arrow.set_column(position, name, pa.array(column).cast(arrow.schema.field(name).type))
    return EvaluationTable(arrow, design.parameters, {run: replace(one) for run, one in design.designs.items()})


# First place --------------------------------------------------------------------------------------------------------------


def first_place(repetitions: int) -> Iterator[Row]:
    for noise in (NOISE, 3 * NOISE):
        for name in ("slope", "hump"):
            rng = np.random.default_rng(39)
            first = named = 0
            for repetition in range(repetitions):
                contrast = rng.standard_normal(100)
                decoys = DECOYS * contrast[:, None] + np.sqrt(1 - DECOYS**2) * rng.standard_normal((100, len(DECOYS)))
                u = ndtr(contrast)
                curve = 0.2 + 0.6 * (u if name == "slope" else np.exp(-(((u - 0.5) / 0.2) ** 2)))
                scores = np.clip(curve + noise * rng.standard_normal(100), 0, 1)
                columns = {"contrast": contrast, **{f"decoy-{k}": decoys[:, k] for k in range(len(DECOYS))}}
                ranked = measured_importance(scores, np.arange(100), columns, seed=repetition)
                first += ranked[0].column == "contrast"
                named += any(one.named and one.column == "contrast" for one in ranked)
            yield {
                "contrast": name, "noise": noise, "rows": 100, "first": first / repetitions, "named": named / repetitions,
                "repetitions": repetitions,
            }  # fmt: skip


#: Part to its rows and the share of the repetitions that it can afford.
PARTS: Final[dict[str, tuple[Callable[[int], Iterator[Row]], float]]] = {
    "contrasts": (coverage_of_contrasts, 1),
    "effects of findings": (effects_of_findings, 0.2),
    "two runs": (two_runs, 1),
    "sites and designs": (sites_and_designs, 0.4),
    "places alike": (places_alike, 0.4),
    "causes alike": (causes_alike, 0.1),
    "trends": (trends, 0.4),
    "one point": (one_point, 0.1),
    "paper-small": (paper_small, 0.4),
    "first place": (first_place, 0.2),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=1000)
    parser.add_argument("--only", choices=PARTS, help="one part; nothing is written")
    arguments = parser.parse_args()
    figures: dict[str, Any] = {}
    for part, (rows, affordable) in PARTS.items():
        if arguments.only not in {None, part}:
            continue
        repetitions = max(round(arguments.repetitions * affordable), 1)
        print(f"\n{part}, {repetitions} repetitions")
        figures[part] = {"repetitions": repetitions, "rows": results.print_rows(rows(repetitions))}
    if arguments.only is None:
        results.write("effects", figures)


if __name__ == "__main__":
    main()
