"""Is a requirement met? Counted on a listed grid, tested by whole units where variants are drawn at random.

The test may be looked at after any number of units and ended at any time. It bets on the mean score of each unit against
the hypothesis that the true mean is just at the bound: a player who cannot win on average multiplies a stake by 1/α with a
chance of at most α, however long the game (Ville 1939, *Étude critique de la notion de collectif*). The stakes are those of
the likelihood ratios q against the bound p, spread over many q; for scores between 0 and 1 the same bets stay fair when
they are linear in the score (Waudby-Smith & Ramdas 2024, doi:10.1093/jrsssb/qkad009). One game is played for each verdict,
and each has half of the level.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit, logsumexp, ndtri

from valerie.errors import InvalidInput
from valerie.statistics.observations import dense

#: Alternatives that each game bets on.
_BETS: Final = 48
#: Median distance of an alternative from the bound on the logit scale, and spread of its logarithm.
_DISTANCE: Final = 0.8
_SPREAD: Final = 0.8
#: Units whose bets are held in memory at once.
_BLOCK: Final = 4_096
#: Above this many further units, no run decides.
_MOST_UNITS: Final = 10_000_000


class Statistic(StrEnum):
    """Statistic that a requirement bounds from below."""

    MEAN = "mean"
    SHARE = "share"
    QUANTILE = "quantile"


class Outcome(StrEnum):
    MET = "met"
    NOT_MET = "not met"
    UNDECIDED = "undecided"


class Basis(StrEnum):
    """Subject of a verdict."""

    SAMPLE = "the space that the variants were drawn from"
    GRID = "the listed grid"


@dataclass(frozen=True, slots=True)
class Requirement:
    """A lower bound; build it with `mean_of`, `share_of` or `quantile_of`.

    Attributes:
        statistic: what is bounded.
        threshold: the score that a row has to reach; NaN for a mean.
        at_least: the bound p of the mean score, of the share of rows that reach the threshold, or 1 − q of a quantile.
        confidence: 1 − the chance of a false verdict.
    """

    statistic: Statistic
    threshold: float
    at_least: float
    confidence: float = 0.95

    def __post_init__(self) -> None:
        for field in ("at_least", "confidence"):
            if not 0 < getattr(self, field) < 1:
                raise InvalidInput("has to lie between 0 and 1", field=field, value=getattr(self, field))

    def scores(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the bound is on the mean of: the values, or 1 where they reach the threshold."""
        return values if self.statistic is Statistic.MEAN else (values >= self.threshold).astype(np.float64)


def mean_of(at_least: float, *, confidence: float = 0.95) -> Requirement:
    """Require mean(values) ≥ ``at_least``."""
    return Requirement(Statistic.MEAN, float("nan"), at_least, confidence)


def share_of(threshold: float, at_least: float, *, confidence: float = 0.95) -> Requirement:
    """Require share(values ≥ ``threshold``) ≥ ``at_least``."""
    return Requirement(Statistic.SHARE, threshold, at_least, confidence)


def quantile_of(order: float, at_least: float, *, confidence: float = 0.95) -> Requirement:
    """Require that the quantile of ``order`` is ≥ ``at_least``: share(values ≥ ``at_least``) ≥ 1 − ``order``."""
    return Requirement(Statistic.QUANTILE, at_least, 1 - order, confidence)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Evidence of the rows on a requirement.

    Attributes:
        outcome: met, not met or undecided.
        basis: what it speaks of.
        estimate: mean score; of a sample, each unit weighs the same. NaN without rows.
        units: units (of a grid: rows) that were looked at.
        decided_after: units after which the sequential test ended; None where it did not, and for a grid.
        further: further units that would decide it if the estimate is right; None where it is decided, or where no affordable
            number decides. Of a grid, the rows that are missing.
        p_met: anytime-valid p-value of "not met": small where the rows speak for met; 1 for a grid.
        p_not_met: the same of "met".
        undefined: rows without a value, which were left out.
    """

    outcome: Outcome
    basis: Basis
    estimate: float
    units: int
    decided_after: int | None
    further: int | None
    p_met: float
    p_not_met: float
    undefined: int


def judge_sample(requirement: Requirement, values: ArrayLike, units: ArrayLike) -> Verdict:
    """Judge variants that were drawn at random, independently; look as often as you like.

    Args:
        requirement: what to judge; of a region, give the rows in it.
        values: (N,) scores in 0…1; NaN where a row has none.
        units: (N,) whole numbers: the independent unit (place, variant) of each row, ascending in the order of drawing.
            All rows of a unit have to be there, or the unit has to wait.

    Returns:
        The verdict of the first unit that decided: later units do not change it, only the p-values.

    Raises:
        InvalidInput: a score lies outside 0…1, or the lengths differ.
    """
    rows, undefined, chosen = _defined(values, units)
    if not len(rows):
        return Verdict(Outcome.UNDECIDED, Basis.SAMPLE, float("nan"), 0, None, None, 1.0, 1.0, undefined)
    unit, occurring = dense(chosen)
    scores = np.bincount(unit, weights=requirement.scores(rows)) / np.bincount(unit)
    p, target = requirement.at_least, -float(np.log((1 - requirement.confidence) / 2))
    games = [_Game(_stakes(p, upward=upward)) for upward in (True, False)]
    for start in range(0, len(scores), _BLOCK):
        for game in games:
            game.play(scores[start : start + _BLOCK] - p, target)
    # Both games can end in theory; the first one stands.
    ends = [game.ended or len(scores) + 1 for game in games]
    outcome = Outcome.UNDECIDED if min(ends) > len(scores) else (Outcome.MET, Outcome.NOT_MET)[int(np.argmin(ends))]
    estimate = float(scores.mean())
    further = None
    if outcome is Outcome.UNDECIDED:
        game = games[0 if estimate >= p else 1]
        further = _forecast(game.capital, game.capital / len(scores), target)
    return Verdict(
        outcome,
        Basis.SAMPLE,
        estimate,
        len(occurring),
        None if outcome is Outcome.UNDECIDED else min(ends),
        further,
        games[0].p_value,
        games[1].p_value,
        undefined,
    )


def judge_grid(requirement: Requirement, values: ArrayLike, *, missing: int = 0) -> Verdict:
    """Judge a listed grid by counting: nothing was drawn, so nothing is uncertain but what is missing.

    Args:
        requirement: what to judge.
        values: (N,) scores in 0…1; NaN where a row has none for good.
        missing: rows of the grid that are still to come.

    Raises:
        InvalidInput: a score lies outside 0…1.
    """
    rows, undefined, _ = _defined(values, np.zeros(np.shape(values), np.int64))
    total, size = float(requirement.scores(rows).sum()), len(rows) + missing
    outcome = Outcome.UNDECIDED
    if size and total / size >= requirement.at_least:
        outcome = Outcome.MET
    elif size and (total + missing) / size < requirement.at_least:
        outcome = Outcome.NOT_MET
    estimate = total / len(rows) if len(rows) else float("nan")
    further = missing if outcome is Outcome.UNDECIDED else None
    return Verdict(outcome, Basis.GRID, estimate, len(rows), None, further, 1.0, 1.0, undefined)


def units_to_decide(requirement: Requirement, truth: float) -> int | None:
    """Return about how many units decide, said before a run; None where no affordable number does.

    It is the number after which the bets have grown to the limit on average, for units that pass or fail as a whole;
    units with several rows need no more.

    Args:
        requirement: what will be judged.
        truth: the true mean or share to be reckoned with, in 0…1.
    """
    p, target = requirement.at_least, -float(np.log((1 - requirement.confidence) / 2))
    stakes = _stakes(p, upward=truth >= p)
    growth = truth * np.log1p(stakes * (1 - p)) + (1 - truth) * np.log1p(-stakes * p)
    return _forecast(np.zeros(_BETS), growth, target)


class _Game:
    """One game.

    Attributes:
        capital: (B,) log capital of each bet.
        highest: the highest log of their mean so far.
        ended: units after which it reached the target; None before.
    """

    def __init__(self, stakes: NDArray[np.float64]) -> None:
        self._stakes = stakes
        self._played = 0
        self.capital = np.zeros(_BETS)
        self.highest = 0.0
        self.ended: int | None = None

    @property
    def p_value(self) -> float:
        """Anytime-valid p-value of the hypothesis that the game is played against."""
        return float(np.exp(-self.highest))

    def play(self, surplus: NDArray[np.float64], target: float) -> None:
        """Bet on the next units, whose scores lie ``surplus`` above the bound."""
        course = np.log1p(self._stakes[:, None] * surplus)
        course[:, 0] += self.capital
        np.cumsum(course, axis=1, out=course)
        self.capital = course[:, -1].copy()
        top = course.max(axis=0)
        together = top + np.log(np.exp(course - top).mean(axis=0))
        if self.ended is None and together.max() >= target:
            self.ended = self._played + int(np.argmax(together >= target)) + 1
        self.highest = max(self.highest, float(together.max()))
        self._played += len(surplus)


@cache
def _stakes(p: float, *, upward: bool) -> NDArray[np.float64]:
    """(B,) stakes λ = (q − p) / (p (1 − p)) of alternatives q on one side of the bound, log-normally distant in log-odds."""
    distance = _DISTANCE * np.exp(_SPREAD * ndtri((np.arange(_BETS) + 0.5) / _BETS))
    q = expit(logit(p) + (distance if upward else -distance))
    return np.asarray((q - p) / (p * (1 - p)))


def _forecast(capital: NDArray[np.float64], growth: NDArray[np.float64], target: float) -> int | None:
    """Units after which the mean of bets that grow at these rates reaches the target; None above the limit."""

    def reached(units: int) -> bool:
        return float(logsumexp(capital + units * growth)) - float(np.log(_BETS)) >= target

    if not reached(_MOST_UNITS):
        return None
    low, high = 0, _MOST_UNITS
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if reached(middle) else (middle, high)
    return high


def _defined(values: ArrayLike, units: ArrayLike) -> tuple[NDArray[np.float64], int, NDArray[np.int64]]:
    """Rows with a value, how many have none, and the units of those that have."""
    scores, codes = np.asarray(values, np.float64), np.asarray(units)
    if scores.shape != codes.shape:
        raise InvalidInput("needs one code per value", field="units", value=codes.shape, limit=scores.shape)
    known = np.isfinite(scores)
    rows = scores[known]
    if len(rows) and (rows.min() < 0 or rows.max() > 1):
        wrong = rows[(rows < 0) | (rows > 1)][0]
        raise InvalidInput("has to lie between 0 and 1", field="values", value=float(wrong))
    return rows, int(np.count_nonzero(~known)), codes[known].astype(np.int64)
