"""Intervals of means: one entry point for means, shares and ratios of sums of scores in [0, 1].

A share is the mean of rows that are 0 or 1; a pooled ratio Σ tp / Σ (tp + fn) is the mean of pACC weighted by pixels. All
of them are Σ s / Σ n over units and are computed from these sums of whole units. There are two methods, since none is both
narrow on mild data and valid where failures are rare:

*Student's t*, with the jackknife's variance, where scores spread over the middle of the range.

*Beta with an unseen unit* (`valerie.statistics.unseen`) elsewhere: at least half of the rows lie within a tenth of 0 or 1, the
units hardly differ or are strongly skewed, or rows have weights, which may correlate with the scores. Then the drawn units
say little about the rest. The two sides share the error as 1 + s : 1 − s with s = (2 mean − 1) / 5, because an interval
near 1 rarely misses above. Intervals of rare failures are thus 4 % narrower, and of the 95 % that Clopper and Pearson
guarantee, 94.2 % remain for every share (enumerated for 6 to 60, 70, 80, 100, 150, 200, 400 and 1000 units).

Where a design draws its units together, the variance comes from its replicates (`valerie.statistics.replicates`).
``make bench-coverage`` measures the coverage; docs/statistics.md has the figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import ceil, sqrt
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.statistics.replicates import MIN_POINTS, MIN_REPLICATES
from valerie.statistics.units import Estimand, Units
from valerie.statistics.unseen import LEAST, beta_quantile

#: Fewer units than this give no interval.
MIN_UNITS: Final = 6
#: Nor do fewer than this whose rows have weights.
MIN_WEIGHTED: Final = 10
#: Nor do unequal units that are worth fewer than this many of equal size.
MIN_WORTH: Final = 4.0
#: A score this near to 0 or 1 lies at an end of the range.
_END: Final = 0.1
#: Scores are piled up if at least this part of the rows is at an end.
_PILED: Final = 0.5
#: Units with a standard deviation below this hardly differ.
_NARROW: Final = 0.1
#: Units with weighted rows and at least this standard deviation are piled at both ends.
_WIDE: Final = 0.25
#: Units with a skewness beyond this are too skewed for Student's t.
_SKEWED: Final = 2.0
#: Part of the error of one side that goes to the other where the mean is 0 or 1.
_SHIFT: Final = 0.2


@dataclass(frozen=True, slots=True)
class Interval:
    """An interval that contains the true mean with confidence ``level``.

    Attributes:
        low, high: its ends, within [0, 1].
        estimate: mean of the data.
        level: confidence.
        units: number of units that were drawn.
        method: the method in words.
        estimand: what the mean is over.
    """

    low: float
    high: float
    estimate: float
    level: float
    units: int
    method: str
    estimand: Estimand


class Shortfall(StrEnum):
    """Reason why a mean has no interval."""

    #: Nothing was drawn at random.
    LISTED = "listed"
    #: There are too few units.
    FEW = "few"
    #: The units differ so much in size that they are worth too few of equal size.
    UNEQUAL = "unequal"


@dataclass(frozen=True, slots=True)
class Refusal:
    """Refusal of an interval.

    Attributes:
        reason: of the refusal.
        more_units: number of further units that would give an interval.
        estimate: mean of the data; None without rows.
        units: number of units.
        worth: number of units of equal size that they are worth (Kish 1965).
        estimand: what the mean is over.
    """

    reason: Shortfall
    more_units: int
    estimate: float | None
    units: int
    worth: float
    estimand: Estimand


def mean_interval(
    values: ArrayLike, units: Units, *, weights: ArrayLike | None = None, level: float = 0.95
) -> Interval | Refusal:
    """Return the interval of a mean, or the reason why there is none.

    Args:
        values: (N,) scores in [0, 1]; bool for a share. The caller leaves rows without a value out, also from ``units``
            (`Units.of`).
        units: the sampling units of the rows.
        weights: (N,) ≥ 0, the denominators of a ratio of sums; default 1.
        level: confidence, 0 < level < 1.

    Raises:
        InvalidInput: lengths differ, a value lies outside [0, 1], a weight is negative, or the level is out of bounds.
    """
    scores, sizes = _checked(values, units, weights, level)
    per_unit = _Sums.of(scores, sizes, units.index, units.count)
    weighted = bool(len(sizes)) and np.ptp(sizes) > 0
    refusal = _refusal(per_unit, units.estimand, MIN_WEIGHTED if weighted else MIN_UNITS)
    if refusal is not None:
        return refusal
    tail, count = 0.5 - level / 2, len(per_unit.sums)
    guarded = weighted or is_piled(scores) or per_unit.deviation < _NARROW or abs(per_unit.skewness) > _SKEWED
    # The unseen one of unequal units may be a large one.
    of_equal = (
        count if not weighted else per_unit.worth if per_unit.deviation >= _WIDE else sqrt(count * per_unit.worth)
    )
    unseen = per_unit.total / of_equal
    by_replicate = _replicates(scores, sizes, units)
    replicates = 0 if by_replicate is None else len(by_replicate.sums)
    if guarded:
        low, high = _beta(per_unit, tail, unseen)
        method = "beta with an unseen unit"
        if by_replicate is not None:
            method += f", variance of {replicates} replicates"
            spread = _beta(per_unit, tail, unseen, _between(by_replicate, per_unit, tail))
            # Evenly spread points vary no more than independent ones, so a wider interval by replicates is an error of theirs.
            low, high = max(low, spread[0]), min(high, spread[1])
    elif by_replicate is not None:
        low, high = _student(by_replicate, tail)
        method = f"Student's t of {replicates} replicates"
    else:
        low, high = _student(per_unit, tail)
        method = "Student's t of units"
    if units.replicate is not None and by_replicate is None and not _single(units):
        method += ", as if drawn independently"
    # Rounding must not push the estimate out where all values are equal.
    estimate = min(max(per_unit.mean, 0.0), 1.0)
    low, high = min(max(low, 0.0), estimate), max(min(high, 1.0), estimate)
    return Interval(low, high, estimate, level, count, method, units.estimand)


def highest_share(hits: ArrayLike, count: ArrayLike, confidence: float) -> NDArray[np.float64]:
    """Return the upper bound of a share of which ``hits`` of ``count`` were drawn; 1 without others.

    Clopper and Pearson (1934, doi:10.1093/biomet/26.4.404).
    """
    from scipy.special import betaincinv

    number = np.asarray(hits)
    others = np.asarray(count) - number
    return np.where(others > 0, betaincinv(number + 1, np.maximum(others, 1), confidence), 1.0)


def is_piled(scores: NDArray[np.float64]) -> bool:
    """Return True if at least half of (N,) scores lie near 0 or 1; those drawn then say little about rare others."""
    return bool(np.count_nonzero((scores <= _END) | (scores >= 1 - _END)) >= _PILED * len(scores))


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Sums of whole units with rows: (G,) weighted scores, (G,) weights > 0."""

    sums: NDArray[np.float64]
    sizes: NDArray[np.float64]

    @classmethod
    def of(
        cls, scores: NDArray[np.float64], weights: NDArray[np.float64], index: NDArray[np.int64], count: int
    ) -> _Sums:
        sizes = np.bincount(index, weights, count).astype(np.float64)
        sums = np.bincount(index, scores * weights, count).astype(np.float64)
        return cls(sums[sizes > 0], sizes[sizes > 0])

    @property
    def total(self) -> float:
        return float(self.sizes.sum())

    @property
    def mean(self) -> float:
        return float(self.sums.sum() / self.sizes.sum())

    @property
    def worth(self) -> float:
        """Number of units of equal size with the same information (Kish 1965, *Survey Sampling*, section 11.7)."""
        return float(self.sizes.sum() ** 2 / (self.sizes**2).sum())

    @property
    def variance(self) -> float:
        """Variance of the mean for independent units, by leaving out one at a time (jackknife)."""
        residuals = (self.sums - self.mean * self.sizes) / (self.total - self.sizes)
        return float((residuals**2).sum() * (len(residuals) - 1) / len(residuals))

    @property
    def deviation(self) -> float:
        """Standard deviation of the units' means, larger units weighing more."""
        return sqrt(self.variance * self.worth)

    @property
    def skewness(self) -> float:
        """Skewness of the units' sums around their share of the mean; 0 if they do not differ."""
        residuals = self.sums - self.mean * self.sizes
        second = float((residuals**2).mean())
        return float((residuals**3).mean()) / second**1.5 if second > LEAST**2 else 0.0

    @property
    def mirrored(self) -> _Sums:
        """The sums of 1 − score."""
        return _Sums(self.sizes - self.sums, self.sizes)


def _student(sums: _Sums, tail: float) -> tuple[float, float]:
    from scipy.special import stdtrit

    half = -float(stdtrit(sums.worth - 1, tail)) * sqrt(sums.variance)
    return sums.mean - half, sums.mean + half


def _beta(sums: _Sums, tail: float, unseen: float, variance: float | None = None) -> tuple[float, float]:
    """Return the bounds that an unseen unit of size ``unseen`` leaves.

    Args:
        sums: sums of the units.
        tail: error of each side.
        unseen: size of the unseen unit.
        variance: of the mean; None: that of independent units.
    """
    shift = _SHIFT * (2 * sums.mean - 1)
    low = _beta_low(sums, tail * (1 + shift), unseen, variance)
    return low, 1 - _beta_low(sums.mirrored, tail * (1 - shift), unseen, variance)


def _beta_low(sums: _Sums, tail: float, unseen: float, variance: float | None) -> float:
    total = sums.total + unseen
    mean = float(sums.sums.sum()) / total
    if mean < LEAST:
        return 0.0
    # The moments of a mean under weights of a Dirichlet distribution that has `count` parameters, all 1.
    count = total / unseen
    residuals = np.append(sums.sums - mean * sums.sizes, -mean * unseen) / total
    second = float((residuals**2).sum()) * count / (count + 1)
    third = 2 * float((residuals**3).sum()) * count**2 / ((count + 1) * (count + 2))
    if variance is not None:
        between = variance * sums.total**2 + (sums.mean - mean) ** 2 * float((sums.sizes**2).sum())
        known = (between + (mean * unseen) ** 2) / total**2 * count / (count + 1)
        second, third = known, third * (known / second) ** 1.5
    return beta_quantile(mean, second, third, tail)


def _replicates(scores: NDArray[np.float64], weights: NDArray[np.float64], units: Units) -> _Sums | None:
    """Return the sums of whole replicates; None if units count as independent."""
    if units.replicate is None or _single(units):
        return None
    occupied, replicate = np.unique(units.replicate, return_inverse=True)
    if len(occupied) < MIN_REPLICATES:
        return None
    return _Sums.of(scores, weights, replicate[units.index], len(occupied))


def _between(by_replicate: _Sums, per_unit: _Sums, tail: float) -> float:
    """Return the variance of the mean from replicates, enlarged so that the normal quantile fits.

    Few small replicates of scores piled at 0 and 1 may agree by chance. Therefore the variance of independent units, which
    is larger, counts as one more replicate of a design with `MIN_POINTS` points, and as less of one with more points.
    """
    from scipy.special import ndtri, stdtrit

    own = len(by_replicate.sums) - 1
    borrowed = MIN_POINTS / len(per_unit.sums)
    variance = (own * by_replicate.variance + borrowed * per_unit.variance) / (own + borrowed)
    return variance * float(stdtrit(own + borrowed, tail) / ndtri(tail)) ** 2


def _single(units: Units) -> bool:
    """Return True if every replicate is one unit, so that units are independent."""
    return units.replicate is not None and len(np.unique(units.replicate)) == units.count


def _refusal(sums: _Sums, estimand: Estimand, fewest: int) -> Refusal | None:
    count = len(sums.sums)
    worth = sums.worth if count else 0.0
    if estimand is Estimand.LISTED_GRID:
        reason, missing = Shortfall.LISTED, fewest - 1
    elif count < fewest:
        reason, missing = Shortfall.FEW, fewest - count
    elif worth < MIN_WORTH:
        reason, missing = Shortfall.UNEQUAL, ceil(count * MIN_WORTH / worth) - count
    else:
        return None
    return Refusal(reason, missing, sums.mean if count else None, count, worth, estimand)


def _checked(
    values: ArrayLike, units: Units, weights: ArrayLike | None, level: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    scores = np.asarray(values, np.float64)
    sizes = np.ones_like(scores) if weights is None else np.asarray(weights, np.float64)
    for name, column in (("values", scores), ("weights", sizes)):
        if column.shape != units.index.shape:
            raise InvalidInput(
                "one number for every row is needed", field=name, value=column.shape, limit=units.index.shape
            )
    # NaN fails both comparisons, so it counts as outside.
    outside = ~((scores >= 0) & (scores <= 1))
    if outside.any():
        raise InvalidInput("scores lie in 0 … 1", field="values", value=float(scores[outside][0]), limit="0 … 1")
    negative = ~((sizes >= 0) & np.isfinite(sizes))
    if negative.any():
        raise InvalidInput("weights are not negative", field="weights", value=float(sizes[negative][0]), limit=">= 0")
    if not 0 < level < 1:
        raise InvalidInput("confidence out of bounds", field="level", value=level, limit="0 < level < 1")
    return scores, sizes
