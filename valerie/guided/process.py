"""A Gaussian process of margins: Matérn 5/2 with one length scale per feature, and noise.

Rasmussen and Williams 2006, *Gaussian Processes for Machine Learning*, http://gaussianprocess.org/gpml. scikit-learn's process
gives the same numbers. This one takes a quarter of the time to fit, since its gradient needs no array of n × n × features,
and can be extended: its Cholesky factor gets new rows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dpotri, dtrtri
from scipy.optimize import minimize

Floats = NDArray[np.float64]

#: Ranges of variance, noise and length scales. Scales of features without effect end at their upper limit.
_VARIANCES: Final = (1e-2, 1e3)
_NOISES: Final = (1e-4, 10.0)
_LENGTHS: Final = (0.05, 30.0)
#: Relative change of the likelihood that ends its climb.
_CLIMBED: Final = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """The covariance of margins.

    Attributes:
        variance, noise: of the margins, and of what repeats do not share.
        lengths: (k,) length scales of the features.
    """

    variance: float
    noise: float
    lengths: Floats

    def __call__(self, features: Floats, others: Floats) -> Floats:
        """Return the covariance without noise, (n, m), between (n, k) and (m, k) features."""
        distances = _distances(features / self.lengths, others / self.lengths)
        result = np.exp(-distances)
        result *= self.variance * (1 + distances + distances**2 / 3)
        return result

    @classmethod
    def likeliest(cls, features: Floats, values: Floats, start: Kernel | None = None) -> Kernel:
        """Return the kernel under which the values, (n,), are likeliest, climbing from ``start``."""
        start = start or cls(4.0, 0.05, np.ones(features.shape[1]))
        ranges = (_VARIANCES, _NOISES, *[_LENGTHS] * features.shape[1])
        found = minimize(
            _unlikelihood,
            np.log([start.variance, start.noise, *start.lengths]),
            (features, values - values.mean()),
            jac=True,
            bounds=[(math.log(low), math.log(high)) for low, high in ranges],
            options={"ftol": _CLIMBED},
        )
        variance, noise, *lengths = np.exp(found.x).tolist()
        return cls(variance, noise, np.array(lengths))


def _distances(scaled: Floats, others: Floats) -> Floats:
    """Return √5 times the distances, (n, m)."""
    squares = scaled @ (-10 * others.T)
    squares += 5 * (scaled**2).sum(axis=1)[:, None]
    squares += 5 * (others**2).sum(axis=1)
    return np.sqrt(np.maximum(squares, 0, out=squares), out=squares)


def _unlikelihood(logs: Floats, features: Floats, values: Floats) -> tuple[float, Floats]:
    """Return the negative log likelihood up to a constant, and its gradient (equations 5.8 and 5.9)."""
    variance, noise, *lengths = np.exp(logs).tolist()
    scaled = features / lengths
    distances = _distances(scaled, scaled)
    decay = variance * np.exp(-distances)
    covariance = decay * (1 + distances + distances**2 / 3)
    factor = cholesky(covariance + noise * np.eye(len(values)), lower=True)
    lower, _ = dpotri(factor, lower=1)
    inverse = lower + np.tril(lower, -1).T
    weights = inverse @ values
    slopes = inverse - np.outer(weights, weights)
    by_lengths = slopes * decay * (1 + distances) * (5 / 3)
    gradient = [
        np.vdot(slopes, covariance) / 2,
        noise * np.trace(slopes) / 2,
        *(by_lengths.sum(axis=0) @ scaled**2 - ((by_lengths @ scaled) * scaled).sum(axis=0)),
    ]
    return float(values @ weights / 2 + np.log(np.diag(factor)).sum()), np.array(gradient)


class Process:
    """A Gaussian process with a given kernel.

    Args:
        kernel: its kernel.
        features: (n, k).
        values: (n,) margins.
        before: a process of the same kernel with the first of these features, whose Cholesky factor is extended.

    Attributes:
        kernel: see above.
        factor: (n, n) lower Cholesky factor of the covariance with noise.
    """

    def __init__(self, kernel: Kernel, features: Floats, values: Floats, before: Process | None = None) -> None:
        self.kernel, self._features = kernel, features
        self.factor: Floats = np.empty((0, 0)) if before is None else before.factor
        old, new = np.split(features, [len(self.factor)])
        cross = self._solved(kernel(old, new))
        rest = kernel(new, new) + kernel.noise * np.eye(len(new)) - cross.T @ cross
        self.factor = np.block([[self.factor, np.zeros_like(cross)], [cross.T, cholesky(rest, lower=True)]])
        self._values, self._middle = values, float(values.mean())
        self._whitened = self._solved(values - self._middle)

    def seen(self, features: Floats) -> Floats:
        """Return what the values tell about others, (n, m) for (m, k) features, as `predict` takes it.

        Their covariance is lowered by the products of its columns.
        """
        return self._solved(self.kernel(self._features, features))

    def predict(self, seen: Floats) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of the margins, without noise, each (m,)."""
        variance = self.kernel.variance - np.einsum("ij,ij->j", seen, seen)
        return self._middle + self._whitened @ seen, np.sqrt(np.maximum(variance, 1e-12))

    def held_out(self) -> Floats:
        """Return μ / σ, (n,), of each value from all others (equations 5.12)."""
        inverse, _ = dtrtri(self.factor, lower=1)
        precision = np.einsum("ij,ij->j", inverse, inverse)
        mean = self._values - (self._whitened @ inverse) / precision
        return np.asarray(mean * np.sqrt(precision))

    def _solved(self, right: Floats) -> Floats:
        return np.asarray(solve_triangular(self.factor, right, lower=True))
