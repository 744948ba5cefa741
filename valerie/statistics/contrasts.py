"""Blocked contrasts: one factor changes, everything else stays equal.

A factor that changes within places (sun, character, camera, function, version) is compared row by row: rows that agree in
place and in all other factors form a *block*, and a contrast is the mean over places of the mean difference within its blocks.
A factor that changes only from place to place (a person's position, or every factor of a design that draws each variant)
is compared between the places' means, in a linear model with all such factors, so that the others stay equal too. Contrasts
are always between two levels: where the factor has no effect, exchanging them changes nothing, so the difference is
symmetric about 0 and Student's t keeps its level for scores that are bounded, pile up or have heavy tails (Efron 1969,
doi:10.1080/01621459.1969.10501056).

Where the factor has an effect, nothing makes the differences symmetric: it may be large at few places, of which few places
show none. Intervals therefore allow for one unseen place (`valerie.statistics.unseen`), whose difference may be further
from the mean by as much as a score may be from the mean score. Those of a difference between places combine the intervals of
both sides (Zou and Donner 2008, doi:10.1002/sim.3095).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from itertools import combinations
from math import prod
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.statistics.intervals import MIN_UNITS
from valerie.statistics.neighbours import alike
from valerie.statistics.observations import Observations, dense
from valerie.statistics.power import smallest
from valerie.statistics.unseen import Figures, reach

#: Rows are compared in blocks when at least this share of all combinations occurs. This also bounds memory.
_FILLED: Final = 0.1
#: Residual degrees of freedom below which the other factors of places are left out of the model.
_FEWEST_DEGREES: Final = 3
#: A standard error below this is 0 but for rounding.
_NO_SPREAD: Final = 1e-12


class Matching(StrEnum):
    """Rule by which the two sides of a contrast are matched."""

    #: The sides agree in place and in all other factors.
    BLOCKS = "blocks"
    #: The sides agree in place.
    PLACES = "places"
    #: The sides are at different places; a linear model has the other factors.
    MODEL = "model"


@dataclass(frozen=True, slots=True)
class Change:
    """A factor going from one level to another, as the caller's codes."""

    factor: str
    before: int
    after: int


@dataclass(frozen=True, slots=True)
class Contrast:
    """A difference of means with its standard error.

    Attributes:
        changes: one change for a main effect; two for an interaction, whose estimate is the effect of the first change
            after the second one minus its effect before.
        matching: rule by which the sides are matched.
        estimate: mean after − mean before, in units of the values; each place weighs the same.
        error: its standard error.
        degrees: degrees of freedom of the error; 0 if it cannot be estimated.
        p_value: two-sided, not adjusted for other contrasts; 1 if the error cannot be estimated.
        places: number of places behind the estimate.
        pairs: pairs of rows (groups of four for an interaction) that differ only in the changes.
        parameters: coefficients that the places determine besides the spread.
        figures: of the places whose mean is the estimate; or of the places on both sides, before and after.
        alike: True if neighbouring places of one site have more similar figures than independent ones
            (`valerie.statistics.neighbours`), so that error and p-value are too small. Then there is no interval.
    """

    changes: tuple[Change, ...]
    matching: Matching
    estimate: float
    error: float
    degrees: float
    p_value: float
    places: int
    pairs: int
    parameters: int
    figures: tuple[Figures, ...] = field(compare=False)
    alike: bool = False

    @property
    def deviation(self) -> float:
        """Standard deviation of one place's contribution to the estimate: error × √places."""
        return self.error * float(np.sqrt(self.places))

    @property
    def reversed(self) -> Contrast:
        """A main effect from its second level to the first."""
        (change,) = self.changes
        figures = tuple(side.mirrored for side in self.figures) if len(self.figures) == 1 else self.figures[::-1]
        return replace(
            self,
            changes=(Change(change.factor, change.after, change.before),),
            estimate=-self.estimate,
            figures=figures,
        )

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the interval with confidence ``level``; infinite from fewer than `MIN_UNITS` places, or alike ones."""
        if self.places < MIN_UNITS or not self.degrees or self.alike:
            return -float("inf"), float("inf")
        return self._interval(level, 1.0)

    def excludes_0(self, level: float, times: float = 1.0) -> bool:
        """Return True if the interval, of ``times`` as many places, does not contain 0."""
        if self.places * times < MIN_UNITS or not self.degrees or self.alike:
            return False
        low, high = self._interval(level, times)
        return low > 0 or high < 0

    def places_for_interval(self, level: float) -> int | None:
        """Return the number of places like these with which the interval excludes 0; None above `MAX_PLACES`."""
        return smallest(lambda places: self.excludes_0(level, places / self.places), MIN_UNITS)

    def _interval(self, level: float, times: float) -> tuple[float, float]:
        """Return the interval with the places repeated."""
        ends = [side.interval((1 - level) / 2, times) for side in self.figures]
        if len(ends) == 1:
            return ends[0]
        (before_low, before_high), (after_low, after_high) = ends
        before, after = (side.mean for side in self.figures)
        return (
            self.estimate - float(np.hypot(after - after_low, before_high - before)),
            self.estimate + float(np.hypot(after_high - after, before - before_low)),
        )


def contrasts(
    observations: Observations, *, interactions: bool = True, only: Sequence[tuple[Change, ...]] | None = None
) -> tuple[Contrast, ...]:
    """Compare every two levels of every factor and, as interactions, every two such differences.

    Args:
        observations: the rows.
        interactions: True to compare differences too: of two factors that change within places, or of one that does
            and one that changes from place to place.
        only: the changes to test, in this order; those that the rows cannot show are left out.

    Returns:
        Main effects first, in the order of the factors.
    """
    family = _Family(observations)
    if only is None:
        return tuple(family.all(interactions))
    factors = {change.factor for changes in only for change in changes}
    computed = {item.changes: item for item in family.all(any(len(changes) > 1 for changes in only), factors)}
    return tuple(computed[changes] for changes in only if changes in computed)


def largest_flips(observations: Observations, contrast: Contrast, count: int = 5) -> NDArray[np.int64]:
    """Return the pairs of rows with the largest differences in the direction of the contrast.

    Of several rows with equal levels, the last one is used.

    Args:
        observations: the rows that the contrast was computed from.
        contrast: a main effect or an interaction.
        count: the largest number of pairs.

    Returns:
        (K, 2) rows of the caller's arrays, before and after, largest difference first; (K, 4) for an interaction: before
        and after the first change, first before and then after the second. Empty if no rows differ only in the changes.
    """
    names = [change.factor for change in contrast.changes]
    family = _Family(observations)
    index, shape = family.cells_of(names, contrast.matching)
    crossed = contrast.matching is not Matching.MODEL or family.grid is not None
    if not crossed or prod(shape) > len(observations.values) / _FILLED:
        return np.zeros((0, 2 * len(names)), np.int64)
    row = np.full(prod(shape), -1)
    row[index] = np.arange(len(observations.values))
    sides = np.moveaxis(row.reshape(shape), range(1, 1 + len(names)), range(len(names)))
    for change in contrast.changes:
        # Each change takes the next axis of levels to the end, as before and after.
        ends = np.searchsorted(observations.levels[change.factor], [change.before, change.after])
        sides = np.moveaxis(sides[ends], 0, -1)
    # Before and after the first change vary fastest.
    corners = np.swapaxes(sides, -1, -len(names)).reshape(-1, 2 * len(names))
    corners = corners[(corners >= 0).all(axis=1)]
    signs = np.array([-1.0, 1.0] if len(names) == 1 else [1.0, -1.0, -1.0, 1.0])
    difference = np.sign(contrast.estimate) * (observations.values[corners] @ signs)
    order = np.argsort(-difference, kind="stable")[:count]
    return np.asarray(observations.rows[corners[order[difference[order] > 0]]])


class _Family:
    """All contrasts of some rows, place by place."""

    def __init__(self, observations: Observations) -> None:
        self.observations = observations
        varied = [name for name, levels in observations.levels.items() if len(levels) > 1]
        self.level_of_place: dict[str, NDArray[np.int64]] = {}
        for name in varied:
            codes = observations.factors[name]
            of_place = np.zeros(observations.places, np.int64)
            of_place[observations.place] = codes
            if np.array_equal(of_place[observations.place], codes):
                self.level_of_place[name] = of_place
        self._models: dict[tuple[str, bytes], _Model] = {}
        self.within = [name for name in varied if name not in self.level_of_place]
        self._reach = reach(observations.values)
        self.grid = _table(observations, (*self.level_of_place, *self.within)) if self.level_of_place else None

    def all(self, interactions: bool, wanted: set[str] | None = None) -> Iterator[Contrast]:
        """Yield main effects, then interactions, of the ``wanted`` factors (None: all)."""

        def asked(*names: str) -> bool:
            return wanted is None or wanted.issuperset(names)

        differences = {}
        for name in self.observations.levels:
            if name in self.within and asked(name):
                matching, cells = self._changes(name)
                differences[name], pairs = _by_place(cells)
                singles = [(change,) for change in self._changes_of(name)]
                yield from self._averages(singles, matching, differences[name], pairs)
            elif name in self.level_of_place and asked(name):
                yield from self._between([], self._place_means()[:, None], name)
        if not interactions:
            return
        for first, second in combinations(self.within, 2):
            if asked(first, second):
                matching, cells = self._double_changes(first, second)
                doubles = [(x, y) for x in self._changes_of(first) for y in self._changes_of(second)]
                yield from self._averages(doubles, matching, *_by_place(cells))
        for first, figures in differences.items():
            for second in self.level_of_place:
                if asked(first, second):
                    yield from self._between(self._changes_of(first), figures, second)

    def cells_of(self, names: Sequence[str], matching: Matching) -> tuple[NDArray[np.int64], tuple[int, ...]]:
        """Return the (N,) cell of each row and the shape of the table of cells.

        The axes are the place (of size 1 for a model), the named factors, and the combinations of all other factors that occur.
        """
        others: list[str] = []
        if matching is not Matching.PLACES:
            others = [name for name in self.within if name not in names]
        if matching is Matching.MODEL:
            others += [name for name in self.level_of_place if name not in names]
        rest, occurring = dense(_index(self.observations, others))
        front = (None, *names) if matching is not Matching.MODEL else tuple(names)
        shape = (*((1,) if matching is Matching.MODEL else ()), *_shape(self.observations, front), len(occurring))
        return _index(self.observations, front) * len(occurring) + rest, shape

    def _changes_of(self, name: str) -> list[Change]:
        return [Change(name, int(a), int(b)) for a, b in combinations(self.observations.levels[name], 2)]

    def _place_means(self) -> NDArray[np.float64]:
        """Return the (G,) mean of each place; where rows form blocks, of their differences from the same cells elsewhere."""
        data = self.observations
        cells = _means(data.values, *self.cells_of((), Matching.BLOCKS))
        if cells is None or not self.within:
            return np.asarray(np.bincount(data.place, weights=data.values) / np.bincount(data.place))
        usual = np.nanmean(cells, axis=0)
        # Otherwise a place whose hard rows are missing would look easy.
        return np.asarray(np.nanmean(cells - usual, axis=1) + usual.mean())

    def _cells(self, names: Sequence[str]) -> tuple[NDArray[np.float64], Matching]:
        """Return (G, L…, C) cell means: places, levels of the named factors, combinations of all others."""
        for matching in (Matching.BLOCKS, Matching.PLACES):
            index, shape = self.cells_of(names, matching)
            cells = _means(self.observations.values, index, shape)
            if cells is not None:
                return cells, matching
        return np.full(shape, np.nan), Matching.PLACES

    def _changes(self, name: str) -> tuple[Matching, NDArray[np.float64]]:
        """Return (G, S, C) differences of the cells for each change of a factor."""
        cells, matching = self._cells([name])
        before, after = _level_pairs(cells.shape[1])
        return matching, cells[:, after] - cells[:, before]

    def _double_changes(self, first: str, second: str) -> tuple[Matching, NDArray[np.float64]]:
        """Return (G, S, C) differences of differences of the cells for each pair of changes of two factors."""
        cells, matching = self._cells([first, second])
        a, b = _level_pairs(cells.shape[1])
        c, d = _level_pairs(cells.shape[2])
        differences = cells[:, b] - cells[:, a]
        doubled = differences[:, :, d] - differences[:, :, c]
        return matching, doubled.reshape(len(cells), len(a) * len(c), -1)

    def _between(self, firsts: Sequence[Change], figures: NDArray[np.float64], name: str) -> Iterator[Contrast]:
        """Compare (G, S) figures of the places between the levels of a factor that changes from place to place.

        Args:
            firsts: the S changes that the figures are differences of; none if they are the places' means.
            figures: NaN where a place has none.
            name: the factor.
        """
        seconds = self._changes_of(name)
        before, after = _level_pairs(len(self.observations.levels[name]))
        pairs = self._matched(firsts[0].factor if firsts else None, name)
        known = np.isfinite(figures)
        batches = [slice(None)] if known.all() else [slice(k, k + 1) for k in range(figures.shape[1])]
        for batch in batches:
            rows = np.asarray(known[:, batch].all(axis=1))
            model = self._model(name, rows)
            *columns, sides = model.compare(figures[rows, batch], before, after, self._reach if firsts else None)
            together = self._alike(figures[rows, batch], rows, model.design)
            first = range(figures.shape[1])[batch]
            for s, k in enumerate(first):
                rest = (
                    seconds,
                    *(column[:, s].tolist() for column in columns),
                    pairs[k].tolist(),
                    before.tolist(),
                    after.tolist(),
                )
                for second, estimate, error, degrees, p_value, matched, one, other in zip(*rest, strict=True):
                    yield Contrast(
                        (*firsts[k : k + 1], second),
                        Matching.MODEL,
                        estimate,
                        error,
                        degrees,
                        p_value,
                        int(np.count_nonzero(rows)),
                        matched,
                        model.parameters,
                        (sides[s][one], sides[s][other]),
                        bool(together[s]),
                    )

    def _averages(
        self,
        changes: Sequence[tuple[Change, ...]],
        matching: Matching,
        figures: NDArray[np.float64],
        pairs: NDArray[np.int64],
    ) -> Iterator[Contrast]:
        """Compare the mean of (G, S) differences of the places with 0."""
        everywhere = np.ones(len(figures), np.bool_)
        return _averages(changes, matching, figures, pairs, self._reach, self._alike(figures, everywhere))

    def _alike(
        self, figures: NDArray[np.float64], rows: NDArray[np.bool_], fitted: NDArray[np.float64] | None = None
    ) -> NDArray[np.bool_]:
        """Return (S,) bool, True if figures of the places in ``rows`` are alike among neighbours, apart from a fit."""
        if self.observations.positions is None:
            return np.zeros(figures.shape[1], np.bool_)
        return alike(figures, self.observations.positions[rows], fitted, within=fitted is None)

    def _model(self, name: str, rows: NDArray[np.bool_]) -> _Model:
        """Return the model of the places in ``rows`` that compares the levels of a factor."""
        key = name, rows.tobytes()
        if key not in self._models:
            codes = [levels[rows] for levels in self.level_of_place.values()]
            compared = [*self.level_of_place].index(name)
            self._models[key] = _Model(codes, compared, len(self.observations.levels[name]))
        return self._models[key]

    def _matched(self, first: str | None, name: str) -> NDArray[np.int64]:
        """Return (S, T) numbers of pairs (or groups of four) of rows that differ only in the changes."""
        before, after = _level_pairs(len(self.observations.levels[name]))
        axes = [*self.level_of_place, *self.within]
        size = 1 if first is None else len(self._changes_of(first))
        if self.grid is None:
            return np.zeros((size, len(before)), np.int64)
        there = np.isfinite(self.grid)
        front = [axes.index(name)] if first is None else [axes.index(first), axes.index(name)]
        there = np.moveaxis(there, front, range(len(front)))
        there = there.reshape(*there.shape[: len(front)], -1)
        if first is None:
            there = there[None]
        else:
            c, d = _level_pairs(len(there))
            there = there[c] & there[d]
        return np.asarray(np.count_nonzero(there[:, before] & there[:, after], axis=-1))


class _Model:
    """Least squares of the places' figures on an intercept and all factors of places, additive.

    With too few places for all factors, only the compared one enters.

    Attributes:
        design: (G, P) its columns.
        parameters: its rank.
    """

    def __init__(self, codes: Sequence[NDArray[np.int64]], compared: int, levels: int) -> None:
        """Args:
        codes: (G,) level of each place, one array per factor.
        compared: which of the factors is compared.
        levels: number L of its levels.
        """
        self._member = (codes[compared] == np.arange(levels)[:, None]).astype(float)
        others = [(code == np.arange(1, code.max(initial=0) + 1)[:, None]).astype(float) for code in codes]
        del others[compared]
        for columns in ([self._member, *others], [self._member]):
            self.design = np.concatenate(columns).T
            self._inverse = np.linalg.pinv(self.design)
            # The trace of the projection is the rank.
            self.parameters = round(float((self.design * self._inverse.T).sum()))
            self._degrees = len(self.design) - self.parameters
            if self._degrees >= _FEWEST_DEGREES:
                break

    def compare(
        self,
        figures: NDArray[np.float64],
        before: NDArray[np.int64],
        after: NDArray[np.int64],
        furthest: float | None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], list[list[Figures]]]:
        """Compare (G, S) figures between levels.

        Of two errors, the one with the larger p-value counts: that of the common spread of all levels, and that of the two
        levels' own spreads (Welch 1947, doi:10.1093/biomet/34.1-2.28). So a rare outlier in one level never looks like an
        effect.

        Args:
            figures: of the places.
            before, after: (T,) levels.
            furthest: largest distance of an unseen figure from the mean; None: it is a score.

        Returns:
            (T, S) differences, standard errors (infinite where not estimable), degrees of freedom and p-values; and for each of
            the S, the figures at each level with the other factors held equal.
        """
        from scipy.special import binom

        weights = np.zeros((len(before), self.design.shape[1]))
        t = np.arange(len(before))
        weights[t, before], weights[t, after] = -1, 1
        of_places = weights @ self._inverse
        solved = self._inverse @ figures
        residuals = figures - self.design @ solved
        squares = residuals**2
        count = self._member.sum(axis=1)
        estimable = (count[before] > 1) & (count[after] > 1) & (self._degrees > 0)
        estimable &= np.abs(of_places @ self.design - weights).max(axis=1) < 1e-6
        common = squares.sum(axis=0) / max(self._degrees, 1)
        pooled = np.sqrt((of_places**2).sum(axis=1)[:, None] * common)
        # The other factors have used up degrees of freedom in every level alike.
        used = (len(self.design) - np.count_nonzero(count)) / max(self._degrees, 1)
        own = used * (self._member @ squares) / np.maximum(count * (count - 1), 1)[:, None]
        both = own[before] + own[after]
        less = np.maximum(count - 1, 1)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            welch = both**2 / (own[before] ** 2 / less[before] + own[after] ** 2 / less[after])
        welch = np.where(both > 0, welch, 1.0)
        estimates = weights @ solved
        rare = 2 / binom(count[before] + count[after], count[before])
        choices = []
        for error, degrees in ((pooled, np.full_like(pooled, self._degrees)), (np.sqrt(both), welch)):
            error[~estimable] = np.inf
            choices.append((error, degrees, _p_values(estimates, error, degrees, rare[:, None])))
        (error, degrees, p_values), own_choice = choices
        wider = own_choice[2] > p_values
        error, degrees, p_values = (
            np.where(wider, theirs, ours) for ours, theirs in zip((error, degrees, p_values), own_choice, strict=True)
        )
        # The intercept belongs to the model, so the mean of the fit is that of the figures.
        own = solved[: len(count)]
        means = own + (figures.sum(axis=0) - count @ own) / max(len(figures), 1)
        sides = [
            [
                Figures.around(mean + residual[member] * np.sqrt(used), furthest)
                for mean, member in zip(of_levels, self._member > 0, strict=True)
            ]
            for of_levels, residual in zip(means.T.tolist(), residuals.T, strict=True)
        ]
        return estimates, error, np.where(np.isfinite(error), degrees, 0.0), p_values, sides


def _averages(
    changes: Sequence[tuple[Change, ...]],
    matching: Matching,
    figures: NDArray[np.float64],
    pairs: NDArray[np.int64],
    furthest: float,
    together: NDArray[np.bool_],
) -> Iterator[Contrast]:
    """Yield the contrasts of `_Family._averages`; (S,) ``together`` is True if neighbouring places are alike."""
    known = np.isfinite(figures)
    places = known.sum(axis=0)
    filled = np.where(known, figures, 0.0)
    count = np.maximum(places, 1)
    estimates = filled.sum(axis=0) / count
    squares = (np.where(known, figures - estimates, 0.0) ** 2).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.where(places > 1, np.sqrt(squares / (places - 1) / count), np.inf)
    degrees = np.maximum(places - 1, 0).astype(np.float64)
    p_values = _p_values(estimates, errors, degrees, 2.0 ** (1 - places))
    columns = (changes, estimates, errors, degrees, p_values, places, pairs)
    for k, (change, estimate, error, degree, p_value, number, matched) in enumerate(zip(*columns, strict=True)):
        # No place shows both levels, all else equal.
        if not number:
            continue
        yield Contrast(
            change,
            matching,
            float(estimate),
            float(error),
            float(degree),
            float(p_value),
            int(number),
            int(matched),
            1,
            (Figures.around(figures[known[:, k], k], furthest),),
            bool(together[k]),
        )


def _p_values(
    estimates: NDArray[np.float64],
    errors: NDArray[np.float64],
    degrees: NDArray[np.float64],
    without_spread: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return two-sided p-values of Student's t; where the places show no spread, those of exchanging the levels."""
    from scipy.special import stdtr

    flat = errors <= _NO_SPREAD
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(flat, 0.0, np.abs(estimates) / errors)
    p_values = 2 * stdtr(np.maximum(degrees, 1), -t)
    exact = np.where(np.abs(estimates) <= _NO_SPREAD, 1.0, np.minimum(without_spread, 1.0))
    return np.asarray(np.where(np.isfinite(errors), np.where(flat, exact, p_values), 1.0))


def _by_place(cells: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return (G, S) means over the last axis of (G, S, C) differences without NaN, and (S,) numbers of differences."""
    known = np.isfinite(cells)
    if known.all():
        return cells.mean(axis=2), np.full(cells.shape[1], cells.shape[0] * cells.shape[2])
    count = known.sum(axis=2)
    with np.errstate(invalid="ignore"):
        means = np.where(known, cells, 0.0).sum(axis=2) / count
    return means, count.sum(axis=0)


@cache
def _level_pairs(levels: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return every pair of L levels: (S,) the lower and (S,) the higher."""
    before, after = np.triu_indices(levels, 1)
    return before.astype(np.int64), after.astype(np.int64)


def _shape(observations: Observations, axes: Sequence[str | None]) -> tuple[int, ...]:
    """Return the numbers of levels of some factors; None stands for the place."""
    return tuple(observations.places if name is None else len(observations.levels[name]) for name in axes)


def _index(observations: Observations, axes: Sequence[str | None]) -> NDArray[np.int64]:
    """Return the (N,) cell of each row in a table with these axes."""
    index = np.zeros(len(observations.values), np.int64)
    for name, size in zip(axes, _shape(observations, axes), strict=True):
        index = index * size + (observations.place if name is None else observations.factors[name])
    return index


def _table(observations: Observations, axes: Sequence[str | None]) -> NDArray[np.float64] | None:
    """Return the means of all combinations of some factors, as `_means` does."""
    return _means(observations.values, _index(observations, axes), _shape(observations, axes))


def _means(values: NDArray[np.float64], index: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Return the mean of each cell, NaN where it is empty; None if most cells are empty."""
    if prod(shape) > len(values) / _FILLED:
        return None
    count = np.bincount(index, minlength=prod(shape))
    if np.count_nonzero(count) < _FILLED * len(count):
        return None
    total = np.bincount(index, weights=values, minlength=len(count))
    with np.errstate(invalid="ignore"):
        return np.asarray((total / count).reshape(shape))
