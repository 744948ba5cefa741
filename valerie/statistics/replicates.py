"""Randomised replicates: designs that are evenly spread *and* give the error of their mean.

The points of a Sobol' or Latin hypercube design are drawn together, so their scatter does not give the error of their
mean: treated as independent, they give intervals several times too wide. Instead of one design of n points, draw R
independent designs of n / R; their means are independent, and Student's t applies to them (Owen 1997,
doi:10.1137/S0036142994277468; L'Ecuyer, Nakayama, Owen and Tuffin 2023, *Confidence intervals for randomized
quasi-Monte Carlo estimators*, Winter Simulation Conference). Few large replicates estimate the mean better, many small ones
its error: eight are the usual compromise.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput

#: Number of replicates of a design.
REPLICATES: Final = 8
#: Number of replicates of a design with fewer than 40 points; fewer replicates give no useful error.
MIN_REPLICATES: Final = 5
_FEW: Final = 5 * REPLICATES
#: With fewer points than this, replicates would have fewer than four points each, so every point is a replicate.
MIN_POINTS: Final = 4 * MIN_REPLICATES


def replicate_number(count: int) -> int:
    """Return the number of replicates of a design with ``count`` points.

    Point i belongs to replicate i modulo this number, so sizes differ by at most 1, even if the design ends early. Each
    replicate is a design of its own with its own seed (`replicate_seeds`).

    Raises:
        InvalidInput: there is no point.
    """
    if count < 1:
        raise InvalidInput("a design has points", field="count", value=count, limit=">= 1")
    return count if count < MIN_POINTS else MIN_REPLICATES if count < _FEW else REPLICATES


def replicates(count: int) -> NDArray[np.int64]:
    """Return the replicate of each of ``count`` points, (count,) int64 0…R−1.

    Raises:
        InvalidInput: there is no point.
    """
    return np.arange(count, dtype=np.int64) % replicate_number(count)


def replicate_seeds(seed: int, number: int) -> tuple[int, ...]:
    """Return ``number`` 128-bit seeds that follow from ``seed``, for independent replicates."""
    words = np.random.SeedSequence(seed).generate_state(2 * number, np.uint64)
    return tuple(int(high) << 64 | int(low) for high, low in words.reshape(number, 2))
