"""Calibration of predicted probabilities and quantiles over whole places that were held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Bins of the calibration error and of the reliability diagram, of equal width over 0…1.
BINS: Final = 10
#: Random sign vectors behind `Calibration.chance`.
_DRAWS: Final = 400

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ReliabilityBin:
    """Rows whose predicted probabilities lie in one bin.

    Attributes:
        low, high: bounds of the bin; the last one includes 1.
        rows: number of rows, at least 1.
        predicted: mean probability of the rows.
        observed: share of the rows in which the event happened.
    """

    low: float
    high: float
    rows: int
    predicted: float
    observed: float


@dataclass(frozen=True, slots=True)
class Calibration:
    """Agreement of probabilities with outcomes.

    Attributes:
        error: expected calibration error Σ rows · |observed − predicted| / N over bins of equal width (Naeini, Cooper and
            Hauskrecht 2015, doi:10.1609/aaai.v29i1.9602).
        chance: mean error that a perfectly calibrated model would show at this number of places. Each draw flips the signs
            of the residuals of whole places at random, which keeps their spread and removes their direction.
        places, rows: numbers that both errors are computed from.
        bins: the bins that contain rows.
    """

    error: float
    chance: float
    places: int
    rows: int
    bins: tuple[ReliabilityBin, ...]

    @property
    def on_new_places(self) -> float:
        """A bound on the error at similar places outside the run: ``error`` + ``chance``.

        Held-out places belong to the same sample, so ``error`` alone does not show how far that sample is typical. The
        coverage of the bound is not established: docs/error-model.md lists what was tried.
        """
        return self.error + self.chance

    def places_for(self, limit: float) -> int:
        """Return the number of places at which `on_new_places` would be ``limit`` if both parts fell with its square root."""
        return ceil(self.places * (self.on_new_places / limit) ** 2)


def calibration(
    predicted: Floats, happened: NDArray[np.bool_] | Floats, places: NDArray[np.int64], *, seed: int = 0
) -> Calibration:
    """Compare probabilities of an event with its occurrence.

    Args:
        predicted: (N,) probabilities, 0…1, each by a model that has not seen the row's place; N ≥ 1.
        happened: (N,) outcomes, or their true probabilities.
        places: (N,) place of each row.
        seed: of the random signs behind `Calibration.chance`.
    """
    numbers = np.minimum((predicted * BINS).astype(np.int64), BINS - 1)
    distinct, place = np.unique(places, return_inverse=True)
    residuals = np.zeros((len(distinct), BINS))
    np.add.at(residuals, (place, numbers), happened - predicted)
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), (_DRAWS, len(distinct)))
    rows = np.bincount(numbers, minlength=BINS)
    bins = tuple(
        ReliabilityBin(
            i / BINS,
            (i + 1) / BINS,
            int(rows[i]),
            float(predicted[numbers == i].mean()),
            float(happened[numbers == i].mean()),
        )
        for i in np.flatnonzero(rows).tolist()
    )
    return Calibration(
        error=float(np.abs(residuals.sum(0)).sum() / len(predicted)),
        chance=float(np.abs(signs @ residuals).sum(1).mean() / len(predicted)),
        places=len(distinct),
        rows=len(predicted),
        bins=bins,
    )


def quantile_shares(below: Floats, bounds: Floats, values: Floats, levels: Sequence[float]) -> tuple[float, ...]:
    """Return the share of values up to each quantile of a predicted distribution; if calibrated, it equals the level.

    A value counts by the part of its step of the distribution that is below the level, so values may pile up in one step:
    the non-randomised probability integral transform (Czado, Gneiting and Held 2009,
    doi:10.1111/j.1541-0420.2009.01191.x).

    Args:
        below: (N, B) predicted probabilities that a value is below each bound, ascending.
        bounds: (B,) ascending.
        values: (N,) values.
        levels: (L,) levels of the quantiles, 0…1.
    """
    ends = np.column_stack((np.zeros(len(values)), below, np.ones(len(values))))
    step = np.searchsorted(bounds, values, side="right")
    rows = np.arange(len(values))
    start, end = ends[rows, step], ends[rows, step + 1]
    parts = (np.asarray(levels)[:, None] - start) / np.maximum(end - start, 1e-12)
    return tuple(np.clip(parts, 0.0, 1.0).mean(1).tolist())
