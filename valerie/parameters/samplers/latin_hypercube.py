"""Latin hypercube: each coordinate has exactly one point in each of ``count`` equal strata (McKay et al. 1979).

DOI 10.1080/00401706.1979.10489755. A point is (π_d(i) + v) / count with one permutation π_d per dimension and v
uniform in [0, 1). The permutation must be computable for a single i, without being stored: it is a Feistel network over
the 2h-bit numbers that cover 0 … count − 1, applied until the result is below count (cycle walking; Black and Rogaway
2002, DOI 10.1007/3-540-45760-7_9). A Feistel network is a bijection for any round function, and so is the walk.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.parameters.samplers.base import UnitPoints, random_words

_ROUNDS: Final = 10
#: Bits of the position within a stratum: few enough that stratum + position is exact and never rounds into the next stratum.
_PLACE_BITS: Final = 31


class LatinHypercubeSampler:
    """``count`` points, one per stratum and dimension, at random positions within the strata."""

    def __init__(self, *, dimensions: int, count: int, seed: int) -> None:
        self.dimensions, self.count, self.seed = dimensions, count, seed
        # The keys of the permutations come from rows that the positions (rows 0 … count − 1) never reach.
        first = 1 << 64
        self._keys = random_words(seed, first, first + dimensions, _ROUNDS)

    def points(self, start: int, stop: int) -> UnitPoints:
        words = random_words(self.seed, start, stop, self.dimensions)
        places = (words >> np.uint64(64 - _PLACE_BITS)).astype(np.float64) * 2.0**-_PLACE_BITS
        indexes = np.arange(start, stop, dtype=np.uint64)
        strata = np.empty((stop - start, self.dimensions), np.float64)
        for dimension, keys in enumerate(self._keys):
            strata[:, dimension] = permute(indexes, self.count, keys)
        unit: UnitPoints = (strata + places) / self.count
        return unit


def permute(indexes: NDArray[np.uint64], count: int, keys: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Apply the permutation of 0 … count − 1 that ``keys`` define to ``indexes`` (any shape, uint64)."""
    if count == 1:  # a replicate of a small design; the walk below would be long
        return np.zeros_like(indexes)
    half = max(2, -(-(count - 1).bit_length() // 2))
    permuted = _feistel(indexes, half, keys)
    outside = permuted >= count
    while outside.any():
        permuted[outside] = _feistel(permuted[outside], half, keys)
        outside = permuted >= count
    return permuted


def _feistel(numbers: NDArray[np.uint64], half: int, keys: NDArray[np.uint64]) -> NDArray[np.uint64]:
    shift, mask = np.uint64(half), np.uint64((1 << half) - 1)
    left, right = numbers >> shift, numbers & mask
    for key in keys:
        left, right = right, left ^ (_mix(right ^ key) & mask)
    return (left << shift) | right


def _mix(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Apply the finalizer of SplitMix64 (Steele et al. 2014, DOI 10.1145/2660193.2660195), modulo 2^64."""
    words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))
