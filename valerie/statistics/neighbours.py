"""Test whether neighbouring places of one site score alike.

Differences between places are judged by the scatter of the places, as if each were independent evidence. Places of one
street often are not: neighbours share houses, shade and background. Then a difference between two rows of places
is a property of this street, and the half of the places that confirms it repeats what the other half saw. Moran's I (1950,
doi:10.1093/biomet/37.1-2.17) of the places' means, less what the factors explain, detects such likeness. Its null
distribution is simulated, because residuals of a regression are negatively correlated (Cliff and Ord 1981, *Spatial Processes*).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.statistics.observations import Observations

#: Places count as alike at this p-value. Taking independent places for alike costs only findings between places.
ALIKE: Final = 0.2
#: Nearest places that are compared with each place.
_NEAREST: Final = 4
#: Independent draws behind the null distribution.
_DRAWS: Final = 199


def places_alike(observations: Observations, positions: NDArray[np.float64], *, seed: int) -> bool:
    """Return True if neighbouring places score more alike than independent places would.

    Args:
        observations: the rows.
        positions: (N, D) coordinates of the caller's rows, metres; equal within a place.
        seed: of the null distribution.
    """
    from scipy.spatial import cKDTree

    places = observations.places
    if places <= _NEAREST + 1:
        return False
    where = np.zeros((places, positions.shape[1]))
    where[observations.place] = np.nan_to_num(positions[observations.rows])
    # The first of the nearest places is the place itself, unless several have equal positions.
    nearest = np.asarray(cKDTree(where).query(where, _NEAREST + 1)[1])
    near = np.where(nearest == np.arange(places)[:, None], nearest[:, -1:], nearest)[:, :_NEAREST]
    counts = np.bincount(observations.place)
    means = np.bincount(observations.place, weights=observations.values) / counts
    columns = [np.ones((places, 1))]
    for name, levels in observations.levels.items():
        of_place = np.zeros(places, np.int64)
        of_place[observations.place] = observations.factors[name]
        if np.array_equal(of_place[observations.place], observations.factors[name]):
            columns.append((of_place[:, None] == np.arange(1, len(levels))).astype(np.float64))
    basis, triangle = np.linalg.qr(np.concatenate(columns, axis=1))
    basis = basis[:, np.abs(np.diagonal(triangle)) > 1e-9]
    drawn = np.random.default_rng(seed).standard_normal((places, _DRAWS))
    figures = np.column_stack([means, drawn])
    residuals = figures - basis @ (basis.T @ figures)
    squares = (residuals**2).sum(axis=0)
    if squares[0] < 1e-18:
        return False
    likeness = (residuals * residuals[near].mean(axis=1)).sum(axis=0) / squares
    return bool((1 + np.count_nonzero(likeness[1:] >= likeness[0])) / (1 + _DRAWS) <= ALIKE)
