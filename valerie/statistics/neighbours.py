"""Test if neighbouring places of one site score alike.

A mean over places is judged by the scatter of the places, as if each were independent evidence. Places of one street often
are not: neighbours share houses, shade and background. Then a difference between two rows of places, or the mean effect of a
sun, is a property of this street, and the half of the places that confirms it repeats what the other half saw. Moran's I (1950,
doi:10.1093/biomet/37.1-2.17) of the places' figures, less what is fitted to them, detects such likeness. Its null distribution
is that of the same residuals at shuffled places (Cliff and Ord 1981, *Spatial Processes*), from which the fit is taken again,
because residuals of a regression are negatively correlated.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Largest and smallest p-value at which places count as alike. Taking independent places for alike costs power.
ALIKE: Final = 0.2
_LEAST: Final = 0.01
#: Fewer places show less likeness: the p-value is the first over the number of places for what is compared between them (0.1 at
#: 120 places), and the second over its square for differences within them (0.02), most of which are independent.
_BETWEEN: Final = 12.0
_WITHIN: Final = 300.0
#: Fewest and most nearest places that are compared with each place: a quarter of all, within these.
_NEAREST: Final = (4, 8)
#: Shuffles behind the null distribution.
_SHUFFLES: Final = 199
#: Figures that are shuffled at once, which bounds memory.
_BATCH: Final = 1_000_000


def alike(
    figures: NDArray[np.float64],
    positions: NDArray[np.float64],
    fitted: NDArray[np.float64] | None = None,
    *,
    within: bool = False,
) -> NDArray[np.bool_]:
    """Find groups in which neighbouring places have more similar figures than independent places would.

    Args:
        figures: (G, S) of the places; NaN where a place has none.
        positions: (G, D) coordinates of the places, metres.
        fitted: (G, P) columns whose linear combination is taken from the figures first; None: their mean.
        within: True if the figures are differences within places; this decides the level.

    Returns:
        (S,) bool: True if a column is alike, or all columns with figures at the same places together are.
    """
    known = np.isfinite(figures)
    columns = np.ones((len(figures), 1)) if fitted is None else fitted
    found = np.zeros(figures.shape[1], np.bool_)
    patterns, pattern = np.unique(known, axis=1, return_inverse=True)
    for k, rows in enumerate(patterns.T):
        of_pattern = np.flatnonzero(pattern.ravel() == k)
        found[of_pattern] = _alike(figures[np.ix_(rows, of_pattern)], positions[rows], columns[rows], within)
    return found


def level_of(places: int, *, within: bool) -> float:
    """Return the p-value at which places count as alike."""
    return min(ALIKE, max(_LEAST, _WITHIN / places**2 if within else _BETWEEN / places))


def _alike(
    figures: NDArray[np.float64], positions: NDArray[np.float64], fitted: NDArray[np.float64], within: bool
) -> NDArray[np.bool_]:
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree

    places, found = len(figures), np.zeros(figures.shape[1], np.bool_)
    fewest, most = _NEAREST
    if places <= fewest + 1:
        return found
    neighbours = min(max(places // 4, fewest), most)
    # The first of the nearest places is the place itself, unless several have equal positions.
    nearest = np.asarray(cKDTree(positions).query(positions, neighbours + 1)[1])
    near = np.where(nearest == np.arange(places)[:, None], nearest[:, -1:], nearest)[:, :neighbours]
    basis, triangle = np.linalg.qr(fitted)
    basis = basis[:, np.abs(np.diagonal(triangle)) > 1e-9]
    residuals = figures - basis @ (basis.T @ figures)
    spread = (residuals**2).sum(axis=0) > 1e-18
    if not spread.any():
        return found
    residuals = residuals[:, spread]
    entries = np.full(near.size, 1 / neighbours), (np.repeat(np.arange(places), neighbours), near.ravel())
    averaging = csr_array(entries, shape=(places, places))

    def likeness(own: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (K, S + 1): Moran's I of each column of (G, K, S) figures, and the mean of all columns."""
        around = (averaging @ own.reshape(places, -1)).reshape(own.shape)
        each = (own * around).sum(axis=0) / np.maximum((own**2).sum(axis=0), 1e-300)
        return np.column_stack([each, each.mean(axis=1)])

    seen, rng = likeness(residuals[:, None])[0], np.random.default_rng(0)
    larger, batch = np.zeros(len(seen)), max(_BATCH // residuals.size, 1)
    for first in range(0, _SHUFFLES, batch):
        orders = rng.random((min(batch, _SHUFFLES - first), places)).argsort(axis=1)
        shuffled = residuals[orders.T]
        fit = basis @ (basis.T @ shuffled.reshape(places, -1))
        larger += (likeness(shuffled - fit.reshape(shuffled.shape)) >= seen).sum(axis=0)
    p_values = (1 + larger) / (1 + _SHUFFLES)
    found[spread] = np.minimum(p_values[:-1], p_values[-1]) <= level_of(places, within=within)
    return found
