"""Bounds of a mean that allow for one unit that was not drawn.

The units drawn say little about rare ones: of twelve places, all may agree although a tenth of all places fails. To
bound the mean from below, one unit with the smallest possible figure is added to those drawn, all units get weights drawn
uniformly from the simplex (Bayesian bootstrap: Rubin 1981, doi:10.1214/aos/1176345338), and the bound is a quantile of the
weighted mean; from above likewise. This is the bound of Gaffke (2005, *Mathematical Methods of Statistics* 14, 451–467);
that it always holds is a conjecture (Learned-Miller and Thomas 2019, arXiv:1905.06208). The weighted mean is taken to
have a beta distribution with its own mean, variance and skewness. For units that are 0 or 1 this is exact: it gives
the bounds of Clopper and Pearson (1934, doi:10.1093/biomet/26.4.404).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Keeps divisors and parameters positive.
LEAST: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Figures:
    """Figures of independent units.

    Attributes:
        values: (G,) one for each unit.
        low, high: the smallest and the largest that another unit may have.
    """

    values: NDArray[np.float64]
    low: float
    high: float

    @classmethod
    def around(cls, values: NDArray[np.float64], furthest: float | None) -> Figures:
        """Return figures of which an unseen one is at most ``furthest`` from their mean; or in 0…1 where that is None.

        An unseen figure may always be like those seen.
        """
        low, high = 0.0, 1.0
        if furthest is not None and len(values):
            mean = float(values.mean())
            low, high = mean - furthest, mean + furthest
        return cls(values, float(values.min(initial=low)), float(values.max(initial=high)))

    @property
    def mean(self) -> float:
        return float(self.values.mean())

    @property
    def mirrored(self) -> Figures:
        """The figures with the opposite sign."""
        return Figures(-self.values, -self.high, -self.low)

    def interval(self, tail: float, times: float = 1.0) -> tuple[float, float]:
        """Return the ends of an interval of the mean, each of which misses with probability ``tail``.

        Args:
            tail: above 0.
            times: number of times that each unit counts, to plan for more units.
        """
        return self.low + _bound(self.values - self.low, tail, times), self.high - _bound(
            self.high - self.values, tail, times
        )


def _bound(above: NDArray[np.float64], tail: float, times: float) -> float:
    """Return the lower bound of a mean of figures ≥ 0, each of which counts ``times`` times, with an unseen one of 0."""
    units = times * len(above) + 1
    mean = times * float(above.sum()) / units
    if mean < LEAST:
        return 0.0
    second = (times * float(((above - mean) ** 2).sum()) + mean**2) / (units * (units + 1))
    third = 2 * (times * float(((above - mean) ** 3).sum()) - mean**3) / (units * (units + 1) * (units + 2))
    return beta_quantile(mean, second, third, tail)


def reach(scores: NDArray[np.float64]) -> float:
    """Return the largest distance of any score from the mean of these; 1 without scores.

    A difference of scores is taken to be no further from the mean difference.
    """
    mean = float(scores.mean()) if len(scores) else 1.0
    return max(mean, 1 - mean)


def beta_quantile(mean: float, second: float, third: float, tail: float) -> float:
    """Return a quantile of the beta distribution on 0 … top with this mean and these central moments; top follows.

    Args:
        mean, second: above 0.
        third: as far as a beta distribution allows.
        tail: probability below the quantile.
    """
    from scipy.special import betaincinv

    # Nothing is more skewed than with the top at infinity, a gamma distribution; nothing less than with all weight at 0
    # and top.
    skewness = third / second
    slack = 2 - skewness * mean / second
    top = (4 * mean + skewness - skewness * mean**2 / second) / slack if slack > LEAST else np.inf
    top = min(max(top, mean + (1 + LEAST) * second / mean), mean / LEAST)
    strength = mean * (top - mean) / second - 1
    return top * float(betaincinv(strength * mean / top, strength * (1 - mean / top), tail))
