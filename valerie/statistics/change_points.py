"""Change points: where scores along an axis begin to fall or rise.

The model is a broken line, y = a + d·x + b·(x − c)₊ + error, fitted by least squares over a grid of c. If c₀ is the true
change point, the derivative of the line by c, which is a step at c₀, explains nothing more. The interval is therefore the
hull of all c₀ at which a t-test of that step does not reject (score test: Muggeo 2017, doi:10.1111/anzs.12200). Its error
is that of whole places (cluster jackknife, CR3: Bell and McCaffrey 2002, *Survey Methodology* 28, 169–181), so that rows of
one place count as one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from valerie.errors import InvalidInput
from valerie.statistics.observations import dense

#: Fewest places for an interval.
MIN_PLACES: Final = 8
#: Points at which a change is looked for, between these quantiles of x.
_GRID: Final = 60
_ENDS: Final = (0.05, 0.95)
#: Largest number of jackknifed groups; more places are put into groups at random.
_MOST_GROUPS: Final = 200


@dataclass(frozen=True, slots=True)
class Slope:
    """A slope with its interval, in score per unit of x."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class ChangePoint:
    """A broken line.

    Attributes:
        at: x of the best change point.
        low, high: interval of it; the whole searched range where the data show no change.
        before, after: slopes on both sides of ``at``.
        level: the line's value at the smallest x.
        bends: True if the interval leaves out a part of the searched range, so that there is a change to be placed.
        places: number of places; ``rows`` is that of rows.
    """

    at: float
    low: float
    high: float
    before: Slope
    after: Slope
    level: float
    bends: bool
    places: int
    rows: int


def change_point(
    x: ArrayLike, values: ArrayLike, places: ArrayLike, *, seed: int = 0, confidence: float = 0.95
) -> ChangePoint | None:
    """Find the change point of values over x.

    Args:
        x: (N,); rows with a gap are left out.
        values: (N,); the same.
        places: (N,) whole numbers, the independent unit of each row.
        seed: of the groups of places.
        confidence: of the interval and of both slopes, each.

    Returns:
        None for fewer than `MIN_PLACES` places, or where x does not vary.

    Raises:
        InvalidInput: the lengths differ.
    """
    axis, score, unit = (np.asarray(column, np.float64) for column in (x, values, places))
    if not axis.shape == score.shape == unit.shape:
        raise InvalidInput("x, values and places differ in length", field="values", value=score.shape, limit=axis.shape)
    known = np.isfinite(axis) & np.isfinite(score)
    axis, score, group = axis[known], score[known], dense(unit[known].astype(np.int64))[0]
    number = int(group.max(initial=-1)) + 1
    if number < MIN_PLACES or np.ptp(axis) == 0:
        return None
    if number > _MOST_GROUPS:
        group = (np.random.default_rng(seed).permutation(number) % _MOST_GROUPS)[group]
    start, scale = float(axis.min()), float(np.ptp(axis))
    axis = (axis - start) / scale
    grid = np.unique(np.quantile(axis, np.linspace(*_ENDS, _GRID)))
    grid = grid[(grid > 0) & (grid < 1)]
    t = float(stdtrit(min(number, _MOST_GROUPS) - 1, 0.5 + confidence / 2))
    steps = [_Fit(axis, score, group, c, step=True) for c in grid.tolist()]
    lines = [_Fit(axis, score, group, c, step=False) for c in grid.tolist()]
    best = int(np.argmin([line.squares for line in lines]))
    kept = np.array([abs(step.estimate[3]) <= t * step.error[3] for step in steps])
    kept[best] = True
    line = lines[best]
    inside = grid[kept]
    return ChangePoint(
        at=start + scale * float(grid[best]),
        low=start + scale * float(inside[0]),
        high=start + scale * float(inside[-1]),
        before=line.slope(np.array([0.0, 1.0, 0.0]), t, scale),
        after=line.slope(np.array([0.0, 1.0, 1.0]), t, scale),
        level=float(line.estimate[0]),
        bends=bool(inside[0] > grid[0] or inside[-1] < grid[-1]),
        places=number,
        rows=len(axis),
    )


class _Fit:
    """Least squares with the line broken at c, and jackknife errors by group.

    Attributes:
        estimate: (3,) intercept, slope, change of slope; with ``step``, (4,) the step at c too.
        covariance: of ``estimate``; ``error`` is the root of its diagonal.
        squares: residual sum of squares.
    """

    def __init__(
        self, x: NDArray[np.float64], y: NDArray[np.float64], group: NDArray[np.int64], c: float, *, step: bool
    ) -> None:
        columns = [np.ones_like(x), x, np.maximum(x - c, 0.0)]
        if step:
            columns.append((x > c).astype(np.float64))
        design = np.stack(columns, axis=1)
        groups, width = int(group.max()) + 1, design.shape[1]
        products = np.empty((groups, width, width))
        for i in range(width):
            for j in range(i, width):
                products[:, i, j] = products[:, j, i] = np.bincount(group, design[:, i] * design[:, j], groups)
        scores = np.stack([np.bincount(group, design[:, i] * y, groups) for i in range(width)], axis=1)
        gram, moment = products.sum(axis=0), scores.sum(axis=0)
        # A ridge far below any term keeps a sample that lacks one side of c solvable.
        ridge = 1e-9 * np.trace(gram) * np.eye(width)
        self.estimate = np.linalg.solve(gram + ridge, moment)
        self.squares = float(((y - design @ self.estimate) ** 2).sum())
        spread = np.linalg.solve(gram - products + ridge, (moment - scores)[..., None])[..., 0] - self.estimate
        self.covariance = (groups - 1) / groups * spread.T @ spread
        self.error = np.sqrt(np.diag(self.covariance))

    def slope(self, weights: NDArray[np.float64], t: float, scale: float) -> Slope:
        estimate = float(weights @ self.estimate) / scale
        half = t * float(np.sqrt(weights @ self.covariance @ weights)) / scale
        return Slope(estimate, estimate - half, estimate + half)
