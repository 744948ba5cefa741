"""Curves between 0 and 1 that rise or fall where the data do, with a confidence band over whole places.

The axis is cut into bins with about equally many rows, each seen from several places. Three shapes are fitted to the bins: a
*level*, the best *rising* or *falling* one (isotonic regression: Barlow et al. 1972, *Statistical Inference under Order
Restrictions*), and the bins' own averages, *free*. Cross-validation over whole places chooses: *free* where it predicts
best, a level where it predicts as well as the monotone fit (within one standard error: Breiman et al. 1984, section 3.4.3).
If the bins contradict a shape, the next one is tried.

Where the choice must not depend on the rows that the band is computed from, other places make it (``choosing``).

The band rests on averages over all ranges of adjacent bins, with simultaneous intervals. At every x, a rising curve is
above the lower end of each average to its left and below the upper end of each average to its right (compare Dümbgen 2003,
doi:10.3150/bj/1065444813). So the band is valid for cliffs as well as slopes and needs no smoothness. A level may rise or
fall a little: its band is the union of both bands. The band of a free curve is that of the bins' averages.

Where neighbouring places of one site are alike, apart from what the axis explains, none of these intervals hold: then there is no
band, and no change is proven (`valerie.statistics.neighbours`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, stdtrit

from valerie.errors import InvalidInput
from valerie.statistics.intervals import is_piled
from valerie.statistics.neighbours import alike
from valerie.statistics.observations import coordinates, dense

#: Most bins, and the smallest effective number of places in each.
MAX_BINS: Final = 12
PLACES_PER_BIN: Final = 4.0
#: Places behind each knot of the curve that is taken from the places before their likeness is tested.
_PLACES_PER_KNOT: Final = 10
#: Folds of whole places.
FOLDS: Final = 10
#: Points at which a curve is evaluated.
GRID: Final = 61
#: More places than this are put into groups at random; the variance stays right, memory stays bounded.
_MOST_GROUPS: Final = 500
#: Random weight vectors behind a simultaneous interval.
_DRAWS: Final = 500


class Shape(StrEnum):
    LEVEL = "level"
    RISING = "rising"
    FALLING = "falling"
    FREE = "free"


@dataclass(frozen=True, slots=True)
class CurveBins:
    """Averages along the axis.

    Attributes:
        low, high: smallest and largest x of each bin.
        centre: mean x of its rows.
        mean: mean value of its rows.
        rows: number of rows.
        places: effective number of places: (Σn)² / Σn² of the places' rows.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    centre: tuple[float, ...]
    mean: tuple[float, ...]
    rows: tuple[int, ...]
    places: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Curve:
    """A fitted curve.

    Attributes:
        shape: the simplest that the data allow.
        x: `GRID` points from the smallest to the largest x.
        y: the curve there.
        low, high: the band; with the stated confidence it holds the true curve at all x together. Empty where places are alike.
        bins: the averages that it was fitted to.
        places, rows: numbers of places and rows.
        undefined: number of rows left out.
    """

    shape: Shape
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    bins: CurveBins
    places: int
    rows: int
    undefined: int


def fit_curve(
    x: ArrayLike,
    values: ArrayLike,
    places: ArrayLike,
    *,
    seed: int,
    confidence: float = 0.95,
    choosing: NDArray[np.bool_] | None = None,
    positions: NDArray[np.float64] | None = None,
) -> Curve | None:
    """Fit values over x.

    Args:
        x: (N,); rows without a finite number are left out.
        values: (N,) scores in 0…1; likewise.
        places: (N,) whole numbers, the independent unit of each row.
        seed: of folds and random weights.
        confidence: that the whole band holds.
        choosing: (N,) bool, rows of the places that choose the shape; curve and band are those of all other rows. None: all
            rows serve both purposes.
        positions: (N, D) coordinates, equal within a place, where the places are listed on one site; None where they are drawn.

    Returns:
        The curve; None with too few places for two bins.

    Raises:
        InvalidInput: a value lies outside 0…1, or the lengths differ.
    """
    scores = np.asarray(values, np.float64)
    data = _sums(x, scores if choosing is None else np.where(choosing, np.nan, scores), places, seed)
    choice = data if choosing is None else _sums(x, np.where(choosing, scores, np.nan), places, seed)
    if data is None or choice is None or min(data.count.shape[1], choice.count.shape[1]) < 2:
        return None
    fits = {shape: data.fit(shape) for shape in Shape}
    alone = _Band(data, True, confidence, seed)

    grid = np.linspace(data.low[0], data.high[-1], GRID)

    def stands(shape: Shape) -> bool:
        drawn = np.interp(data.along, grid, np.interp(grid, data.centre, fits[shape]))
        return shape is Shape.FREE or not alone.leaves_out(data.averages(drawn)).any()

    shape = next(shape for shape in _by_simplicity(choice, seed) if stands(shape))
    everything = data if choosing is None else _sums(x, scores, places, seed)
    assert everything is not None, "there are no fewer rows than in a half"
    together = _alike(everything, values, places, positions)
    band = alone if shape is Shape.FREE else _Band(data, False, confidence, seed)
    if shape is Shape.FREE:
        bin_of = np.searchsorted(data.low[1:], grid, side="right")
        y, low, high = data.mean[bin_of], band.low[bin_of, bin_of], band.high[bin_of, bin_of]
    else:
        y = np.interp(grid, data.centre, fits[shape])
        directions = (True, False) if shape is Shape.LEVEL else (shape is Shape.RISING,)
        sides = [band.monotone(grid, rising=rising) for rising in directions]
        low, high = np.min([side[0] for side in sides], axis=0), np.max([side[1] for side in sides], axis=0)
    return Curve(
        shape,
        tuple(grid.tolist()),
        tuple(y.tolist()),
        () if together else tuple(np.minimum(low, y).tolist()),
        () if together else tuple(np.maximum(high, y).tolist()),
        data.averaged(),
        data.places,
        int(data.rows.sum()),
        data.undefined,
    )


@dataclass(frozen=True, slots=True)
class Changes:
    """Changes along an axis, whatever the shape of the curve.

    Attributes:
        difference: average of the last third of the rows along the axis less that of the first third.
        low, high: its interval by Student's t over places; of piled scores, with an unseen place on either side.
        falls, rises: True if simultaneous intervals prove that the average over some range of bins is below (above) that of
            a range before it.
        most: largest difference between the averages of two bins that the intervals allow.
        bins: the averages.
        places: number of places.
        alike: True if neighbouring places are alike, so that nothing is proven: both intervals are infinite.
    """

    difference: float
    low: float
    high: float
    falls: bool
    rises: bool
    most: float
    bins: CurveBins
    places: int
    alike: bool = False


def proven_changes(
    x: ArrayLike,
    values: ArrayLike,
    places: ArrayLike,
    *,
    seed: int,
    confidence: float = 0.95,
    positions: NDArray[np.float64] | None = None,
) -> Changes | None:
    """Return the proven falls and rises of values over x.

    Nothing is chosen, so the same rows may answer.

    Args:
        x, values, places, seed, positions: as of `fit_curve`.
        confidence: of the difference, and that no proven change is wrong.

    Returns:
        The changes; None with too few places for two bins.
    """
    data = _sums(x, values, places, seed)
    if data is None or data.count.shape[1] < 2:
        return None
    difference, low, high = _between_thirds(data, x, values, places, confidence)
    if _alike(data, values, places, positions):
        return Changes(difference, -np.inf, np.inf, False, False, np.inf, data.averaged(), data.places, True)
    ranges, alone = (_Band(data, single, confidence, seed) for single in (False, True))
    # Of all ranges that end at or before a bin, and of all that begin after it.
    low_before, high_before = (
        np.maximum.accumulate(ranges.low.max(axis=0))[:-1],
        np.minimum.accumulate(ranges.high.min(axis=0))[:-1],
    )
    low_after, high_after = (
        np.maximum.accumulate(ranges.low.max(axis=1)[::-1])[::-1][1:],
        np.minimum.accumulate(ranges.high.min(axis=1)[::-1])[::-1][1:],
    )
    return Changes(
        difference,
        low,
        high,
        bool((low_before > high_after).any()),
        bool((high_before < low_after).any()),
        float(alone.high.diagonal().max() - alone.low.diagonal().min()),
        data.averaged(),
        data.places,
    )


def _alike(data: _Sums, values: ArrayLike, places: ArrayLike, positions: NDArray[np.float64] | None) -> bool:
    """Return True if neighbouring places have similar means, apart from a curve that is straight between centres of bins."""
    if positions is None:
        return False
    place, occurring = dense(np.asarray(places)[data.used])
    # With few places per knot the curve would follow the likeness that is to be seen, as along a single row of places.
    knots = min(max(len(occurring) // _PLACES_PER_KNOT, 2), len(data.centre))
    centres = data.centre[np.linspace(0, len(data.centre) - 1, knots).round().astype(np.int64)]
    hats = [np.interp(data.along, centres, knot) for knot in np.eye(knots)]
    columns = np.asarray(values, np.float64)[data.used], *hats
    means = np.stack([np.bincount(place, column) / np.bincount(place) for column in columns], axis=1)
    where = coordinates(positions[data.used], place, len(occurring))
    return bool(alike(means[:, :1], where, means[:, 1:])[0])


def _between_thirds(
    data: _Sums, x: ArrayLike, values: ArrayLike, places: ArrayLike, confidence: float
) -> tuple[float, float, float]:
    """Return the average of the last third of the rows along x less that of the first third, and its interval."""
    along, scores = np.asarray(x, np.float64)[data.used], np.asarray(values, np.float64)[data.used]
    place, occurring = dense(np.asarray(places)[data.used])
    first, last = np.quantile(along, (1 / 3, 2 / 3))
    count, total = np.zeros((2, len(occurring))), np.zeros((2, len(occurring)))
    for k, side in enumerate((along <= first, (along >= last) & (along > first))):
        count[k] = np.bincount(place[side], minlength=len(occurring))
        total[k] = np.bincount(place[side], scores[side], len(occurring))
    count, total = count[:, count.any(axis=0)], total[:, count.any(axis=0)]
    places_behind, rows = count.shape[1], count.sum(axis=1)
    means = total.sum(axis=1) / rows
    difference = float(means[1] - means[0])
    # Leaving out one place at a time (jackknife).
    rest = (total.sum(axis=1)[:, None] - total) / np.maximum(rows[:, None] - count, 1e-9)
    squares = ((rest[1] - rest[0] - difference) ** 2).sum()
    error = float(np.sqrt(squares * (places_behind - 1) / places_behind))
    # Welch's degrees of freedom, at most those of the places.
    effective = rows**2 / (count**2).sum(axis=1)
    own = (((total - means[:, None] * count) / rows[:, None]) ** 2).sum(axis=1)
    welch = own.sum() ** 2 / max((own**2 / np.maximum(effective - 1, 1e-9)).sum(), 1e-300)
    tail = (1 - confidence) / 2
    half = -float(stdtrit(min(max(welch, 0.5), places_behind - 1), tail)) * error
    low, high = difference - half, difference + half
    if is_piled(scores):
        # The largest shift of either mean by one place at 0 or at 1 that was not drawn.
        down, up = np.stack([means, 1 - means]) * (1 - tail ** (1 / effective))
        low, high = min(low, difference - max(down[1], up[0])), max(high, difference + max(up[1], down[0]))
    return difference, float(low), float(high)


@dataclass(frozen=True, slots=True)
class Departure:
    """The x at which a curve leaves the level that it has at the end of its first bin; None if it does not.

    Attributes:
        estimate: x by the curve itself.
        not_before: x up to which the whole band keeps the level; None if the band is too wide to tell.
        at_latest: x by which the whole band has left the level.
    """

    estimate: float | None
    not_before: float | None
    at_latest: float | None


def departure(curve: Curve, by: float) -> Departure:
    """Return where a curve differs by more than ``by`` from its value at the end of its first bin.

    The band contains the whole true curve at once, so bounds derived from it need no further correction.

    Args:
        curve: from `fit_curve`; without a band, neither bound is known.
        by: difference of scores, above 0.
    """
    # A band has no upper (or lower) bound before its first bin ends.
    start = min(int(np.searchsorted(curve.x, curve.bins.high[0])), len(curve.x) - 1)
    x, y = (np.asarray(column)[start:] for column in (curve.x, curve.y))
    away = np.abs(y - y[0]) > by
    if not curve.low:
        return Departure(float(x[int(np.argmax(away))]) if away.any() else None, None, None)
    low, high = (np.asarray(column)[start:] for column in (curve.low, curve.high))
    possible = (low < high[0] - by) | (high > low[0] + by)
    sure = (high < low[0] - by) | (low > high[0] + by)

    def first(marks: NDArray[np.bool_]) -> float | None:
        return float(x[int(np.argmax(marks))]) if marks.any() else None

    not_before = first(possible) if possible.any() else float(x[-1])
    return Departure(first(away), None if possible[0] else not_before, first(sure))


def contradicted_bins(
    fitted: ArrayLike, x: ArrayLike, values: ArrayLike, places: ArrayLike, *, seed: int = 0
) -> tuple[int, ...]:
    """Return the bins of x whose average any curve, such as a polynomial, misses by more than chance.

    With 95 % probability, no bin contradicts a true curve.

    Args:
        fitted: (N,) the curve at each row's x.
        x, values, places, seed: as for `fit_curve`.
    """
    data = _sums(x, values, places, seed)
    if data is None:
        return ()
    averages = data.averages(np.asarray(fitted, np.float64)[data.used])
    return tuple(np.flatnonzero(_Band(data, True, 0.95, seed).leaves_out(averages)).tolist())


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Sums by group of places and by bin, from which every shape is fitted.

    Attributes:
        total, count: (G, B) sum of values and number of rows.
        low, high, centre, mean, rows, seen_from: (B,) of the bins, as in `Bins`; ``seen_from`` is `Bins.places`.
        places: number of places.
        undefined: number of rows left out.
        used: (N,) bool, rows of the caller that count.
        along, bin_of: (M,) x and bin of these rows.
    """

    total: NDArray[np.float64]
    count: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    centre: NDArray[np.float64]
    mean: NDArray[np.float64]
    rows: NDArray[np.int64]
    seen_from: NDArray[np.float64]
    places: int
    undefined: int
    used: NDArray[np.bool_]
    along: NDArray[np.float64]
    bin_of: NDArray[np.int64]

    def fit(self, shape: Shape) -> NDArray[np.float64]:
        """Return the (B,) values of a shape at the bins."""
        return _fit(shape, self.total.sum(axis=0), self.count.sum(axis=0))

    def averaged(self) -> CurveBins:
        """Return the bins' own averages."""
        columns = (self.low, self.high, self.centre, self.mean, self.rows, self.seen_from)
        low, high, centre, mean, rows, places = (tuple(column.tolist()) for column in columns)
        return CurveBins(low, high, centre, mean, rows, places)

    def averages(self, drawn: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (B,) means over the bins of a curve's values at the (M,) rows."""
        return np.asarray(np.bincount(self.bin_of, weights=drawn) / self.rows)


def _sums(x: ArrayLike, values: ArrayLike, places: ArrayLike, seed: int) -> _Sums | None:
    along, scores, codes = np.asarray(x, np.float64), np.asarray(values, np.float64), np.asarray(places)
    if not along.shape == scores.shape == codes.shape:
        raise InvalidInput("x, values and places differ in length", field="x", value=along.shape, limit=scores.shape)
    known = np.isfinite(along) & np.isfinite(scores)
    along, scores = along[known], scores[known]
    if len(scores) and (scores.min() < 0 or scores.max() > 1):
        raise InvalidInput(
            "has to lie between 0 and 1", field="values", value=float(scores[(scores < 0) | (scores > 1)][0])
        )
    place, occurring = dense(codes[known])
    groups = min(len(occurring), _MOST_GROUPS)
    if groups < 2:
        return None
    if groups < len(occurring):
        place = (np.random.default_rng(seed).permutation(len(occurring)) % groups)[place]
    for bins in range(MAX_BINS, 0, -1):
        edges = np.unique(np.quantile(along, np.arange(1, bins) / bins))
        bin_of = np.searchsorted(edges, along, side="right")
        bin_of, filled = dense(bin_of)
        cell, size = place * len(filled) + bin_of, groups * len(filled)
        count = np.bincount(cell, minlength=size).reshape(groups, -1).astype(np.float64)
        seen_from = count.sum(axis=0) ** 2 / (count**2).sum(axis=0)
        if seen_from.min() >= PLACES_PER_BIN:
            break
    total = np.bincount(cell, weights=scores, minlength=size).reshape(groups, -1).astype(np.float64)
    rows = count.sum(axis=0)
    order = np.argsort(along, kind="stable")
    ends = np.cumsum(rows).astype(np.int64)
    return _Sums(
        total,
        count,
        along[order[ends - rows.astype(np.int64)]],
        along[order[ends - 1]],
        np.bincount(bin_of, weights=along) / rows,
        total.sum(axis=0) / rows,
        rows.astype(np.int64),
        seen_from,
        len(occurring),
        int(np.count_nonzero(~known)),
        known,
        along,
        bin_of,
    )


def _fit(shape: Shape, total: NDArray[np.float64], count: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of a shape at the bins, from sums and numbers of rows; bins without rows are interpolated."""
    from scipy.optimize import isotonic_regression

    filled = np.flatnonzero(count)
    mean, weight = total[filled] / count[filled], count[filled]
    if shape is Shape.LEVEL:
        mean = np.full(len(filled), total.sum() / count.sum())
    elif shape is not Shape.FREE:
        mean = isotonic_regression(mean, weights=weight, increasing=shape is Shape.RISING).x
    return np.asarray(np.interp(np.arange(len(count)), filled, mean))


def _by_simplicity(data: _Sums, seed: int) -> list[Shape]:
    """Return the shapes that predict held-out places as well as the best one, simplest first, *free* at the end."""
    groups = len(data.total)
    folds = min(FOLDS, groups)
    fold_of = np.random.default_rng(seed).permutation(groups) % folds
    member = (fold_of == np.arange(folds)[:, None]).astype(np.float64)
    total, count = member @ data.total, member @ data.count
    losses = {}
    for shape in Shape:
        fits = np.stack(
            [
                _fit(shape, data.total.sum(axis=0) - t, data.count.sum(axis=0) - n)
                for t, n in zip(total, count, strict=True)
            ]
        )
        # Σ (y − f)² less Σ y², which all shapes share.
        losses[shape] = (fits**2 * count - 2 * fits * total).sum(axis=1) / count.sum(axis=1)
    mean = {shape: float(losses[shape].mean()) for shape in Shape}
    monotone = min((Shape.RISING, Shape.FALLING), key=mean.__getitem__)
    if mean[Shape.FREE] < min(mean[Shape.LEVEL], mean[monotone]):
        return [Shape.FREE]
    excess = losses[Shape.LEVEL] - losses[monotone]
    level = float(excess.mean()) <= float(excess.std(ddof=1)) / np.sqrt(folds)
    return [*([Shape.LEVEL] if level else []), monotone, Shape.FREE]


def _errors(total: NDArray[np.float64], count: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return standard errors and degrees of freedom of the ratios Σ total / Σ count over groups, from their residuals."""
    rows = count.sum(axis=0)
    effective = rows**2 / (count**2).sum(axis=0)
    residual = total - total.sum(axis=0) / rows * count
    variance = (residual**2).sum(axis=0) / rows**2 * effective / np.maximum(effective - 1, 1e-9)
    return np.sqrt(variance), np.maximum(effective - 1, 0.5)


class _Band:
    """Simultaneous intervals of the averages over ranges of adjacent bins.

    Attributes:
        low, high: (B, B) ends of the interval of bins a…b at [a, b]; −inf and inf for b < a.
    """

    def __init__(self, data: _Sums, single: bool, confidence: float, seed: int) -> None:
        """Args:
        data: sums by group and bin.
        single: True to use single bins only.
        confidence: that all intervals hold.
        seed: of the random weights.
        """
        bins = len(data.mean)
        first, last = (np.arange(bins),) * 2 if single else np.triu_indices(bins)
        total, count = (
            np.concatenate([np.zeros((len(column), 1)), np.cumsum(column, axis=1)], axis=1)
            for column in (data.total, data.count)
        )
        total, count = total[:, last + 1] - total[:, first], count[:, last + 1] - count[:, first]
        mean = total.sum(axis=0) / count.sum(axis=0)
        error, degrees = _errors(total, count)
        tail = _joint_tail(total - mean * count, confidence, seed)
        half = -stdtrit(degrees, tail) * error
        # The largest shift by one place at 0 or at 1 that was not drawn.
        unseen = 1 - tail ** (1 / (degrees + 1))
        self.low, self.high = np.full((bins, bins), -np.inf), np.full((bins, bins), np.inf)
        self.low[first, last] = np.clip(np.minimum(mean - half, (1 - unseen) * mean), 0, 1)
        self.high[first, last] = np.clip(np.maximum(mean + half, mean + unseen * (1 - mean)), 0, 1)
        self._edges = data.low, data.high

    def leaves_out(self, fitted: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (B,) bool, True where a fitted value is outside the interval of its bin."""
        return np.asarray((fitted < self.low.diagonal() - 1e-9) | (fitted > self.high.diagonal() + 1e-9))

    def monotone(self, x: NDArray[np.float64], *, rising: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the lower and upper band at ``x`` of a rising (or falling) curve."""
        left, right = self._edges
        # The tightest bound by averages that end at or before bin b, or begin at or after bin a.
        if rising:
            before, after = (
                np.maximum.accumulate(self.low.max(axis=0)),
                np.minimum.accumulate(self.high.min(axis=1)[::-1])[::-1],
            )
        else:
            before, after = (
                np.minimum.accumulate(self.high.min(axis=0)),
                np.maximum.accumulate(self.low.max(axis=1)[::-1])[::-1],
            )
        ended = np.searchsorted(right, x, side="right")
        begins = np.searchsorted(left, x, side="left")
        worst = (0.0, 1.0) if rising else (1.0, 0.0)
        bounds = np.concatenate([[worst[0]], before])[ended], np.concatenate([after, [worst[1]]])[begins]
        return bounds if rising else bounds[::-1]


def _joint_tail(residual: NDArray[np.float64], confidence: float, seed: int) -> float:
    """Return the tail probability per side at which M intervals hold simultaneously.

    The largest of the M standardised means is simulated with random normal weights of the groups (multiplier bootstrap:
    Chernozhukov, Chetverikov & Kato 2013, doi:10.1214/13-AOS1161).

    Args:
        residual: (G, M) contribution of each group to the deviation of each mean.
        confidence: that all intervals hold.
        seed: of the weights.
    """
    size = np.sqrt((residual**2).sum(axis=0))
    spread = size > 1e-12
    if not spread.any():
        return (1 - confidence) / 2 / len(size)
    weights = np.random.default_rng(seed).standard_normal((_DRAWS, len(residual)))
    largest = np.abs(weights @ (residual[:, spread] / size[spread])).max(axis=1)
    return max(1 - float(ndtr(np.quantile(largest, confidence))), (1 - confidence) / 2 / len(size))
