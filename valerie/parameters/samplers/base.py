"""What a sampler is: a sequence of points in the unit cube, each of which follows from (seed, index) alone."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

#: Points in [0, 1), float64, one row per variant and one column per varied parameter.
UnitPoints = NDArray[np.float64]

_WORD: Final = 64
#: Uniform numbers are 53-bit integers times this.
_ULP: Final = 2.0**-53


class Sampler(Protocol):
    """A sequence of ``count`` points; made anew wherever needed, so it is cheap to make and keeps no state."""

    def points(self, start: int, stop: int) -> UnitPoints:
        """(stop − start, dimensions) float64 in [0, 1): rows start … stop − 1, whatever was read before."""
        ...


class SamplerFactory(Protocol):
    """Makes a sampler; a class with this constructor is one."""

    def __call__(self, *, dimensions: int, count: int, seed: int) -> Sampler:
        """A sampler of ``count`` points; ``seed`` is a 128-bit number that belongs to one block of one spec."""
        ...


def random_words(seed: int, start: int, stop: int, width: int) -> NDArray[np.uint64]:
    """(stop − start, width) uint64 random words; row i depends on (seed, i) alone.

    Philox4x64-10 (Salmon et al. 2011, DOI 10.1145/2063384.2063405) is a function of key and counter, four words for
    each
    counter value: row i owns the counter values from i·⌈width/4⌉ on. Raw words are used, since numpy promises their
    stream across versions.
    """
    per_row = -(-width // 4)
    philox = np.random.Philox(key=seed)
    philox.advance(start * per_row)
    words = np.asarray(philox.random_raw((stop - start) * per_row * 4), np.uint64)
    return words.reshape(stop - start, per_row * 4)[:, :width]


def to_unit(words: NDArray[np.uint64]) -> UnitPoints:
    """Random words to numbers in [0, 1) with 53 random bits."""
    return (words >> np.uint64(_WORD - 53)).astype(np.float64) * _ULP
