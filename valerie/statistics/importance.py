"""Importance of columns for the scores: shares of variance for set factors, tests for measured quantities.

A factor that the spec sets is varied by design, so its share of the variance is its own. Measured quantities (occlusion,
contrast, pixel area) are correlated with each other. For them the question is: does the score depend on this column among
rows that are alike in all other columns?
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri, stdtr

from valerie.errors import InvalidInput, MissingDependency
from valerie.statistics.confirmation import holm
from valerie.statistics.neighbours import alike
from valerie.statistics.observations import Observations, coordinates, dense
from valerie.statistics.threads import one_thread

#: Fewer places than this cannot be split into useful folds.
MIN_PLACES: Final = 20
#: Most rows that models are fitted to; of more, each place keeps equally many, drawn at random.
MAX_ROWS: Final = 4_000
#: Adjusted p-value up to which a column is named. At 0.05, planted decoys made up to 6 % of false discoveries, since the
#: columns' dependence is estimated too.
NAMED: Final = 0.025
#: F ratio above which an interaction is subtracted before the other pairs are fitted.
_CLEAR: Final = 2.0
_FOLDS: Final = 5
_PERMUTATIONS: Final = 10
#: Rows among which residuals are exchanged.
_STRATUM: Final = 20
_PENALTIES: Final = np.geomspace(1e-5, 1e3, 17)
#: Quintiles of a normal score, where the slope of the additive model may change.
_KNOTS: Final = ndtri(np.array([0.2, 0.4, 0.6, 0.8]))
_TERMS: Final = 1 + len(_KNOTS)
_TREES: Final = 40
_RATE: Final = 0.06
_LEAVES: Final = 8
_LEAF: Final = 10

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Share:
    """Share of the variance of the scores that a factor explains, alone and in interactions.

    Attributes:
        factor: its name.
        alone: main effect: the first-order Sobol' index.
        total: Shapley effect: the main effect and half of every interaction with one other factor.
    """

    factor: str
    alone: float
    total: float


@dataclass(frozen=True, slots=True)
class Importance:
    """Importance of a measured column, all other columns equal.

    Attributes:
        column: its name.
        loss: increase of the model's mean squared error when the column is exchanged among alike rows, as a share of the
            variance of the scores.
        p_value: one-sided, of no increase, adjusted by Holm for all columns.
        alike: True if neighbouring places are alike in what is tested, so that p-values are too small and no column is named.
    """

    column: str
    loss: float
    p_value: float
    alike: bool = False

    @property
    def named(self) -> bool:
        """True if the column explains scores that the others do not."""
        return self.p_value <= NAMED and not self.alike


def variance_shares(observations: Observations) -> tuple[Share, ...]:
    """Return the share of each factor, largest total first; empty if scores or factors do not vary.

    The scores are decomposed into an additive part, fitted by least squares, and the cell means of its residuals for each
    pair of factors. Both are adjusted for what noise alone would explain (as in adjusted R²). A pair's share is divided
    equally: the Shapley effects of independent inputs (Owen 2014, doi:10.1137/130936233) without interactions of three and
    more factors, which stay unexplained. There is no interval, because none tried kept its coverage.

    Args:
        observations: scores and codes of factors that are crossed or drawn independently.
    """
    values = observations.values
    whole = float(((values - values.mean()) ** 2).sum()) if len(values) else 0.0
    factors = {name: codes for name, codes in observations.factors.items() if len(codes) and codes.max() > 0}
    if not factors or whole <= 1e-12 * len(values):
        return ()
    alone, left = _main_effects(values, factors)
    alone = {name: share / whole for name, share in alone.items()}
    total = dict(alone)
    pairs = list(combinations(factors, 2))
    while pairs:
        (a, b), squares, ratio, fit = max(
            ((pair, *_between(left, factors[pair[0]], factors[pair[1]])) for pair in pairs), key=lambda one: one[2]
        )
        total[a] += squares / whole / 2
        total[b] += squares / whole / 2
        pairs.remove((a, b))
        if ratio > _CLEAR:  # or it would count as noise of the other pairs
            left = left - fit
    shares = [Share(name, max(alone[name], 0.0), max(total[name], 0.0)) for name in factors]
    return tuple(sorted(shares, key=lambda share: -share.total))


def _main_effects(values: Floats, factors: Mapping[str, NDArray[np.int64]]) -> tuple[dict[str, float], Floats]:
    """Return the sum of squares of each factor, adjusted for noise, and the (N,) residuals of the additive fit."""
    blocks = [np.eye(int(codes.max()) + 1)[codes][:, 1:] for codes in factors.values()]
    design = np.column_stack([block - block.mean(axis=0) for block in blocks])
    centred = values - values.mean()
    gram = design.T @ design
    effects = np.linalg.lstsq(gram, design.T @ centred, rcond=1e-10)[0]
    left = centred - design @ effects
    error = float(left @ left) / max(len(values) - 1 - design.shape[1], 1)
    squares, start = {}, 0
    for name, block in zip(factors, blocks, strict=True):
        end = start + block.shape[1]
        part = design[:, start:end] @ effects[start:end]
        squares[name] = float(part @ part) - block.shape[1] * error
        start = end
    return squares, left


def _between(left: Floats, a: NDArray[np.int64], b: NDArray[np.int64]) -> tuple[float, float, Floats]:
    """Return the sum of squares between the cells of two factors adjusted for noise, its F ratio, and (N,) cell means."""
    levels = int(b.max()) + 1
    cell, _ = dense(a * levels + b)
    n = np.bincount(cell)
    fit = (np.bincount(cell, left) / n)[cell]
    between, free, rest = float(fit @ fit), int(a.max()) * (levels - 1), len(left) - len(n)
    if rest <= 0:
        return 0.0, 0.0, fit
    noise = free * float((left - fit) @ (left - fit)) / rest
    return between - noise, between / noise if noise > 0 else np.inf, fit


def measured_importance(
    values: ArrayLike,
    places: ArrayLike,
    columns: Mapping[str, ArrayLike],
    *,
    seed: int = 0,
    positions: NDArray[np.float64] | None = None,
) -> tuple[Importance, ...]:
    """Test each measured column, all others equal; return the smallest p-value first.

    A model of the scores (additive with gradient-boosted trees) is fitted in five folds of whole places and judged on the
    places that it has not seen. One column at a time is exchanged: a regression on all others predicts it, and its
    residuals are permuted among rows with similar predictions. Where the score does not depend on the column given the
    others, original and exchanged values are equally good for any model: the mean difference of the squared errors over
    places is 0, which Student's t tests one-sided (conditional predictive impact: Watson and Wright 2021,
    doi:10.1007/s10994-021-06030-6; permutation given the others: Strobl et al. 2008, doi:10.1186/1471-2105-9-307).

    That takes places for independent. On a listed site, a column that follows the street predicts what neighbours share. So
    nothing is named where neighbouring places are alike (`valerie.statistics.neighbours`) in the model's mean errors, which no
    column explains, or in the differences of a column that would be named, which effects alike among neighbours make.

    Args:
        values: (N,) finite scores.
        places: (N,) whole numbers, the place of each row; of more than `MAX_ROWS` rows, each place keeps some.
        columns: name to (N,) finite numbers; a column that hardly differs from the others is never named.
        seed: of folds and permutations.
        positions: (N, D) coordinates, equal within a place, metres, where places are listed on one site; else None.

    Returns:
        One entry per column; empty with fewer than `MIN_PLACES` places, or where the scores or all columns are constant.

    Raises:
        InvalidInput: lengths differ, or a number is not finite.
        MissingDependency: scikit-learn is not installed.
    """
    from scipy.stats import rankdata

    try:
        import sklearn.ensemble  # noqa: F401  # to say what is missing
    except ModuleNotFoundError as error:
        raise MissingDependency("importance needs scikit-learn: install valerie[report]") from error
    scores, numbers, place = _checked(values, places, columns)
    generator = np.random.default_rng(seed)
    rows = _some_rows(place, generator)
    scores, numbers, place = scores[rows], numbers[rows], dense(place[rows])[0]
    count = int(place.max(initial=-1)) + 1
    varying = [k for k in range(numbers.shape[1]) if len(rows) and np.ptp(numbers[:, k]) > 0]
    if count < MIN_PLACES or not varying or np.ptp(scores) == 0:
        return ()
    # Monotone transforms do not affect trees, and the regressions are nearly linear on this scale.
    normal = np.column_stack([ndtri((rankdata(numbers[:, k]) - 0.5) / len(rows)) for k in varying])
    fold = (generator.permutation(count) % _FOLDS)[place]
    with one_thread():
        models = [_fit(normal[fold != k], scores[fold != k]) for k in range(_FOLDS)]

        def errors(x: Floats) -> Floats:
            predicted = np.empty(len(x))
            for k, model in enumerate(models):
                predicted[fold == k] = model(x[fold == k])
            return np.asarray(predicted - scores)

        before = errors(normal)
        gains = np.zeros((len(rows), len(varying)))
        for column in range(len(varying)):
            for exchanged in _exchanged(normal, column, generator):
                gains[:, column] += (errors(exchanged) ** 2 - before**2) / _PERMUTATIONS
    sums = [np.bincount(place, figure) for figure in (before, *gains.T)]
    of_places: Floats = np.column_stack(sums) / np.bincount(place)[:, None]
    mean, deviation = of_places[:, 1:].mean(axis=0), of_places[:, 1:].std(axis=0, ddof=1)
    statistic = np.divide(mean, deviation / count**0.5, out=np.full(len(varying), -np.inf), where=deviation > 0)
    p_values = holm(stdtr(count - 1, -statistic))
    together = False
    if positions is not None:
        where, named = coordinates(positions[rows], place, count), of_places[:, 1:][:, p_values <= NAMED].T
        together = bool(alike(of_places[:, :1], where)[0]) or any(
            bool(alike(figure[:, None], where, within=True)[0]) for figure in named
        )
    entries = zip(varying, (mean / scores.var()).tolist(), p_values.tolist(), strict=True)
    names = list(columns)
    results = (Importance(names[k], loss, p_value, together) for k, loss, p_value in entries)
    return tuple(sorted(results, key=lambda one: (one.p_value, -one.loss)))


def _checked(
    values: ArrayLike, places: ArrayLike, columns: Mapping[str, ArrayLike]
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return (N,) scores, (N, columns) numbers and (N,) places."""
    scores, place = np.asarray(values, np.float64), np.asarray(places)
    numbers = {name: np.asarray(column, np.float64) for name, column in columns.items()}
    for name, column in {"values": scores, "places": place, **numbers}.items():
        if column.shape != scores.shape:
            raise InvalidInput("needs one number per value", field=name, value=column.shape, limit=scores.shape)
        if not np.isfinite(column).all():
            raise InvalidInput("needs finite numbers", field=name)
    stacked = np.column_stack(list(numbers.values())) if numbers else np.zeros((len(scores), 0))
    return scores, stacked, place.astype(np.int64)


def _some_rows(place: NDArray[np.int64], generator: np.random.Generator) -> NDArray[np.int64]:
    """Return at most `MAX_ROWS` rows, ascending: one of each place, then a second one of each, and so on."""
    shuffled = generator.permutation(len(place))
    by_place = shuffled[np.argsort(place[shuffled], kind="stable")]
    first = np.searchsorted(place[by_place], place[by_place])
    return np.sort(by_place[np.argsort(np.arange(len(place)) - first, kind="stable")[:MAX_ROWS]])


def _fit(x: Floats, scores: Floats) -> Callable[[Floats], Floats]:
    """Return a model of the scores: an additive one of few columns, with boosted trees on its residuals.

    The additive model is piecewise linear in each of its columns, which are added one by one while Schwarz's criterion falls
    (1978, doi:10.1214/aos/1176344136). Trees without it would divide an effect among correlated columns.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    basis = _basis(x)
    gram, product = basis.T @ basis, basis.T @ scores

    def solve(columns: list[int]) -> tuple[float, NDArray[np.int64], Floats]:
        terms = np.array([0, *(1 + _TERMS * column + k for column in columns for k in range(_TERMS))])
        slopes = np.linalg.lstsq(gram[np.ix_(terms, terms)], product[terms], rcond=1e-9)[0]
        rest = max(float(scores @ scores - product[terms] @ slopes), 1e-12)
        return len(scores) * np.log(rest / len(scores)) + len(terms) * np.log(len(scores)), terms, slopes

    chosen: list[int] = []
    best = solve(chosen)
    while others := [column for column in range(x.shape[1]) if column not in chosen]:
        column, model = min(((column, solve([*chosen, column])) for column in others), key=lambda one: one[1][0])
        if model[0] >= best[0]:
            break
        chosen.append(column)
        best = model
    _, terms, slopes = best
    trees = HistGradientBoostingRegressor(
        max_iter=_TREES, learning_rate=_RATE, max_leaf_nodes=_LEAVES, min_samples_leaf=_LEAF, random_state=0
    ).fit(x, scores - basis[:, terms] @ slopes)
    return lambda x: np.asarray(_basis(x)[:, terms] @ slopes + trees.predict(x))


def _basis(x: Floats) -> Floats:
    """Return 1, then for each column of ``x`` itself and its excess over each of `_KNOTS`."""
    terms = np.concatenate((x[:, :, None], np.maximum(x[:, :, None] - _KNOTS, 0)), axis=2)
    return np.column_stack((np.ones(len(x)), terms.reshape(len(x), -1)))


def _exchanged(x: Floats, column: int, generator: np.random.Generator) -> Iterator[Floats]:
    """Yield ``x`` with one column drawn anew given the others: its residuals are permuted among similar rows."""
    own, others = x[:, column], np.delete(x, column, axis=1)
    linear = np.column_stack((np.ones(len(x)), others))
    predicted = linear @ np.linalg.lstsq(linear, own, rcond=1e-6)[0]
    first, second = np.triu_indices(others.shape[1])
    curved = others[:, first] * others[:, second]
    curved -= linear @ np.linalg.lstsq(linear, curved, rcond=1e-6)[0]
    predicted += curved @ _ridge(curved, own - predicted)
    order, residual = np.argsort(predicted, kind="stable"), own - predicted
    stratum = np.arange(len(x)) // _STRATUM
    known = np.unique(own)
    middles = (known[1:] + known[:-1]) / 2
    for _ in range(_PERMUTATIONS):
        shuffled = order[np.lexsort((generator.random(len(x)), stratum))]
        exchanged = x.copy()
        drawn = predicted[order] + residual[shuffled]
        exchanged[order, column] = known[np.searchsorted(middles, drawn)]  # piled values stay piled
        yield exchanged


def _ridge(features: Floats, y: Floats) -> Floats:
    """Return the coefficients of ridge regression with the penalty of generalised cross-validation (Golub et al. 1979)."""
    values, vectors = np.linalg.eigh(features.T @ features)
    values = np.maximum(values, 0.0)
    projected = vectors.T @ (features.T @ y)

    def criterion(penalty: float) -> float:
        weight = 1 / (values + penalty)
        left = float(y @ y) - 2 * float(projected**2 @ weight) + float(projected**2 @ (values * weight**2))
        return left / (len(y) - float(values @ weight)) ** 2

    penalty = min(_PENALTIES * len(y), key=criterion)
    return np.asarray(vectors @ (projected / (values + penalty)))
