"""The interface of a sampler: a sequence of points in the unit cube, each determined by (seed, index)."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

#: Points in [0, 1), float64, one row per variant and one column per varied parameter.
UnitPoints = NDArray[np.float64]

_WORD: Final = 64
#: Spacing of the uniform numbers, which are 53-bit integers times this.
_ULP: Final = 2.0**-53


class Sampler(Protocol):
    """A sequence of ``count`` points. It is built wherever it is needed, so it must be cheap and stateless."""

    def points(self, start: int, stop: int) -> UnitPoints:
        """Return rows start … stop − 1, (stop − start, dimensions) float64 in [0, 1), regardless of earlier calls."""
        ...


class SamplerFactory(Protocol):
    """The constructor of a sampler class, or an equivalent function."""

    def __call__(self, *, dimensions: int, count: int, seed: int) -> Sampler:
        """Build a sampler of ``count`` points; ``seed`` is a 128-bit number that belongs to one block of one spec."""
        ...


def random_words(seed: int, start: int, stop: int, width: int) -> NDArray[np.uint64]:
    """Return (stop − start, width) uint64 random words. Row i depends only on (seed, i).

    Philox4x64-10 (Salmon et al. 2011, DOI 10.1145/2063384.2063405) maps a key and a counter value to four words: row i
    uses ⌈width/4⌉ counter values from i·⌈width/4⌉ on. The words are raw, since numpy guarantees their stream across
    versions.
    """
    per_row = -(-width // 4)
    philox = np.random.Philox(key=seed)
    philox.advance(start * per_row)
    words = np.asarray(philox.random_raw((stop - start) * per_row * 4), np.uint64)
    return words.reshape(stop - start, per_row * 4)[:, :width]


def to_unit(words: NDArray[np.uint64]) -> UnitPoints:
    """Convert random words to numbers in [0, 1) with 53 random bits."""
    return (words >> np.uint64(_WORD - 53)).astype(np.float64) * _ULP
