"""Regression gate: is a version worse than its baseline? Paired on identical frames, by whole places, slice by slice.

Three tests compare the places of each slice, because a version can become worse in different ways: Student's t detects a
mean shift made of large differences, the signed-rank test (Wilcoxon 1945, doi:10.2307/3001968) a small shift of most
places, and McNemar's test (1947, doi:10.1007/BF02295996) rows that passed and now fail. Their p-values are combined by the
Cauchy rule, which is valid although they are dependent (Liu & Xie 2020, doi:10.1080/01621459.2018.1554485), and the slices
are judged together by Benjamini & Hochberg (1995, doi:10.1111/j.2517-6161.1995.tb02031.x). The null hypothesis is that
exchanging baseline and version changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, ndtr, stdtr

from valerie.errors import InvalidInput
from valerie.statistics.intervals import MIN_UNITS
from valerie.statistics.neighbours import alike
from valerie.statistics.observations import coordinates, dense
from valerie.statistics.power import places_needed
from valerie.statistics.unseen import Figures, reach

#: Up to this many places the signed-rank test enumerates all signs; above, it uses the normal approximation.
_EXACT: Final = 25
#: Cap of the p-values: one near 1 must not outweigh small ones in the Cauchy rule.
_LARGEST: Final = 0.9
#: Drop that a slice needs enough places to show, by default: five points of pACC.
EFFECT: Final = 0.05
#: Most rows to name in each slice.
_FLIPS: Final = 5
#: Tests that share the level of a slice.
_TESTS: Final = 3
#: Differences below this are rounding.
_NO_DIFFERENCE: Final = 1e-12


@dataclass(frozen=True, slots=True)
class SliceComparison:
    """Version − baseline in one slice.

    Attributes:
        name: of the slice.
        difference: mean over places of the mean difference of their rows.
        low, high: its 95 % interval by place, with an unseen place (`valerie.statistics.unseen`), not adjusted for other
            slices; None from fewer than `MIN_UNITS` places, or alike ones.
        places: number of places with rows in the slice.
        pairs: number of rows.
        lost, gained: rows that passed and now fail; rows that failed and now pass.
        t_p, rank_p, flip_p: one-sided p-values of the three tests; NaN where a test has no data.
        p_value: their combination; 1 if none has data, or places are alike.
        adjusted_p: with all slices accounted for.
        worse: True if the slice is worse, at the gate's rate of false discoveries.
        flips: rows with the largest drops, largest first.
        places_needed: places needed to detect the effect; None if no affordable number suffices, the deviation is unknown,
            or places are alike.
        alike: True if neighbouring places have similar differences, so that they are no independent evidence.
    """

    name: str
    difference: float
    low: float | None
    high: float | None
    places: int
    pairs: int
    lost: int
    gained: int
    t_p: float
    rank_p: float
    flip_p: float
    p_value: float
    adjusted_p: float
    worse: bool
    flips: tuple[int, ...]
    places_needed: int | None
    alike: bool = False

    @property
    def too_few(self) -> bool:
        """True if the places of the slice do not suffice to detect the effect, or nobody knows."""
        return self.places_needed is None or self.places_needed > self.places


@dataclass(frozen=True, slots=True)
class Gate:
    """A version against its baseline.

    Attributes:
        slices: in the order given.
        false_discoveries: largest expected share of false ones among the slices named worse.
        threshold: score that a row needs to pass.
        effect: smallest drop to detect.
        unpaired: rows for which only one of the two has a value.
    """

    slices: tuple[SliceComparison, ...]
    false_discoveries: float
    threshold: float
    effect: float
    unpaired: int

    @property
    def worse(self) -> tuple[str, ...]:
        """Names of the slices that are worse."""
        return tuple(item.name for item in self.slices if item.worse)


def compare_versions(
    baseline: ArrayLike,
    version: ArrayLike,
    places: ArrayLike,
    slices: Mapping[str, ArrayLike],
    *,
    threshold: float = 0.5,
    effect: float = EFFECT,
    false_discoveries: float = 0.05,
    positions: NDArray[np.float64] | None = None,
) -> Gate:
    """Compare a version with its baseline on the same rows.

    Args:
        baseline, version: (N,) scores of the same persons in the same frames; NaN where one has none.
        places: (N,) whole numbers, the independent unit of each row.
        slices: name to (N,) bool; slices may overlap.
        threshold: score that a row needs to pass.
        effect: smallest drop to detect; it decides how many places are needed.
        false_discoveries: largest expected share of false ones among the slices named worse.
        positions: (N, D) coordinates, equal within a place, where the places are listed on one site; None where they are drawn.

    Raises:
        InvalidInput: the lengths differ, or ``effect`` or ``false_discoveries`` is not between 0 and 1.
    """
    from scipy.stats import false_discovery_control

    before, after, codes = np.asarray(baseline, np.float64), np.asarray(version, np.float64), np.asarray(places)
    masks = {name: np.asarray(mask, np.bool_) for name, mask in slices.items()}
    for field, column in {"version": after, "places": codes, **masks}.items():
        if column.shape != before.shape:
            raise InvalidInput(
                "needs one entry per row of the baseline", field=field, value=column.shape, limit=before.shape
            )
    for field, number in (("effect", effect), ("false_discoveries", false_discoveries)):
        if not 0 < number < 1:
            raise InvalidInput("has to lie between 0 and 1", field=field, value=number)
    paired = np.isfinite(before) & np.isfinite(after)
    change = np.where(paired, after - before, 0.0)
    flip = np.where(paired, (after >= threshold).astype(np.int64) - (before >= threshold), 0)
    compared = []
    for name, mask in masks.items():
        rows = np.flatnonzero(paired & mask)
        place, occurring = dense(codes[rows])
        differences = np.bincount(place, weights=change[rows]) / np.bincount(place)
        p_values = (
            t_test(differences),
            signed_rank_test(differences),
            flip_test(np.bincount(place, weights=flip[rows]).astype(np.float64)),
        )
        together = positions is not None and bool(
            alike(differences[:, None], coordinates(positions[rows], place, len(occurring)), within=True)[0]
        )
        low, high = (
            _interval(differences, np.concatenate([before[rows], after[rows]])) if not together else (None, None)
        )
        furthest = rows[np.argsort(change[rows], kind="stable")[:_FLIPS]]
        compared.append(
            SliceComparison(
                name=name,
                difference=float(differences.mean()) if len(rows) else float("nan"),
                low=low,
                high=high,
                places=len(occurring),
                pairs=len(rows),
                lost=int(np.count_nonzero(flip[rows] < 0)),
                gained=int(np.count_nonzero(flip[rows] > 0)),
                t_p=p_values[0],
                rank_p=p_values[1],
                flip_p=p_values[2],
                p_value=1.0 if together else combine(p_values),
                adjusted_p=1.0,
                worse=False,
                flips=tuple(furthest[change[furthest] < 0].tolist()),
                places_needed=places_for_gate(
                    effect, float(differences.std(ddof=1)), len(masks), false_discoveries=false_discoveries
                )
                if len(differences) > 1 and not together
                else None,
                alike=together,
            )
        )
    adjusted = false_discovery_control([item.p_value for item in compared]).tolist() if compared else []
    judged = tuple(
        replace(item, adjusted_p=p_value, worse=p_value <= false_discoveries)
        for item, p_value in zip(compared, adjusted, strict=True)
    )
    unpaired = int(np.count_nonzero(np.isfinite(before) ^ np.isfinite(after)))
    return Gate(judged, false_discoveries, threshold, effect, unpaired)


def places_for_gate(
    effect: float, deviation: float, slices: int, *, false_discoveries: float = 0.05, power_wanted: float = 0.9
) -> int | None:
    """Return the number of places that each slice needs, to plan a run.

    It assumes that only the t-test detects the drop and that only this slice is worse; usually fewer places suffice. Places
    that change equally have no spread, and p = 2⁻ᴳ by the signs of G places: no fewer are enough than reach the level so.

    Args:
        effect: smallest drop to detect.
        deviation: standard deviation of a place's mean difference, from an earlier comparison.
        slices: number of slices of the gate.
        false_discoveries: rate of the gate.
        power_wanted: chance to name the slice.

    Raises:
        InvalidInput: the effect is 0, or a probability lies outside 0…1.
    """
    alpha = false_discoveries / slices
    needed = places_needed(effect, deviation, alpha=alpha / _TESTS, power_wanted=power_wanted)
    return None if needed is None else max(needed, int(np.ceil(-np.log2(alpha))))


def t_test(differences: NDArray[np.float64]) -> float:
    """Return Student's one-sided p-value that the mean of (G,) differences is not below 0; NaN without spread or pairs."""
    if len(differences) < 2 or differences.std() < _NO_DIFFERENCE:
        return float("nan")
    t = differences.mean() / (differences.std(ddof=1) / np.sqrt(len(differences)))
    return float(stdtr(len(differences) - 1, t))


def signed_rank_test(differences: NDArray[np.float64]) -> float:
    """Return the signed-rank test's one-sided p-value that (G,) differences do not lie below 0; NaN if all are 0.

    Differences of 0 are left out; ties share their mean rank. Exact for up to 25 places.
    """
    from scipy.stats import rankdata

    nonzero = differences[np.abs(differences) > _NO_DIFFERENCE]
    if not len(nonzero):
        return float("nan")
    # Rounding errors must not separate equal differences.
    ranks = rankdata(np.round(np.abs(nonzero), 12))
    positive = float(ranks[nonzero > 0].sum())
    if len(nonzero) > _EXACT:
        deviation = np.sqrt((ranks**2).sum() / 4)
        return float(ndtr((positive - ranks.sum() / 2 + 0.25) / deviation))
    # Number of sign choices for each sum of twice the positive ranks.
    doubled = np.round(2 * ranks).astype(np.int64)
    ways = np.zeros(int(doubled.sum()) + 1)
    ways[0] = 1.0
    for rank in doubled.tolist():
        ways[rank:] += ways[:-rank].copy()
    return float(ways[: round(2 * positive) + 1].sum() / 2.0 ** len(nonzero))


def flip_test(net: NDArray[np.float64]) -> float:
    """Return McNemar's exact one-sided p-value of (G,) net flips of the places, gained − lost; NaN if none flips.

    A place counts once, as better or worse, regardless of its number of rows.
    """
    lost, gained = int(np.count_nonzero(net < 0)), int(np.count_nonzero(net > 0))
    return float(bdtr(gained, lost + gained, 0.5)) if lost + gained else float("nan")


def combine(p_values: ArrayLike) -> float:
    """Return the Cauchy combination of p-values without NaN; 1 if none is left."""
    p = np.asarray(p_values, np.float64)
    p = np.minimum(p[np.isfinite(p)], _LARGEST)
    if not len(p):
        return 1.0
    # tan((½ − p) π) = 1 / tan(p π), without loss for small p.
    mean = float(np.mean(1 / np.tan(np.pi * np.maximum(p, 1e-300))))
    return float(np.arctan2(1.0, mean) / np.pi)


def _interval(differences: NDArray[np.float64], scores: NDArray[np.float64]) -> tuple[float, float] | tuple[None, None]:
    """Return the 95 % interval of the mean of (G,) differences of places; None from too few."""
    if len(differences) < MIN_UNITS:
        return None, None
    return Figures.around(differences, reach(scores)).interval(0.025)
