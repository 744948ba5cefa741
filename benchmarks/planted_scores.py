"""Draw planted scores from a seed: functions of the unit cube with a known failure rate, for guided validation.

================= ============================================================================
family            condition of a failure
================= ============================================================================
smooth            a random linear combination with a gentle bend is high
disjoint          a point lies in one of four balls
interaction-only  a product of pairs is high; no parameter matters alone
discontinuous     a point lies in a box of three parameters; scores step elsewhere
hidden mode       half as smooth, half in a ball that the scores around it do not reveal
partly undefined  as smooth; scores are undefined in a tenth of the cube
*band*            a point lies near a curved sheet that crosses the cube
*worst of three*  the largest of three linear combinations is high: the boundary has edges
*waves*           as smooth, with waves of half its size and a quarter of the cube's length
*saturated*       as smooth, but most scores are close to 1, so that they hardly fall before a failure
covariates        as smooth, in four covariates: each is a sum of waves of three parameters, like a distance
================= ============================================================================

*Italics* mark `HELD_OUT`, which were drawn up after the constants of the strategies were chosen and must not be used to choose
any.

A score is the logistic function of a margin, and fails below 0.5. The margin is shifted to give the requested failure rate on
points that no repetition draws: 2^18 of them, or 2^21 for a rate below 0.005. The rate itself is that of 2^21 or 2^23 others, so
that its error is a small part of an interval.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

Floats = NDArray[np.float64]
Score = Callable[[Floats], Floats]

FAMILIES: Final = ("smooth", "disjoint", "interaction-only", "discontinuous", "hidden mode", "partly undefined")
HELD_OUT: Final = ("band", "worst of three", "waves", "saturated")
COVARIATES: Final = "covariates"
AT_LEAST: Final = 0.5
_TRUTH_POINTS: Final = 2**18
_TRUTH_POINTS_OF_RARE: Final = 2**21
#: Points at a time for the rate, and how many times, for rates from 0.005 on.
_BLOCK: Final = 2**17
_BLOCKS: Final = 16


@dataclass(frozen=True, slots=True)
class Planted:
    """A planted score.

    Attributes:
        family: one of `FAMILIES`, `HELD_OUT` or `COVARIATES`.
        dimensions: number of the cube's dimensions, 6 to 12.
        score: (n, dimensions) points to (n,) scores in 0…1, NaN where undefined.
        rate: the failure rate.
        covariates: (n, dimensions) points to (n, 4) covariates; None for other families.
    """

    family: str
    dimensions: int
    score: Score
    rate: float
    covariates: Score | None = None


def plant(family: str, seed: int, rate: float, dimensions: int | None = None) -> Planted:
    """Return the score of a family, which follows from the seed; by default, so does the number of dimensions."""
    rng = np.random.default_rng([seed, crc32(family.encode())])
    drawn = int(rng.integers(6, 13))
    dimensions = drawn if dimensions is None else dimensions
    cube = np.random.default_rng([seed, 1, 1]).random(
        (_TRUTH_POINTS if rate >= 0.005 else _TRUTH_POINTS_OF_RARE, dimensions)
    )
    covariates = _covariates(rng, dimensions) if family == COVARIATES else None
    margin = _of(covariates, rng, cube, rate) if covariates else MARGINS[family](rng, dimensions, cube, rate)
    edge = rng.integers(dimensions) if family == "partly undefined" else None

    def score(points: Floats) -> Floats:
        scores = expit(margin(points))
        if edge is not None:
            scores = np.where(points[:, edge] > 0.9, np.nan, scores)
        return np.asarray(scores)

    others = np.random.default_rng([seed, 1, 2])
    shares = [
        np.mean(score(others.random((_BLOCK, dimensions))) < AT_LEAST)
        for _ in range(_BLOCKS if rate >= 0.005 else 4 * _BLOCKS)
    ]
    return Planted(family, dimensions, score, float(np.mean(shares)), covariates)


Margin = Callable[[Floats], Floats]


def _shifted(load: Margin, cube: Floats, rate: float) -> Margin:
    """Return a margin that is below 0 for a share ``rate`` of the cube, with a standard deviation of 2."""
    loads = load(cube)
    bound, scale = float(np.quantile(loads, 1 - rate)), 2 / float(loads.std())
    return lambda points: scale * (bound - load(points))


def _smooth(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    weights, bend = rng.normal(size=dimensions), 0.5 * rng.normal(size=dimensions)
    return _shifted(lambda x: (x - 0.5) @ weights + ((x - 0.5) @ bend) ** 2, cube, rate)


def _covariates(rng: np.random.Generator, dimensions: int) -> Score:
    mixing = np.array([rng.choice(dimensions, 3, replace=False) for _ in range(4)])
    turns = np.pi * rng.uniform(0.5, 2.5, (4, 3))
    return lambda points: np.asarray(np.sin(turns * points[:, mixing]).sum(axis=2))


def _of(covariates: Score, rng: np.random.Generator, cube: Floats, rate: float) -> Margin:
    margin = _smooth(rng, 4, covariates(cube), rate)
    return lambda points: margin(covariates(points))


def _disjoint(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    centres = rng.random((4, dimensions))

    def load(points: Floats) -> Floats:
        squares = (points**2).sum(axis=1)[:, None] - 2 * points @ centres.T + (centres**2).sum(axis=1)
        return np.asarray(-np.sqrt(np.maximum(squares.min(axis=1), 0)))

    return _shifted(load, cube, rate)


def _interaction_only(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    order = rng.permutation(dimensions)[: dimensions // 2 * 2].reshape(-1, 2)
    weights = rng.uniform(0.5, 1.5, len(order)) * rng.choice((-1, 1), len(order))
    return _shifted(lambda x: ((x[:, order] - 0.5).prod(axis=2)) @ weights, cube, rate)


def _discontinuous(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    chosen = rng.permutation(dimensions)
    side = rate ** (1 / 3)
    low = rng.uniform(0, 1 - side, 3)

    def margin(points: Floats) -> Floats:
        inside = ((points[:, chosen[:3]] >= low) & (points[:, chosen[:3]] < low + side)).all(axis=1)
        return np.where(inside, -1.0, 0.5 + np.floor(3 * points[:, chosen[3]]) + points[:, chosen[4]])

    del cube
    return margin


def _hidden_mode(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    smooth = _smooth(rng, dimensions, cube, rate / 2)
    centre = rng.random(dimensions)

    def distance(points: Floats) -> Floats:
        return np.asarray(((points - centre) ** 2).sum(axis=1))

    radius = float(np.quantile(distance(cube), rate / 2))
    return lambda points: np.where(distance(points) < radius, -1.0, smooth(points))


def _band(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    weights, bend = rng.normal(size=dimensions), rng.normal(size=dimensions)

    def height(points: Floats) -> Floats:
        return np.asarray((points - 0.5) @ weights + ((points - 0.5) @ bend) ** 2)

    middle = float(np.quantile(height(cube), rng.uniform(0.2, 0.8)))
    return _shifted(lambda x: -np.abs(height(x) - middle), cube, rate)


def _worst_of_three(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    weights = rng.normal(size=(dimensions, 3))
    return _shifted(lambda x: ((x - 0.5) @ weights).max(axis=1), cube, rate)


def _waves(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    weights, directions = rng.normal(size=dimensions), rng.normal(size=(dimensions, 3))
    directions *= 8 * np.pi / np.abs(directions).sum(axis=0)
    phases = rng.uniform(0, 2 * np.pi, 3)
    size = 0.5 * float(((cube - 0.5) @ weights).std())
    return _shifted(lambda x: (x - 0.5) @ weights + size * np.sin(x @ directions + phases).sum(axis=1), cube, rate)


def _saturated(rng: np.random.Generator, dimensions: int, cube: Floats, rate: float) -> Margin:
    smooth = _smooth(rng, dimensions, cube, rate)
    return lambda points: 12 * np.tanh(smooth(points))


MARGINS: Final[dict[str, Callable[[np.random.Generator, int, Floats, float], Margin]]] = {
    "smooth": _smooth,
    "disjoint": _disjoint,
    "interaction-only": _interaction_only,
    "discontinuous": _discontinuous,
    "hidden mode": _hidden_mode,
    "partly undefined": _smooth,
    "band": _band,
    "worst of three": _worst_of_three,
    "waves": _waves,
    "saturated": _saturated,
}
