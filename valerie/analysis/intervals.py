"""Confidence intervals: Wilson's for shares, and one bootstrap of whole situations for everything else.

Rows are not independent, since several cameras and functions see one situation with several pedestrians. The bootstrap
therefore draws situations with replacement (cluster bootstrap: Davison & Hinkley 1997, *Bootstrap Methods and their
Application*, section 3.8). Every statistic of a run uses the same draws, so differences are paired by construction and
many comparisons can be judged together (`simultaneous`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, stdtrit

#: Smallest number of situations for a bootstrap interval; with fewer it would be far too narrow.
MIN_SITUATIONS: Final = 6
#: Largest number of drawn units. More situations are drawn in random groups of equal size, which keeps the variance
#: right and the memory bounded.
MAX_GROUPS: Final = 1000


@dataclass(frozen=True, slots=True)
class Interval:
    """A confidence interval; the caller states the level."""

    low: float
    high: float


def wilson(successes: int, total: int, *, level: float = 0.95) -> Interval | None:
    """Return Wilson's score interval for a share (Wilson 1927, doi:10.1080/01621459.1927.10502953); None if total is 0."""
    if total == 0:
        return None
    z = float(ndtri(0.5 + level / 2))
    share = successes / total
    centre = (share + z * z / (2 * total)) / (1 + z * z / total)
    half = z / (1 + z * z / total) * float(np.sqrt(share * (1 - share) / total + z * z / (4 * total * total)))
    return Interval(max(centre - half, 0.0), min(centre + half, 1.0))


class Resampler:
    """The bootstrap draws of one run.

    Attributes:
        group: (N,) int64, the drawn unit of each row.
        groups: number G of units.
        weights: (B, G) float64, number of times that a draw holds a unit; rows sum to G.
        seed: of the draws.
    """

    def __init__(self, situations: NDArray[np.int64], *, seed: int, resamples: int = 2000) -> None:
        """Args:
        situations: (N,) situation number 0…S−1 of every row.
        seed: of the draws; 0 is a seed.
        resamples: number B of draws.
        """
        self.seed = seed
        generator = np.random.default_rng(seed)
        count = int(situations.max()) + 1 if len(situations) else 0
        self.groups = min(count, MAX_GROUPS)
        member = generator.permutation(count) % max(self.groups, 1)
        self.group: NDArray[np.int64] = member[situations] if count else np.zeros(0, np.int64)
        drawn = (
            generator.multinomial(self.groups, np.full(self.groups, 1 / self.groups), resamples)
            if count
            else np.zeros((resamples, 0))
        )
        self.weights: NDArray[np.float64] = drawn.astype(np.float64)

    def totals(self, values: NDArray[np.float64], rows: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the sum of ``values`` over ``rows`` ((N,) bool) per unit: (G,) float64."""
        sums = np.bincount(self.group[rows], weights=values[rows], minlength=self.groups)
        return sums.astype(np.float64)

    def ratio(
        self, top: NDArray[np.float64], bottom: NDArray[np.float64], rows: NDArray[np.bool_]
    ) -> tuple[float, NDArray[np.float64]]:
        """Return Σ top / Σ bottom over ``rows`` and its (B,) replicates; NaN where the bottom is 0."""
        a, b = self.totals(top, rows), self.totals(bottom, rows)
        with np.errstate(invalid="ignore", divide="ignore"):
            return float(np.divide(a.sum(), b.sum())), (self.weights @ a) / (self.weights @ b)

    def mean(self, values: NDArray[np.float64], rows: NDArray[np.bool_]) -> tuple[float, NDArray[np.float64]]:
        """Return the mean of ``values`` over ``rows`` and its (B,) replicates."""
        return self.ratio(values, np.ones_like(values), rows)

    def occupied(self, rows: NDArray[np.bool_]) -> int:
        """Return the number of units with at least one of ``rows``."""
        return int(np.count_nonzero(np.bincount(self.group[rows], minlength=self.groups)))

    def interval(self, replicates: NDArray[np.float64], rows: NDArray[np.bool_]) -> Interval | None:
        """Return the 95 % interval of replicates over ``rows``; None with fewer than `MIN_SITUATIONS` units.

        None too where more than a tenth of the replicates are undefined.
        """
        sound = replicates[np.isfinite(replicates)]
        units = self.occupied(rows)
        if units < MIN_SITUATIONS or len(sound) < 0.9 * len(replicates):
            return None
        low, high = np.quantile(sound, quantiles(units))
        return Interval(float(low), float(high))


def quantiles(units: int, *, level: float = 0.95) -> tuple[float, float]:
    """Return the two quantiles of replicates that bound an interval of ``level``.

    The plain percentile interval is too narrow with few units. The expanded percentile interval widens it as Student's t
    does (Hesterberg 2015, doi:10.1080/00031305.2015.1089789).
    """
    tail = float(ndtr(np.sqrt(units / (units - 1)) * stdtrit(units - 1, 0.5 - level / 2)))
    return tail, 1 - tail


def simultaneous(
    estimates: NDArray[np.float64],
    replicates: NDArray[np.float64],
    units: NDArray[np.int64],
    *,
    level: float = 0.95,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return intervals that hold *together*: with probability ``level`` none of the M true values lies outside its own.

    The largest |estimate* − estimate| / standard error over all comparisons is bootstrapped. Its quantile widens every
    interval (single-step max-T: Westfall & Young 1993, *Resampling-Based Multiple Testing*), as does Student's t for the
    number of units. More comparisons therefore make no false finding more likely.

    Args:
        estimates: (M,).
        replicates: (B, M) of the same draws; an undefined replicate counts as no deviation.
        units: (M,) number of drawn units in each comparison, ≥ 2.
        level: joint confidence.

    Returns:
        (M,) half widths and (M,) standard errors.
    """
    if not len(estimates):
        return np.zeros(0), np.zeros(0)
    deviation = np.nan_to_num(replicates - estimates)
    error = np.maximum(np.sqrt((deviation**2).mean(axis=0)), 1e-9)
    normal = float(np.quantile(np.abs(deviation / error).max(axis=1), level))
    # The quantile of few draws is noisy, so it is never taken below that of a single comparison.
    tail = min(1 - float(ndtr(normal)), 0.5 - level / 2)
    error = error * np.sqrt(units / (units - 1))
    return -stdtrit(units - 1, tail) * error, error
