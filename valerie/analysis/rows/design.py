"""A run's design, as statistics need it: the rows that were drawn, the positions that make a place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON
from valerie.statistics.replicates import replicates
from valerie.statistics.units import EVEN, INDEPENDENT, LISTED


@dataclass(frozen=True, slots=True)
class Design:
    """Choice of the variants of one run.

    Attributes:
        blocks: design and number of variants of each block, in order.
        site: the seed that the asset was generated from; None for an asset without one.
    """

    blocks: tuple[tuple[str, int], ...]
    site: int | None = None

    def design_of(self, variants: NDArray[np.int64]) -> tuple[str, NDArray[np.int64] | None]:
        """Return the design of some variants (`valerie.statistics.units.sampling_units`) and their replicates.

        If any block lists its variants, or uses the sampler of a plug-in, of which nothing is known, all count as listed.
        Otherwise, if any block draws independent variants, all count as independent: intervals are valid but wide.

        Args:
            variants: (N,) indices of variants of the run.

        Returns:
            The name, and the (N,) replicate of each variant; None if the design has none.
        """
        names = {name for name, _ in self.blocks}
        if not names <= INDEPENDENT | EVEN:
            return "grid", None
        if names & INDEPENDENT:
            return "random", None
        numbers = [replicates(count) for _, count in self.blocks]
        firsts = accumulate((own.max() + 1 for own in numbers[:-1]), initial=0)
        return "sobol", np.concatenate([own + first for own, first in zip(numbers, firsts, strict=True)])[variants]

    def drawn(self, variants: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (N,) bool: the variants that are not listed; each of them is its own place."""
        return np.array([name not in LISTED for name, _ in self.blocks])[self.blocks_of(variants)]

    def blocks_of(self, variants: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the (N,) block of each variant."""
        ends = list(accumulate(count for _, count in self.blocks))
        return np.searchsorted(ends, variants, side="right").astype(np.int64)

    def block(self, number: int) -> tuple[str, int, int]:
        """Return the design of a block, the index of its first variant, and its number of variants."""
        name, count = self.blocks[number]
        return name, sum(size for _, size in self.blocks[:number]), count


#: Design of variants of which nothing is known: they are no sample, and each is its own place.
UNKNOWN: Final = Design((("unknown", 2**62),))


def position_paths(paths: Iterable[str]) -> tuple[str, ...]:
    """Return the parameters that make a place: positions of persons, or all positions if those of persons do not vary."""
    positions = [path for path in paths if ".pos." in path]
    of_persons = tuple(path for path in positions if path.split(".")[1].startswith(f"{PERSON.node_class}-"))
    return of_persons or tuple(positions)
