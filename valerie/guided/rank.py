"""Rank parameters by their effect on the score.

Elementary effects screen first (Morris 1991, doi:10.1080/00401706.1991.10484804). In `TRAJECTORIES` walks, one parameter
after another jumps; the mean size of a parameter's effects, μ* (Campolongo and others 2007,
doi:10.1016/j.envsoft.2006.10.004), is compared with the largest one.

The remaining parameters get Sobol' indices. A *block* is a row of two independent Sobol' points A and B, and of A with one
parameter after another from B. The parameters that were screened out form one more group, which shows whether the screening
was right: if its total share of the first `FEWEST` whole blocks exceeds `READMITTED`, new blocks begin with all parameters. The
shares of variance are those of Saltelli and others (2010, doi:10.1016/j.cpc.2009.09.018) for each parameter
alone, and of Jansen (1999, doi:10.1016/S0010-4655(98)00154-4) for it with all its interactions.

The *Shapley effect* of a parameter is its share where each interaction is divided evenly among those that take part; these
shares add up to 1. A *path* leads from A to B: one group after another jumps, in a random order. The effect is the mean
growth of the total share along the paths (Goda 2021, doi:10.1016/j.ress.2021.107702). A block has the points of its path,
too.

All intervals are those of a jackknife over blocks (Efron and Stein 1981, doi:10.1214/aos/1176345462); those of total shares,
which are means of squares, on the scale of the cube root (Wilson and Hilferty 1931, doi:10.1073/pnas.17.12.684). Few blocks can
decide the spread, so Student's quantile has the degrees of freedom that the fourth moment of the blocks' influence leaves
(Satterthwaite 1946, doi:10.2307/3002019).

Each point is identified by its block and place, so a missing score cannot shift the others. A block without all its scores
is left out; if more than `BROKEN` of the blocks are, the indices are refused, since they would describe another domain.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.guided.domain import Cube
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Why
from valerie.parameters.samplers import UnitPoints

Floats = NDArray[np.float64]

#: Walks of the screening.
TRAJECTORIES: Final = 10
#: Parameters with less than this share of the largest μ* are screened out.
NEGLIGIBLE: Final = 0.1
#: Fewest whole blocks for indices.
FEWEST: Final = 32
#: Total share of all that was screened out together, above which it is readmitted.
READMITTED: Final = 0.05
#: Largest share of broken blocks.
BROKEN: Final = 0.2
#: Share of blocks with illegal points at which no more are asked for: the indices would be refused in the end.
HOPELESS: Final = 2 * BROKEN
_JUMP: Final = 2 / 3
#: Share of the mean square below which a variance is a rounding error.
_ROUNDING: Final = 1e-12
_BELOW_ONE: Final = float(np.nextafter(1.0, 0.0))


@dataclass(frozen=True, slots=True)
class Share:
    """A share of variance with its 95 % interval."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Effect:
    """The effect of a parameter on the score.

    Attributes:
        dimension: index of its dimension; None for all that were screened out together.
        elementary: μ*, the mean size of its effects in the screening; the largest of a group; NaN where no jump has scores.
        alone: share of the variance by this parameter alone; None without enough blocks.
        total: the same with all its interactions.
        shapley: the same with an even part of each interaction.
    """

    dimension: int | None
    elementary: float
    alone: Share | None
    total: Share | None
    shapley: Share | None

    @property
    def size(self) -> float:
        """The number that ranks it: the total share, or μ* without shares; −∞ where nothing is known."""
        size = self.total.estimate if self.total else self.elementary
        return size if math.isfinite(size) else -math.inf


@dataclass(frozen=True, slots=True)
class Ranking(Result):
    """The ranking of the parameters so far.

    Attributes:
        effects: largest first.
        screened_out: negligible dimensions.
        blocks: number of whole blocks, without those before a readmission.
        broken: number of these that lack a score.
        refused: True if too many are broken for indices.
        evaluations: number of all points.
    """

    effects: tuple[Effect, ...]
    screened_out: tuple[int, ...]
    blocks: int
    broken: int
    refused: bool
    evaluations: int


class Rank:
    """Strategy that ranks parameters.

    Args:
        domain: the operational domain.
        seed: of all draws.

    Raises:
        InvalidInput: fewer than two parameters.
    """

    def __init__(self, domain: Cube, *, seed: int) -> None:
        from scipy.stats import qmc

        if domain.dimensions < 2:
            raise InvalidInput("a ranking needs two parameters", field="vary", value=domain.dimensions, limit=">= 2")
        self.domain, self.seed = domain, seed
        self._open = OpenBatches(bounded=False)
        #: Rows (block or walk, place in it) of open points, and of points not yet proposed.
        self._rows: deque[list[tuple[int, int]]] = deque()
        self._left: deque[tuple[int, int, UnitPoints]] = deque()
        self._evaluations = 0
        self._walks, self._orders = self._screening()
        self._walk_scores = np.full(self._walks.shape[:2], np.nan)
        self._walks_left = self._walks.shape[0] * self._walks.shape[1]
        for walk, points in enumerate(self._walks):
            self._left.extend((walk, place, point) for place, point in enumerate(points))
        #: (groups, dimensions) parameters that move together; None during the screening.
        self._groups: NDArray[np.bool_] | None = None
        self._screened = np.zeros(domain.dimensions, np.bool_)
        #: The first block of these groups.
        self._first = 0
        self._checked = False
        self._scores: list[Floats] = []
        self._told: list[int] = []
        self._illegal = 0
        #: The order of the groups along the path of each block.
        self._paths: list[NDArray[np.int64]] = []
        self._sobol = qmc.Sobol(2 * domain.dimensions, rng=np.random.default_rng([seed, 1]))

    def ask(self, count: int) -> Proposal:
        """Return the next batch; an empty one while scores of the screening are missing, or if blocks are hopeless."""
        no_points = np.empty((0, self.domain.dimensions))
        if self._groups is None and not self._left:
            return self._open.add(no_points, Reason(Why.SCREENING_SCORES))
        while self._groups is not None and (len(self._left) < count or len(self._scores) - self._first < FEWEST):
            self._add_block(self._groups)
            drawn = len(self._scores) - self._first
            if drawn >= FEWEST and self._illegal > HOPELESS * drawn:
                legality = {"illegal": self._illegal, "drawn": drawn}
                return self._open.add(no_points, Reason(Why.ILLEGAL_BLOCKS, legality))
        chosen = [self._left.popleft() for _ in range(min(count, len(self._left)))]
        self._rows.append([(block, place) for block, place, _ in chosen])
        numbers: dict[str, float] = {"points": len(chosen), "parameters": self.domain.dimensions}
        if self._groups is None:
            numbers |= {"walks": TRAJECTORIES, "scored": self._evaluations}
            reason = Reason(Why.SCREENING, numbers)
        else:
            numbers |= {"blocks": len(self._ended()) - self._illegal, "fewest": FEWEST}
            numbers["screened"] = int(np.count_nonzero(self._screened))
            reason = Reason(Why.BLOCKS, numbers)
        return self._open.add(np.array([point for _, _, point in chosen]).reshape(-1, self.domain.dimensions), reason)

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, or not one score for each.
        """
        values = self._open.close(points, scores)
        self._evaluations += len(values)
        for (block, place), value in zip(self._rows.popleft(), values.tolist(), strict=True):
            if self._groups is None:
                self._walk_scores[block, place] = value
                self._walks_left -= 1
            else:
                self._scores[block][place] = value
                self._told[block] += 1
        if self._groups is None:
            if not self._walks_left:
                # A parameter without any score is unknown, not negligible.
                self._screened = _negligible(self._elementary())
                self._groups = self._kept_groups()
        elif self._screened.any() and not self._checked:
            self._readmit(self._intact())

    def _screening(self) -> tuple[Floats, NDArray[np.int64]]:
        """Return walks (walks, dimensions + 1, dimensions), and the parameter of each jump (walks, dimensions)."""
        rng = np.random.default_rng([self.seed, 0])
        dimensions = self.domain.dimensions
        walks, orders = [], []
        for start in self.domain.draw(rng, TRAJECTORIES):
            order, points = rng.permutation(dimensions), [start]
            for dimension in order:
                point = points[-1].copy()
                point[dimension] += _JUMP if point[dimension] < 1 - _JUMP else -_JUMP
                point[dimension] = abs(point[dimension])
                points.append(point)
            walks.append(points)
            orders.append(order)
        return np.array(walks), np.array(orders)

    def _elementary(self) -> Floats:
        """Return μ* of each parameter; NaN where no jump has both scores."""
        jumps = np.take_along_axis(np.diff(self._walks, axis=1), self._orders[:, :, None], axis=2)[:, :, 0]
        effects = np.abs(np.diff(self._walk_scores, axis=1) / jumps)
        sizes = np.full(self.domain.dimensions, np.nan)
        for dimension in range(self.domain.dimensions):
            of_it = effects[self._orders == dimension]
            of_it = of_it[~np.isnan(of_it)]
            if len(of_it):
                sizes[dimension] = of_it.mean()
        return sizes

    def _ended(self) -> list[int]:
        """Return the blocks of the current groups that have all answers."""
        return [block for block in range(self._first, len(self._told)) if self._told[block] == len(self._scores[block])]

    def _intact(self) -> list[int]:
        return [block for block in self._ended() if not np.isnan(self._scores[block]).any()]

    def _readmit(self, blocks: list[int]) -> None:
        """Check the screening once; if it was wrong, begin again with each parameter for itself."""
        if len(blocks) < FEWEST:
            return
        self._checked = True
        _, total, _ = indices(*self._known(blocks))
        if not total[-1] > READMITTED:  # NaN without variance
            return
        alone = np.count_nonzero(self._screened) == 1
        self._screened[:] = False
        if not alone:  # else its blocks are those of a parameter
            self._groups = self._kept_groups()
            self._first, self._illegal = len(self._scores), 0
            self._left.clear()

    def _kept_groups(self) -> NDArray[np.bool_]:
        kept = ~self._screened
        groups = np.eye(self.domain.dimensions, dtype=np.bool_)[kept]
        return groups if kept.all() else np.concatenate([groups, ~kept[None]])

    def _add_block(self, groups: NDArray[np.bool_]) -> None:
        """Queue the next block whose points are all legal; illegal ones count as broken."""
        both = np.minimum(self._sobol.random(1)[0], _BELOW_ONE)
        first, second = np.split(both, 2)
        block = len(self._scores)
        path = np.random.default_rng([self.seed, 3, block]).permutation(len(groups))
        moved = np.cumsum(groups[path], axis=0).astype(np.bool_)[1:-1]
        points = np.concatenate([[first, second], np.where(groups, second, first), np.where(moved, second, first)])
        self._paths.append(path)
        self._scores.append(np.full(len(points), np.nan))
        self._told.append(0)
        if self.domain.legal(points).all():
            self._left.extend((block, place, point) for place, point in enumerate(points))
        else:
            self._told[block] = len(points)
            self._illegal += 1

    @property
    def result(self) -> Ranking | None:
        """The ranking so far; None during the screening."""
        if self._groups is None:
            return None
        ended, intact = len(self._ended()), self._intact()
        broken = ended - len(intact)
        refused = broken > BROKEN * max(ended, 1)
        sizes = self._elementary()
        effects = []
        for place, (alone, total, shapley) in enumerate(self._shares(intact, refused=refused)):
            members = np.flatnonzero(self._groups[place])
            effects.append(
                Effect(
                    int(members[0]) if place < len(self._groups) - 1 or len(members) == 1 else None,
                    float(np.fmax.reduce(sizes[members])),
                    alone,
                    total,
                    shapley,
                )
            )
        effects.sort(key=lambda effect: -effect.size)
        screened = np.flatnonzero(self._screened)
        if len(screened) == 1:  # a group of one looks like a parameter that was kept
            effects = [replace(e, dimension=None) if e.dimension == screened[0] else e for e in effects]
        return Ranking(
            tuple(effects),
            tuple(screened.tolist()),
            len(intact),
            broken,
            refused,
            self._evaluations,
        )

    def _shares(self, blocks: list[int], *, refused: bool) -> list[tuple[Share | None, ...]]:
        """Return the shares alone, in total and of Shapley of each group."""
        assert self._groups is not None, "the screening has ended"
        known = None if refused or len(blocks) < FEWEST else shares(*self._known(blocks))
        return [*known] if known else [(None, None, None)] * len(self._groups)

    def _known(self, blocks: list[int]) -> tuple[Floats, NDArray[np.int64]]:
        """Return the scores and the paths of blocks, as `indices` takes them."""
        return np.array([self._scores[block] for block in blocks]), np.array([self._paths[block] for block in blocks])


def _negligible(sizes: Floats) -> NDArray[np.bool_]:
    """Return True for each parameter whose μ* is known to be far below the largest."""
    return np.asarray(sizes < NEGLIGIBLE * np.fmax.reduce(sizes))


def shares(table: Floats, paths: NDArray[np.int64]) -> list[tuple[Share, ...]] | None:
    """Return the shares of variance alone, in total and of Shapley of each group; None if one block decides them.

    Args:
        table, paths: as for `indices`.
    """
    from scipy.special import stdtrit

    moments = _moments(table, paths)
    mean, count = moments.mean(axis=0), len(moments)
    estimates, without_each = _shares_of(mean), _shares_of(mean + (mean - moments) / (count - 1))
    if np.isnan(without_each).any():
        return None
    scaled = estimates.copy()
    scaled[1], without_each[:, 1] = np.cbrt(estimates[1]), np.cbrt(without_each[:, 1])
    spread = without_each.std(axis=0)
    influence = (without_each - without_each.mean(axis=0)) / np.maximum(spread, np.finfo(float).tiny)
    freedom = np.clip(2 * count / np.maximum((influence**4).mean(axis=0) - 1, 1 / count), 1, count - 1)
    half = stdtrit(freedom, 0.975) * math.sqrt(count - 1) * spread
    low, high = scaled - half, scaled + half
    low[1], high[1] = np.maximum(low[1], 0.0) ** 3, high[1] ** 3
    by_group = np.stack([estimates, low, high], axis=-1).swapaxes(0, 1).tolist()
    return [tuple(Share(*numbers) for numbers in of_group) for of_group in by_group]


def indices(table: Floats, paths: NDArray[np.int64]) -> Floats:
    """Return the shares of variance alone, in total and of Shapley, (3, groups); NaN without a variance.

    Args:
        table: (n, 2 groups) scores of blocks: of A, of B, of A with each group from B, and between them along the path; with
            one group (n, 3).
        paths: (n, groups) the groups in the order in which they jump.
    """
    return _shares_of(_moments(table, paths).mean(axis=0))


def _moments(table: Floats, paths: NDArray[np.int64]) -> Floats:
    """Return the numbers of each block whose means decide the shares, (n, 3 + 4 groups)."""
    groups = paths.shape[1]
    first, second, mixed, between = np.split(table - table.mean(), (1, 2, 2 + groups), axis=1)
    jumped = np.take_along_axis(mixed, paths[:, :1], axis=1)
    steps = np.concatenate([first, jumped, between, second] if groups > 1 else [first, second], axis=1)
    before, after = steps[:, :-1], steps[:, 1:]
    growth = np.take_along_axis((before - after) * (first - (before + after) / 2), np.argsort(paths, axis=1), axis=1)
    change, both = mixed - first, (first**2 + second**2) / 2
    return np.hstack([(first + second) / 2, both, second, change, second * change, change**2 / 2, growth])


def _shares_of(means: Floats) -> Floats:
    """Return the shares of variance, (..., 3, groups), by means of moments, (..., 3 + 4 groups)."""
    middle, square, second = (means[..., [i]] for i in range(3))
    change, product, total, growth = np.split(means[..., 3:], 4, axis=-1)
    variance = square - middle**2
    divisor = np.where(variance > _ROUNDING * square, variance, np.nan)
    return np.asarray(np.stack([product - second * change, total, growth], axis=-2) / divisor[..., None])
