"""Verdicts: does a mean of scores reach a bound? Counted on a listed grid, tested by whole units where variants are drawn.

A share is the mean of scores that are 0 or 1, and a quantile reaches t where the share of values ≥ t is 1 − its order.

The test is sequential: it may be inspected after any number of units and stopped at any time. It bets on the mean score of
each unit against the hypothesis that the true mean equals the bound: a player who cannot win on average multiplies a stake
by 1/α with a chance of at most α, however long the game (Ville 1939, *Étude critique de la notion de collectif*). The
stakes are those of likelihood ratios of alternatives q to the bound p, spread over many q. For scores between 0 and 1,
bets that are linear in the score stay fair (Waudby-Smith & Ramdas 2024, doi:10.1093/jrsssb/qkad009). There is one game for
"met" and one for "not met", each with half of the error.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.statistics.intervals import Refusal, mean_interval
from valerie.statistics.observations import dense
from valerie.statistics.units import Estimand, Units

#: Alternatives that each game bets on.
_BETS: Final = 48
#: Median distance of an alternative from the bound in log-odds, and spread of the logarithm of that distance.
_DISTANCE: Final = 0.8
_SPREAD: Final = 0.8
#: Units whose bets are held in memory at once.
_BLOCK: Final = 4_096
#: Above this many further units, no run is affordable.
_MOST_UNITS: Final = 10_000_000
#: Part of the error that an interval over replicates uses: with all of it, the interval misses in up to 7 % instead of 5 %
#: (`make bench-findings`).
_EVEN: Final = 0.7
#: A sum that misses its bound by less than this per row misses it by rounding only.
_ROUNDING: Final = 1e-12


class Outcome(StrEnum):
    MET = "met"
    NOT_MET = "not met"
    UNDECIDED = "undecided"


class Basis(StrEnum):
    """Population that a verdict is about."""

    SAMPLE = "the space that the variants were drawn from"
    GRID = "the listed grid"


@dataclass(frozen=True, slots=True)
class Verdict:
    """Evidence of the rows on a requirement.

    Attributes:
        outcome: met, not met or undecided.
        basis: the population that it is about.
        estimate: mean score; in a sample, each unit weighs the same. NaN without rows.
        units: number of units (rows of a grid).
        decided_after: units after which the sequential test ended; None if it did not or there was none.
        further: further units that would decide if the estimate is right; None if it is decided or no affordable number
            suffices.
        p_met: anytime-valid p-value against "not met": small where the rows support "met"; 1 without a sequential test.
        p_not_met: the same against "met".
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


def judge_sample(scores: ArrayLike, units: ArrayLike, *, at_least: float, confidence: float = 0.95) -> Verdict:
    """Judge variants that were drawn independently at random, after any number of them.

    Args:
        scores: (N,) in 0…1; NaN where a row has none.
        units: (N,) whole numbers: the independent unit (place, variant) of each row, ascending in the order of drawing.
            Pass a unit only with all of its rows.
        at_least: the bound of the mean score, between 0 and 1.
        confidence: 1 − the chance of a false verdict.

    Returns:
        The verdict at the first unit that decided: later units change only the estimate and the p-values.

    Raises:
        InvalidInput: a score, the bound or the confidence is out of range, or the lengths differ.
    """
    _require_between(at_least=at_least, confidence=confidence)
    rows, undefined, chosen = _defined(scores, units)
    if not len(rows):
        return Verdict(Outcome.UNDECIDED, Basis.SAMPLE, float("nan"), 0, None, None, 1.0, 1.0, undefined)
    unit, occurring = dense(chosen)
    means = np.bincount(unit, weights=rows) / np.bincount(unit)
    target = -float(np.log((1 - confidence) / 2))
    games = [_Game(_stakes(at_least, upward=upward)) for upward in (True, False)]
    for start in range(0, len(means), _BLOCK):
        for game in games:
            game.play(means[start : start + _BLOCK] - at_least, target)
    # Both games can end in theory; the first to end decides.
    ends = [game.ended or len(means) + 1 for game in games]
    outcome = Outcome.UNDECIDED if min(ends) > len(means) else (Outcome.MET, Outcome.NOT_MET)[int(np.argmin(ends))]
    estimate = float(means.mean())
    further = None
    if outcome is Outcome.UNDECIDED:
        game = games[0 if estimate >= at_least else 1]
        further = _forecast(game.capital, game.capital / len(means), target)
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


def judge_even(
    scores: ArrayLike, units: ArrayLike, replicate: ArrayLike, *, at_least: float, confidence: float = 0.95
) -> Verdict:
    """Judge variants that an evenly spread design drew together, once: at the number of units that it was made for.

    The verdict follows from an interval over the design's replicates (`valerie.statistics.intervals`) that is a little wider
    than ``confidence`` asks for. Unlike a sequential test it must not be repeated with more units until it decides.

    Args:
        scores, units, at_least, confidence: as for `judge_sample`; the order does not matter.
        replicate: (N,) replicate of each row's unit.

    Raises:
        InvalidInput: as for `judge_sample`.
    """
    _require_between(at_least=at_least, confidence=confidence)
    rows, undefined, chosen = _defined(scores, units)
    unit, occurring = dense(chosen)
    of_unit = np.zeros(len(occurring), np.int64)
    of_unit[unit] = np.asarray(replicate)[np.isfinite(np.asarray(scores, np.float64))]
    means = np.bincount(unit, weights=rows) / np.bincount(unit) if len(rows) else rows
    index = np.arange(len(means), dtype=np.int64)
    units_drawn = Units(Estimand.DESIGN_BOX, index, len(means), of_unit)
    interval = mean_interval(means, units_drawn, level=1 - _EVEN * (1 - confidence))
    estimate = float("nan") if interval.estimate is None else interval.estimate
    outcome, further = Outcome.UNDECIDED, None
    if isinstance(interval, Refusal):
        further = interval.more_units
    elif interval.low >= at_least:
        outcome = Outcome.MET
    elif interval.high < at_least:
        outcome = Outcome.NOT_MET
    elif estimate != at_least:
        # The interval shrinks at least as fast as 1/√units.
        half = estimate - interval.low if estimate > at_least else interval.high - estimate
        needed = len(means) * (half / (estimate - at_least)) ** 2
        further = max(ceil(needed) - len(means), 1) if needed < _MOST_UNITS else None
    return Verdict(outcome, Basis.SAMPLE, estimate, len(means), None, further, 1.0, 1.0, undefined)


def judge_grid(scores: ArrayLike, *, at_least: float) -> Verdict:
    """Judge a listed grid by counting: nothing was drawn, so nothing is uncertain.

    Args:
        scores: (N,) in 0…1; NaN where a row has none.
        at_least: the bound of the mean score.

    Returns:
        The verdict; undecided without any score.

    Raises:
        InvalidInput: a score lies outside 0…1.
    """
    rows, undefined, _ = _defined(scores, np.zeros(np.shape(scores), np.int64))
    outcome = Outcome.UNDECIDED
    if len(rows):
        outcome = Outcome.MET if rows.sum() >= (at_least - _ROUNDING) * len(rows) else Outcome.NOT_MET
    estimate = float(rows.mean()) if len(rows) else float("nan")
    return Verdict(outcome, Basis.GRID, estimate, len(rows), None, None, 1.0, 1.0, undefined)


def units_to_decide(truth: float, *, at_least: float, confidence: float = 0.95) -> int | None:
    """Return about how many units a verdict needs, to plan a run; None if no affordable number suffices.

    It is the number after which the bets reach the limit on average, for units that pass or fail as a whole; units with
    several rows need no more.

    Args:
        truth: the assumed true mean, in 0…1.
        at_least, confidence: as for `judge_sample`.
    """
    _require_between(at_least=at_least, confidence=confidence)
    stakes = _stakes(at_least, upward=truth >= at_least)
    growth = truth * np.log1p(stakes * (1 - at_least)) + (1 - truth) * np.log1p(-stakes * at_least)
    return _forecast(np.zeros(_BETS), growth, -float(np.log((1 - confidence) / 2)))


class _Game:
    """One betting game.

    Attributes:
        capital: (B,) log capital of each bet.
        highest: highest log of the mean capital so far.
        ended: units after which the mean reached the target; None before.
    """

    def __init__(self, stakes: NDArray[np.float64]) -> None:
        self._stakes = stakes
        self._played = 0
        self.capital = np.zeros(_BETS)
        self.highest = 0.0
        self.ended: int | None = None

    @property
    def p_value(self) -> float:
        """Anytime-valid p-value of the hypothesis that the game bets against."""
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
    """Return (B,) stakes λ = (q − p) / (p (1 − p)) of alternatives q on one side of p, at log-normal distances in log-odds."""
    from scipy.special import expit, logit, ndtri

    distance = _DISTANCE * np.exp(_SPREAD * ndtri((np.arange(_BETS) + 0.5) / _BETS))
    q = expit(logit(p) + (distance if upward else -distance))
    return np.asarray((q - p) / (p * (1 - p)))


def _forecast(capital: NDArray[np.float64], growth: NDArray[np.float64], target: float) -> int | None:
    """Return the units after which the mean of bets that grow at these rates reaches the target; None above the limit."""
    from scipy.special import logsumexp

    def reached(units: int) -> bool:
        return float(logsumexp(capital + units * growth)) - float(np.log(_BETS)) >= target

    if not reached(_MOST_UNITS):
        return None
    low, high = 0, _MOST_UNITS
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if reached(middle) else (middle, high)
    return high


def _require_between(**numbers: float) -> None:
    for field, value in numbers.items():
        if not 0 < value < 1:
            raise InvalidInput("has to lie between 0 and 1", field=field, value=value)


def _defined(scores: ArrayLike, units: ArrayLike) -> tuple[NDArray[np.float64], int, NDArray[np.int64]]:
    """Return the scores that are known, how many are not, and the units of those that are."""
    values, codes = np.asarray(scores, np.float64), np.asarray(units)
    if values.shape != codes.shape:
        raise InvalidInput("needs one code per score", field="units", value=codes.shape, limit=values.shape)
    known = np.isfinite(values)
    rows = values[known]
    if len(rows) and (rows.min() < 0 or rows.max() > 1):
        wrong = rows[(rows < 0) | (rows > 1)][0]
        raise InvalidInput("has to lie between 0 and 1", field="scores", value=float(wrong))
    return rows, int(np.count_nonzero(~known)), codes[known].astype(np.int64)
