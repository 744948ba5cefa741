"""Binned means of pACC."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput

#: Largest number of bins; beyond it, the width is multiplied by 2, 5, 10, 20 … until there are no more.
MAX_BINS: Final = 40


@dataclass(frozen=True, slots=True)
class Bin:
    """Persons with x in [low, high); a person counts once in each frame.

    Attributes:
        low, high: edges, multiples of the bin width.
        n: number of persons with a defined pACC.
        x: mean of their x, the position of the bin in a plot.
        mean: mean of their pACC.
        detected: number of persons with pACC ≥ threshold.
    """

    low: float
    high: float
    n: int
    x: float
    mean: float
    detected: int


def bin_edges(low: float, high: float, width: float) -> NDArray[np.float64]:
    """Return edges at whole multiples of ``width`` that cover ``low`` … ``high``; the last edge is above ``high``.

    Raises:
        InvalidInput: ``width`` is not positive.
    """
    if not width > 0:
        raise InvalidInput("bin width must be positive", field="width", value=width)
    widths = (width * step * 10.0**power for power in range(16) for step in (1, 2, 5))
    chosen = next((candidate for candidate in widths if (high - low) / candidate <= MAX_BINS - 1), high - low)
    first, last = int(np.floor(low / chosen + 1e-9)), int(np.floor(high / chosen + 1e-9)) + 1
    edges: NDArray[np.float64] = np.round(np.arange(first, last + 1) * chosen, 10)
    return edges


def bins_of(
    x: NDArray[np.float64],
    pacc: NDArray[np.float64],
    rows: NDArray[np.bool_],
    *,
    edges: NDArray[np.float64],
    threshold: float,
) -> tuple[Bin, ...]:
    """Return the bins of ``x`` with at least one row, in ascending order.

    Args:
        x: (N,) of the whole table; NaN values are left out.
        pacc: (N,) likewise.
        rows: (N,) bool, the rows to use.
        edges: (K+1,), ascending.
        threshold: of the detection rate.
    """
    usable = rows & np.isfinite(x) & np.isfinite(pacc)
    along, values = x[usable], pacc[usable]
    bin_of = np.searchsorted(edges, along, side="right") - 1
    n, sum_x, total, detected = (
        np.bincount(bin_of, weights, len(edges) - 1).tolist() for weights in (None, along, values, values >= threshold)
    )
    return tuple(
        Bin(low, high, n[k], sum_x[k] / n[k], total[k] / n[k], int(detected[k]))
        for k, (low, high) in enumerate(pairwise(edges.tolist()))
        if n[k]
    )
