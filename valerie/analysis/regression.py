"""Polynomial regression with a confidence band: degree by cross-validation, band by the run's bootstrap draws.

The paper draws "a polynomial function of a higher order". Here the degree is the smallest that predicts unseen
situations as well as the best degree does. Everything is computed from sums per situation (Σ φφᵀ, Σ φy of Chebyshev
polynomials φ), so that a million rows are read once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from valerie.analysis.intervals import MIN_SITUATIONS, Resampler, quantiles

MAX_DEGREE: Final = 5
FOLDS: Final = 10
#: Number of points of a curve.
GRID: Final = 61


@dataclass(frozen=True, slots=True)
class Curve:
    """A fitted polynomial over its domain.

    Attributes:
        n: number of fitted rows; ``situations`` is the number of drawn units among them.
        degree: chosen by cross-validation.
        domain: smallest and largest x; the curve is not defined beyond.
        coefficients: of Chebyshev polynomials on ``domain`` (as `numpy.polynomial.Chebyshev`).
        rmse: root mean square residual of the fit.
        x, y, low, high: the curve and its pointwise 95 % bootstrap band at `GRID` points. Not clipped to 0…1.
    """

    n: int
    situations: int
    degree: int
    domain: tuple[float, float]
    coefficients: tuple[float, ...]
    rmse: float
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Per unit: Σ φφᵀ (G, P, P), Σ φy (G, P), Σ y² (G,), n (G,)."""

    gram: NDArray[np.float64]
    moment: NDArray[np.float64]
    square: NDArray[np.float64]
    n: NDArray[np.float64]


def fit_curve(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    rows: NDArray[np.bool_],
    *,
    resampler: Resampler,
    seed: int,
    max_degree: int = MAX_DEGREE,
) -> Curve | None:
    """Fit a polynomial of y over x.

    Args:
        x: (N,) of the whole table; NaN values are left out.
        y: (N,) likewise.
        rows: (N,) bool, the rows to use.
        resampler: the run's draws.
        seed: of the folds.
        max_degree: highest degree to try.

    Returns:
        The curve; None with fewer than `MIN_SITUATIONS` situations or fewer than two distinct x.
    """
    usable = rows & np.isfinite(x) & np.isfinite(y)
    situations = resampler.occupied(usable)
    distinct = len(np.unique(x[usable]))
    if situations < MIN_SITUATIONS or distinct < 2:
        return None
    low, high = float(x[usable].min()), float(x[usable].max())
    highest = min(max_degree, distinct - 1, max(situations // 6, 1))
    sums = _sums(x[usable], y[usable], resampler.group[usable], resampler.groups, (low, high), highest)
    degree = _choose_degree(sums, highest, seed)
    terms = slice(0, degree + 1)
    gram, moment = sums.gram[:, terms, terms], sums.moment[:, terms]
    coefficients = _solve(gram.sum(axis=0), moment.sum(axis=0))
    error = _squared_error(coefficients, gram.sum(axis=0), moment.sum(axis=0), float(sums.square.sum()))
    grid = np.linspace(low, high, GRID)
    basis = chebyshev.chebvander(_unit(grid, (low, high)), degree)
    drawn_gram = np.einsum("bg,gpq->bpq", resampler.weights, gram, optimize=True)
    drawn = _solve(drawn_gram, resampler.weights @ moment)
    band = np.quantile(drawn @ basis.T, quantiles(situations), axis=0)
    return Curve(
        n=int(np.count_nonzero(usable)),
        situations=situations,
        degree=degree,
        domain=(low, high),
        coefficients=tuple(coefficients.tolist()),
        rmse=float(np.sqrt(max(error, 0.0) / np.count_nonzero(usable))),
        x=tuple(grid.tolist()),
        y=tuple((basis @ coefficients).tolist()),
        low=tuple(band[0].tolist()),
        high=tuple(band[1].tolist()),
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

    Folds hold whole units; the rule is that of Breiman et al. 1984 (*Classification and Regression Trees*, section
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
    """Solve normal equations, (…, P, P) and (…, P), by least squares; of singular ones, return the shortest solution."""
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
