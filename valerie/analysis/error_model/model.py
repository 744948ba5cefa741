"""Perception-error models of a run's functions: the probability of a miss and the distribution of pACC, given a person's
distance, occlusion, size and light.

The model is a distribution regression (Chernozhukov, Fernández-Val and Melly 2013, doi:10.3982/ECTA10582): for each of
several bounds of pACC, a logistic regression gives the probability that pACC is lower. Its terms are piecewise linear in
each column, and products of these for pairs of columns if cross-validation favours them. If chance does not explain their
calibration error on held-out places, the odds are bent at quantiles of these places' odds. The probabilities are sorted, so
that they form a distribution (Chernozhukov, Fernández-Val and Galichon 2010, doi:10.3982/ECTA7880); its quantiles and the
probability of a miss follow from it and never contradict each other.

All figures of a model come from whole places that took no part in its fit or in the choice of its terms and penalty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.special import expit

from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput, MissingDependency
from valerie.measures import MEASURES, measure_of
from valerie.statistics.calibration import Calibration, calibration, quantile_shares

#: Columns of the queries by default; a column that does not vary or lacks values is left out.
GIVEN: Final = tuple(measure.name for measure in MEASURES if measure.is_queried)
#: Levels of the quantiles of pACC.
LEVELS: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
#: Largest calibration error of a model that may be used.
LIMIT: Final = 0.02
#: Fewest places for a meaningful split into folds.
MIN_PLACES: Final = 40
#: Fewest places with a miss, and fewest without, for a fit.
MIN_OF_EACH: Final = 10
#: Most rows of a fit; from more, whole places are drawn.
MAX_ROWS: Final = 40_000
#: pACC within this distance of 0 or 1 is in the lowest or the highest step of the distribution.
_END: Final = 0.005
#: Differences below it are rounding.
ROUNDING: Final = 1e-9
#: Bounds of pACC whose probabilities form the distribution, besides the threshold of misses.
_BOUNDS: Final = (_END, *(round(0.05 * k, 2) for k in range(1, 20)), 1 - _END)
#: Share of held-out rows that must be inside the support of the other places.
_HELD: Final = 0.95
#: Most cells of the support over the middle 98 % of a column's values, and in total.
_CELLS: Final = 20
_MOST_CELLS: Final = 2_000
_FOLDS: Final = 5
_INNER: Final = 4
#: Quantiles of a column at which its slope may change, and the subset of them that enters products.
_KNOTS: Final = (0.2, 0.4, 0.6, 0.8)
_IN_PRODUCTS: Final = (0.2, 0.6)
_PENALTIES: Final = (1e-3, 1e-2, 1e-1, 1.0)
#: Penalty of the bends, which lie at the quantiles `_KNOTS` of the odds.
_BENT_PENALTY: Final = 1e-4
#: The odds are bent if their calibration error exceeds chance by this factor.
_BENT_ABOVE: Final = 1.5

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_]
#: Receives messages while models are fitted.
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """The part of the columns' space that has training rows.

    Attributes:
        centres: (C, F) centres of the cells that contain a row.
        widths: (F,) widths of the cells, in the units of the columns.
        rows: (C,) number of rows in each cell.
    """

    centres: Floats
    widths: Floats
    rows: NDArray[np.int64]

    def inside(self, x: Floats) -> Rows:
        """Return (N,) bool: the centre of a cell with training rows is within one width of the query in every column."""
        tree = cKDTree(self.centres / self.widths)
        known = np.asarray(np.isfinite(x).all(axis=1), np.bool_)
        distances, _ = tree.query(np.where(known[:, None], x, 0.0) / self.widths, p=np.inf)
        return np.asarray(known & (distances <= 1 + ROUNDING), np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """Terms of the regression: each column, its excess above knots, and products of two of these.

    Attributes:
        low, high: (F,) range of the training rows, to which queries are clipped.
        middle, scale: (F,) offset and divisor of each column.
        of: (K,) column of each knot.
        knots: (K,) in the units of the columns.
        first, second: (P,) factors of each product, as positions among the F + K terms before the products.
    """

    low: Floats
    high: Floats
    middle: Floats
    scale: Floats
    of: NDArray[np.int64]
    knots: Floats
    first: NDArray[np.int64]
    second: NDArray[np.int64]

    def __call__(self, x: Floats) -> Floats:
        """Return (N, F + K + P) terms of queries (N, F)."""
        within = np.clip(x, self.low, self.high)
        rises = np.maximum(within[:, self.of] - self.knots, 0.0) / self.scale[self.of]
        plain = np.column_stack(((within - self.middle) / self.scale, rises))
        return np.column_stack((plain, plain[:, self.first] * plain[:, self.second]))


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Answers to N queries.

    Attributes:
        miss: (N,) probability that pACC is below the threshold.
        below: (N, B) probabilities that pACC is below each bound of the fit, ascending.
        quantiles: (N, L) quantiles of pACC at `LEVELS`, ascending.
        inside: (N,) False where the model would extrapolate; do not use its other answers there.
    """

    miss: Floats
    below: Floats
    quantiles: Floats
    inside: Rows


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted distribution of pACC.

    Attributes:
        support: support of the training rows.
        terms: terms of the regressions.
        weights: (T, B) weight of each term for each bound.
        offsets: (B,) intercepts.
        knots: (B, K) odds at which the odds are bent; K is 0 if they are not.
        bends: (B, 1 + K) weight of the odds and of their excess above each knot.
        shifts: (B,) what is added to them.
        bounds: (B,) bounds of pACC, ascending.
        miss: position of the threshold of misses among the bounds.
    """

    support: Support
    terms: Terms
    weights: Floats
    offsets: Floats
    knots: Floats
    bends: Floats
    shifts: Floats
    bounds: Floats
    miss: int

    def predict(self, x: Floats) -> Prediction:
        """Answer queries, (N, F)."""
        odds = _bent(self.terms(x) @ self.weights + self.offsets, self.knots)
        below = np.sort(expit((odds * self.bends).sum(-1) + self.shifts), axis=1)
        ends = np.column_stack((np.zeros(len(x)), below, np.ones(len(x))))
        steps = np.diff(np.concatenate(([0.0], self.bounds, [1.0])))
        reached = (np.array(LEVELS)[:, None] - ends[:, None, :-1]) / np.maximum(np.diff(ends), ROUNDING)[:, None]
        return Prediction(
            miss=below[:, self.miss],
            below=below,
            quantiles=np.clip(reached, 0.0, 1.0) @ steps,
            inside=self.support.inside(x),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """The perception-error model of one function, with its figures on held-out places.

    Attributes:
        function: its name.
        threshold: a person with pACC below it is a miss.
        columns: (F,) names of the columns of a query, in order.
        ranges: least and largest value of each column in the training rows.
        fit: the fitted distribution.
        misses: calibration of the miss probability, on held-out rows inside the support of the other places.
        quantile_shares: (L,) share of these rows up to each quantile (`valerie.statistics.calibration.quantile_shares`).
        inside: share of held-out rows inside the support of the other places.
        miss_rate: share of all rows that are misses.
    """

    function: str
    threshold: float
    columns: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    fit: Fit
    misses: Calibration
    quantile_shares: tuple[float, ...]
    inside: float
    miss_rate: float

    @property
    def quantile_error(self) -> float:
        """Mean distance of the shares from their levels."""
        return float(np.abs(np.subtract(self.quantile_shares, LEVELS)).mean())

    @property
    def usable(self) -> bool:
        """True if neither calibration error exceeds `LIMIT`."""
        return self.misses.error <= LIMIT and self.quantile_error <= LIMIT

    @property
    def places_needed(self) -> int:
        """Number of further places that would reduce the error on new places to `LIMIT`; 0 if it is no larger already."""
        return max(self.misses.places_for(LIMIT) - self.misses.places, 0)

    @property
    def sentence(self) -> str:
        """The calibration in words."""
        misses = self.misses
        text = (
            f"calibration error of misses {misses.error:.1%} on held-out places, at most about {misses.on_new_places:.1%}"
            f" on new ones; of quantiles {self.quantile_error:.1%}"
        )
        if self.places_needed:
            text += f"; {self.places_needed:,} more places would reduce the error on new places to {LIMIT:.0%}"
        if misses.error > LIMIT and misses.error > 2 * misses.chance:
            text += ", unless influences outside the columns cause it: chance explains less"
        return text

    def predict(self, queries: ArrayLike) -> Prediction:
        """Answer queries, (N, F), columns as in ``columns``.

        Raises:
            InvalidInput: not one value per column.
        """
        x = np.asarray(queries, np.float64)
        if x.ndim != 2 or x.shape[1] != len(self.columns):
            raise InvalidInput("a query has one value per column", field="queries", value=x.shape, limit=self.columns)
        return self.fit.predict(x)


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModels:
    """The models of a run.

    Attributes:
        models: models of the functions that have one, usable or not.
        refusals: function to the reason why it has none.
        left_out: requested column to the reason why no model uses it.
    """

    models: tuple[ErrorModel, ...]
    refusals: dict[str, str]
    left_out: dict[str, str]


def fit_error_models(
    table: EvaluationTable,
    *,
    threshold: float = 0.5,
    given: Sequence[str] = GIVEN,
    seed: int = 0,
    progress: Progress = lambda _: None,
) -> ErrorModels:
    """Fit a model for each function of a run, and check it on held-out places; equal input gives equal models.

    Persons without a visible pixel have no pACC and take no part.

    Args:
        table: the run's evaluations.
        threshold: a person with pACC below it is a miss, 0 < threshold ≤ 1.
        given: columns of the queries.
        seed: of the folds.
        progress: receives a message before each fit.

    Raises:
        UnknownName: there is no such column.
        InvalidInput: a column holds no numbers, all columns are left out, or the threshold is out of bounds.
        MissingDependency: scikit-learn is not installed.
    """
    if not 0 < threshold <= 1:
        raise InvalidInput("not a threshold of pACC", field="threshold", value=threshold, limit="above 0, up to 1")
    for name in given:
        if not measure_of(name).is_number:
            raise InvalidInput("the column holds names, not numbers", field="given", value=name)
    pacc, functions = table.numbers("pacc"), table.codes("function")
    known = np.isfinite(pacc)
    columns, left_out = _usable_columns(table, known, given)
    if not columns:
        raise InvalidInput("no usable column is left", field="given", value=left_out)
    x = np.column_stack([table.numbers(name) for name in columns])
    models, refusals = [], {}
    for name in functions.names:
        rows = _some(functions.where(name) & known, table.places, seed)
        data = _Data(x[rows], pacc[rows], table.places[rows], threshold)
        if reason := data.refusal:
            refusals[name] = reason
        else:
            models.append(_model(name, columns, data, seed, progress))
    return ErrorModels(tuple(models), refusals, left_out)


def _usable_columns(
    table: EvaluationTable, known: Rows, given: Sequence[str]
) -> tuple[tuple[str, ...], dict[str, str]]:
    columns, left_out = [], {}
    for name in dict.fromkeys(given):
        values = table.numbers(name)[known]
        finite = np.isfinite(values)
        if not finite.any():
            left_out[name] = "the run did not measure it"
        elif not finite.all():
            left_out[name] = f"{(~finite).sum():,} persons have no value"
        elif values.min() == values.max():
            left_out[name] = f"always {measure_of(name).text(float(values[0]))}"
        else:
            columns.append(name)
    return tuple(columns), left_out


@dataclass(frozen=True, slots=True, eq=False)
class _Data:
    x: Floats
    pacc: Floats
    places: NDArray[np.int64]
    threshold: float

    @property
    def misses(self) -> Rows:
        return self.pacc < self.threshold

    @property
    def refusal(self) -> str:
        """Reason why these rows are too few; empty if they are enough."""
        count = len(np.unique(self.places))
        if count < MIN_PLACES:
            return f"{count} places are too few: {MIN_PLACES - count} more are needed at least"
        for kind, rows in (("with a miss", self.misses), ("with a person that is not missed", ~self.misses)):
            places = len(np.unique(self.places[rows]))
            if places < MIN_OF_EACH:
                needed = MIN_OF_EACH - places
                more = (
                    f"about {ceil(count * needed / places):,} more places would do"
                    if places
                    else "no such place was seen"
                )
                return f"{places} of {count} places {kind} are too few, {MIN_OF_EACH} are needed: {more}"
        return ""

    def of(self, rows: Rows) -> _Data:
        return _Data(self.x[rows], self.pacc[rows], self.places[rows], self.threshold)


def _model(name: str, columns: tuple[str, ...], data: _Data, seed: int, progress: Progress) -> ErrorModel:
    folds = _folds(data.places, _FOLDS, seed)
    miss, inside = np.zeros(len(data.x)), np.zeros(len(data.x), np.bool_)
    below = np.zeros((len(data.x), len(_bounds(data.threshold))))
    for fold in range(_FOLDS):
        progress(f"{name}: fold {fold + 1} of {_FOLDS}")
        tested = folds == fold
        answer = _fit(data.of(~tested), seed).predict(data.x[tested])
        miss[tested], below[tested], inside[tested] = answer.miss, answer.below, answer.inside
    progress(f"{name}: the model itself")
    return ErrorModel(
        function=name,
        threshold=data.threshold,
        columns=columns,
        ranges=tuple(zip(data.x.min(0).tolist(), data.x.max(0).tolist(), strict=True)),
        fit=_fit(data, seed),
        misses=calibration(miss[inside], data.misses[inside], data.places[inside], seed=seed),
        quantile_shares=quantile_shares(below[inside], _bounds(data.threshold), data.pacc[inside], LEVELS),
        inside=float(inside.mean()),
        miss_rate=float(data.misses.mean()),
    )


def _fit(data: _Data, seed: int) -> Fit:
    try:
        from sklearn.linear_model import LogisticRegression
    except ImportError as error:
        raise MissingDependency("error models need scikit-learn: install valerie[guided]") from error

    def regression(x: Floats, lower: Rows, penalty: float) -> tuple[Floats, float]:
        if lower.all() or not lower.any():  # as if half a row were of the other kind
            return np.zeros(x.shape[1]), float(np.log((lower.sum() + 0.5) / ((~lower).sum() + 0.5)))
        fitted = LogisticRegression(C=1 / (penalty * len(x)), solver="newton-cholesky").fit(x, lower)
        return fitted.coef_[0], float(fitted.intercept_[0])

    def held_out(x: Floats, lower: Rows, penalty: float) -> Floats:
        """Return the (N,) odds of each row by a regression without its place."""
        odds = np.empty(len(x))
        for fold in range(_INNER):
            tested = folds == fold
            weights, offset = regression(x[~tested], lower[~tested], penalty)
            odds[tested] = x[tested] @ weights + offset
        return odds

    def loss(terms: Terms, penalty: float) -> float:
        odds = held_out(terms(data.x), data.misses, penalty)
        return float(np.logaddexp(0, np.where(data.misses, -odds, odds)).mean())

    folds = _folds(data.places, _INNER, seed + 1)
    choices = [(_terms(data.x, products=products), penalty) for products in (False, True) for penalty in _PENALTIES]
    terms, penalty = min(choices, key=lambda choice: loss(*choice))
    values = terms(data.x)
    bounds = _bounds(data.threshold)
    fitted = [regression(values, data.pacc < bound, penalty) for bound in bounds]
    knots, bent = np.empty((len(bounds), 0)), [(np.ones(1), 0.0)] * len(bounds)
    found = calibration(expit(held_out(values, data.misses, penalty)), data.misses, data.places, seed=seed)
    if found.error > _BENT_ABOVE * found.chance:
        odds = [held_out(values, data.pacc < bound, penalty) for bound in bounds]
        knots = np.quantile(odds, _KNOTS, axis=1).T
        bent = [
            regression(_bent(own, at), data.pacc < bound, _BENT_PENALTY)
            for own, at, bound in zip(odds, knots, bounds, strict=True)
        ]
    return Fit(
        support=_support(data.x, folds),
        terms=terms,
        weights=np.column_stack([weights for weights, _ in fitted]),
        offsets=np.array([offset for _, offset in fitted]),
        knots=knots,
        bends=np.stack([weights for weights, _ in bent]),
        shifts=np.array([shift for _, shift in bent]),
        bounds=bounds,
        miss=int(np.searchsorted(bounds, data.threshold)),
    )


def _bent(odds: Floats, knots: Floats) -> Floats:
    """Return (…, 1 + K): odds, and their excess above each of K knots."""
    each = odds[..., None]
    return np.concatenate((each, np.maximum(each - knots, 0.0)), axis=-1)


def _terms(x: Floats, *, products: bool) -> Terms:
    knots = [np.unique(np.quantile(column, _KNOTS)) for column in x.T]
    of = np.repeat(np.arange(x.shape[1]), [len(own) for own in knots])
    pairs: list[tuple[int, int]] = []
    if products:
        crossed = [np.quantile(column, _IN_PRODUCTS) for column in x.T]
        factors = [*range(x.shape[1])]
        factors += [x.shape[1] + i for i, (own, knot) in enumerate(zip(of, np.concatenate(knots), strict=True))
                    if knot in crossed[own]]  # fmt: skip
        columns = np.concatenate((np.arange(x.shape[1]), of))
        pairs = [(a, b) for a, b in combinations(factors, 2) if columns[a] != columns[b]]
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    return Terms(x.min(0), x.max(0), x.mean(0), x.std(0), of, np.concatenate(knots), first, second)


def _support(x: Floats, folds: NDArray[np.int64]) -> Support:
    """Return the support with the smallest cells that contain `_HELD` of the held-out rows, fold by fold."""
    low, high = np.quantile(x, (0.01, 0.99), axis=0)
    spans = np.where(high > low, high - low, x.max(0) - x.min(0))
    for cells in range(_CELLS, 0, -1):
        support = _cells(x, spans / cells)
        held = [_cells(x[folds != fold], spans / cells).inside(x[folds == fold]) for fold in range(_INNER)]
        if len(support.centres) <= _MOST_CELLS and np.concatenate(held).mean() >= _HELD:
            break
    return support


def _cells(x: Floats, widths: Floats) -> Support:
    centres, rows = np.unique(np.round(x / widths), axis=0, return_counts=True)
    return Support(centres * widths, widths, rows)


def _bounds(threshold: float) -> Floats:
    return np.unique((*_BOUNDS, threshold))


def _folds(places: NDArray[np.int64], count: int, seed: int) -> NDArray[np.int64]:
    """Return the (N,) fold of each row; a place is in one fold."""
    distinct, index = np.unique(places, return_inverse=True)
    return np.asarray(np.random.default_rng([seed, count]).permutation(len(distinct)) % count)[index]


def _some(rows: Rows, places: NDArray[np.int64], seed: int) -> Rows:
    """Return (N,) bool: at most `MAX_ROWS` of the rows, in whole places drawn at random."""
    if rows.sum() <= MAX_ROWS:
        return rows
    distinct, index, counts = np.unique(places[rows], return_inverse=True, return_counts=True)
    order = np.random.default_rng(seed).permutation(len(distinct))
    kept = np.zeros(len(distinct), np.bool_)
    kept[order[np.cumsum(counts[order]) <= MAX_ROWS]] = True
    some = rows.copy()
    some[rows] = kept[index]
    return some
