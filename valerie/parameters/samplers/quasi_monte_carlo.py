"""Low-discrepancy designs of ``scipy.stats.qmc``, read at any index.

The points of a smaller design are the first points of a larger one with the same seed.
scipy is imported when points are drawn, since importing ``scipy.stats`` takes most of a second and the API only describes
designs.
"""

from __future__ import annotations

import numpy as np

from valerie.errors import InvalidInput
from valerie.parameters.samplers.base import UnitPoints


class SobolSampler:
    """Sobol' points with Owen-type scrambling (linear matrix scramble and digital shift); balanced for 2^k points."""

    #: scipy's generator has 30 bits.
    max_count = 2**30

    def __init__(self, *, dimensions: int, count: int, seed: int) -> None:
        if count > self.max_count:
            raise InvalidInput("too many points for this design", field="count", value=count, limit=self.max_count)
        self.dimensions, self.count, self.seed = dimensions, count, seed

    def points(self, start: int, stop: int) -> UnitPoints:
        from scipy.stats import qmc

        engine = qmc.Sobol(self.dimensions, scramble=True, rng=np.random.default_rng(self.seed))
        if start:
            engine.fast_forward(start)
            points = engine.random(stop - start)
        else:
            # When it starts at the first point, scipy warns unless it draws a power of two.
            points = engine.random(1 << max(stop - 1, 0).bit_length())[:stop]
        return np.asarray(points, np.float64)


class HaltonSampler:
    """Halton points with random permutations of the digits (Owen 2017, arXiv:1706.02808)."""

    def __init__(self, *, dimensions: int, count: int, seed: int) -> None:
        self.dimensions, self.count, self.seed = dimensions, count, seed

    def points(self, start: int, stop: int) -> UnitPoints:
        from scipy.stats import qmc

        engine = qmc.Halton(self.dimensions, scramble=True, rng=np.random.default_rng(self.seed))
        engine.fast_forward(start)
        return np.asarray(engine.random(stop - start), np.float64)
