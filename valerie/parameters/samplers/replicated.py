"""Designs in randomised replicates, which give the error of a mean over them (`valerie.statistics.replicates`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from valerie.parameters.samplers.base import Sampler, SamplerFactory, UnitPoints
from valerie.statistics.replicates import replicate_number, replicate_seeds


@dataclass(frozen=True, slots=True)
class Replicated:
    """A factory of designs that consist of independent replicates of the design of another factory.

    Point i is point i // R of replicate i modulo R. Designs of 40 points or more always have eight replicates. If the points of
    a smaller replicate are the first points of a larger one, this therefore holds for the whole design too.

    Attributes:
        factory: factory of one replicate.
    """

    factory: SamplerFactory

    def __call__(self, *, dimensions: int, count: int, seed: int) -> Sampler:
        """Build the design of ``count`` points."""
        number = replicate_number(count)
        return _Replicates(
            dimensions,
            tuple(
                self.factory(dimensions=dimensions, count=-(-(count - replicate) // number), seed=own_seed)
                for replicate, own_seed in enumerate(replicate_seeds(seed, number))
            ),
        )


@dataclass(frozen=True, slots=True)
class _Replicates:
    dimensions: int
    replicates: tuple[Sampler, ...]

    def points(self, start: int, stop: int) -> UnitPoints:
        number = len(self.replicates)
        points = np.empty((stop - start, self.dimensions), np.float64)
        for replicate, sampler in enumerate(self.replicates):
            first, last = (-(-(index - replicate) // number) for index in (start, stop))
            if first < last:
                points[first * number + replicate - start :: number] = sampler.points(first, last)
        return points
