"""The paper's regression of pACC: a polynomial "of a higher order" whose degree is chosen by cross-validation over places.

The degree is the smallest that predicts held-out places as well as the best one. Everything is computed from sums by place
(Σ φφᵀ, Σ φy of Chebyshev polynomials φ), so that a million rows are read once. A polynomial has no band, because bands from
resampled places fall short of their coverage (docs/statistics.md); those of `valerie.statistics.curves` do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from valerie.statistics.curves import GRID, contradicted_bins

MAX_DEGREE: Final = 5
FOLDS: Final = 10
#: With fewer places than this there is no polynomial.
MIN_PLACES: Final = 6
#: More places than this are put into random groups, which bounds memory.
_MOST_GROUPS: Final = 500


@dataclass(frozen=True, slots=True)
class Polynomial:
    """A fitted polynomial over its domain.

    Attributes:
        n: number of fitted rows.
        places: number of their places.
        degree: chosen by cross-validation.
        domain: smallest and largest x; the polynomial is not defined beyond.
        coefficients: of Chebyshev polynomials on ``domain`` (as `numpy.polynomial.Chebyshev`).
        rmse: root mean square residual of the fit.
        x, y: the polynomial at `GRID` points. Not clipped to 0…1.
        contradicted: True if a bin of the data contradicts it, so that it must not be drawn.
    """

    n: int
    places: int
    degree: int
    domain: tuple[float, float]
    coefficients: tuple[float, ...]
    rmse: float
    x: tuple[float, ...]
    y: tuple[float, ...]
    contradicted: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Per group of places: Σ φφᵀ (G, P, P), Σ φy (G, P), Σ y² (G,), n (G,)."""

    gram: NDArray[np.float64]
    moment: NDArray[np.float64]
    square: NDArray[np.float64]
    n: NDArray[np.float64]


def fit_polynomial(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    places: NDArray[np.int64],
    *,
    seed: int,
    max_degree: int = MAX_DEGREE,
) -> Polynomial | None:
    """Fit a polynomial of y over x.

    Args:
        x: (N,); rows without a finite number are left out.
        y: (N,) scores in 0…1; likewise.
        places: (N,) whole numbers, the place of each row.
        seed: of the folds.
        max_degree: highest degree to try.

    Returns:
        The polynomial; None with fewer than `MIN_PLACES` places or fewer than two distinct x.
    """
    usable = np.isfinite(x) & np.isfinite(y)
    along, values = x[usable], y[usable]
    occurring, place = np.unique(places[usable], return_inverse=True)
    distinct = len(np.unique(along))
    if len(occurring) < MIN_PLACES or distinct < 2:
        return None
    groups = min(len(occurring), _MOST_GROUPS)
    group = (np.random.default_rng(seed).permutation(len(occurring)) % groups)[place]
    low, high = float(along.min()), float(along.max())
    highest = min(max_degree, distinct - 1, max(groups // 6, 1))
    sums = _sums(along, values, group, groups, (low, high), highest)
    degree = _choose_degree(sums, highest, seed)
    terms = slice(0, degree + 1)
    gram, moment = sums.gram[:, terms, terms].sum(axis=0), sums.moment[:, terms].sum(axis=0)
    coefficients = _solve(gram, moment)
    error = _squared_error(coefficients, gram, moment, float(sums.square.sum()))

    def at(points: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(chebyshev.chebvander(_unit(np.asarray(points), (low, high)), degree) @ coefficients)

    grid = np.linspace(low, high, GRID)
    return Polynomial(
        n=len(along),
        places=len(occurring),
        degree=degree,
        domain=(low, high),
        coefficients=tuple(coefficients.tolist()),
        rmse=float(np.sqrt(max(error, 0.0) / len(along))),
        x=tuple(grid.tolist()),
        y=tuple(at(grid).tolist()),
        contradicted=bool(contradicted_bins(at(along), along, values, place, seed=seed)),
    )


def _sums(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    group: NDArray[np.int64],
    groups: int,
    domain: tuple[float, float],
    degree: int,
) -> _Sums:
    basis = chebyshev.chebvander(_unit(x, domain), degree)
    terms = degree + 1

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(group, weights=values, minlength=groups).astype(np.float64)

    gram = np.empty((groups, terms, terms))
    for p in range(terms):
        for q in range(p, terms):
            gram[:, p, q] = gram[:, q, p] = total(basis[:, p] * basis[:, q])
    moment = np.stack([total(basis[:, p] * y) for p in range(terms)], axis=1)
    return _Sums(gram, moment, total(y * y), total(np.ones_like(y)))


def _choose_degree(sums: _Sums, highest: int, seed: int) -> int:
    """Return the smallest degree whose held-out error is at most one standard error above the best one's.

    Folds consist of whole places; the rule is that of Breiman et al. 1984 (*Classification and Regression Trees*, section
    3.4.3), with the standard error of the *difference*.
    """
    occupied = np.flatnonzero(sums.n)
    folds = min(FOLDS, len(occupied))
    fold_of = np.full(len(sums.n), -1)
    fold_of[occupied] = np.random.default_rng(seed).permutation(len(occupied)) % folds
    errors = np.empty((folds, highest + 1))
    for fold in range(folds):
        held, rest = fold_of == fold, (fold_of >= 0) & (fold_of != fold)
        for degree in range(highest + 1):
            terms = slice(0, degree + 1)
            fitted = _solve(sums.gram[rest, terms, terms].sum(axis=0), sums.moment[rest, terms].sum(axis=0))
            held_gram, held_moment = sums.gram[held, terms, terms].sum(axis=0), sums.moment[held, terms].sum(axis=0)
            error = _squared_error(fitted, held_gram, held_moment, float(sums.square[held].sum()))
            errors[fold, degree] = error / sums.n[held].sum()
    best = int(errors.mean(axis=0).argmin())
    excess = errors - errors[:, [best]]
    tolerance = excess.std(axis=0, ddof=1) / np.sqrt(folds)
    return int(np.flatnonzero(excess.mean(axis=0) <= tolerance + 1e-12)[0])


def _solve(gram: NDArray[np.float64], moment: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve normal equations, (…, P, P) and (…, P), by least squares; singular ones get the shortest solution."""
    solved: NDArray[np.float64] = np.linalg.pinv(gram, rcond=1e-10, hermitian=True) @ moment[..., None]
    return solved[..., 0]


def _squared_error(
    c: NDArray[np.float64], gram: NDArray[np.float64], moment: NDArray[np.float64], square: float
) -> float:
    """Return Σ (y − cᵀφ)² = Σ y² − 2 cᵀ Σ φy + cᵀ (Σ φφᵀ) c."""
    return float(square - 2 * c @ moment + c @ gram @ c)


def _unit(x: NDArray[np.float64], domain: tuple[float, float]) -> NDArray[np.float64]:
    """Return x with the domain mapped to −1…1."""
    return (2 * x - domain[0] - domain[1]) / (domain[1] - domain[0])
