"""Independent uniform points."""

from __future__ import annotations

from valerie.parameters.samplers.base import UnitPoints, random_words, to_unit


class RandomSampler:
    """Every coordinate is uniform in [0, 1) and independent of all others."""

    def __init__(self, *, dimensions: int, count: int, seed: int) -> None:
        self.dimensions, self.count, self.seed = dimensions, count, seed

    def points(self, start: int, stop: int) -> UnitPoints:
        return to_unit(random_words(self.seed, start, stop, self.dimensions))
