"""The interface of a strategy, which proposes points of the unit cube and learns their outcomes.

A *score* is a number; a *failure* is a score below the strategy's bound. NaN is an undefined score, which neither passes nor
fails. A variant without any outcome, because a worker died, is evaluated again; the strategy is never told of it. A rejected
variant has no score either; the operational domain contains only legal variants (`Domain.legal`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.parameters.samplers import UnitPoints

#: (n,) float64 scores; NaN where a score is undefined.
Scores = NDArray[np.float64]


class Why(StrEnum):
    """Names of the reasons of the built-in strategies."""

    FIRST = "first points"
    UNMODELLED = "too few scores for a model"
    JUDGING = "points for the test"
    PAIRING = "points for both functions"
    DOUBTFUL = "points where the model is unsure"
    FIRST_SCORES = "first scores are missing"
    SEARCH = "search for failures"
    BORDER = "search for the border"
    SCREENING = "screening of parameters"
    SCREENING_SCORES = "screening scores are missing"
    BLOCKS = "blocks for the indices"
    ILLEGAL_BLOCKS = "too many blocks have illegal variants"
    DECIDED = "decided"
    NARROW = "narrow enough"
    CHEAP = "points for the cheap engine"
    COSTLY = "points for the costly engine"
    DRAWN = "search for a failure and a pass"
    GIVEN = "the given variants"
    VERDICTS = "verdicts are missing"
    NO_PAIR = "the given variants do not fail and pass"
    NEEDED = "changes that the failure needs"
    BOUNDARY = "changes until the verdict flips"
    REMOVAL = "failure without one of the changes"
    MINIMAL = "the pair is minimal"


@dataclass(frozen=True, slots=True)
class Reason:
    """The reason for a batch, or for no more points. `valerie.studies.wording` puts it into words.

    The numbers of a batch say what was known, what is uncertain, and what the batch decides.

    Attributes:
        name: one of `Why`, or a name of another strategy's own.
        numbers: numbers that belong to it, by name; NaN where one is unknown.
        parameters: dimensions that it is about.
    """

    name: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    parameters: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Proposal:
    """A batch that a strategy asks for.

    Attributes:
        points: (n, dimensions). No points mean that the strategy waits for the next `tell`, or has ended if no batch is
            open. A repeated point is evaluated under another random seed, unless its ``level`` differs.
        reason: reason for these points, or for none.
        level: 0 for the usual render engine, 1 for the costly one.
    """

    points: UnitPoints
    reason: Reason
    level: int = 0

    def __len__(self) -> int:
        return len(self.points)


class Result:
    """Base class of the results of strategies: frozen dataclasses of numbers, enums and points."""

    __slots__ = ()

    def sentences(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the result in words, the most important sentence first; by default, the numbers by name.

        `valerie.studies.wording` has the words for the built-in strategies, which know the measure.

        Args:
            names: names of the parameters, by dimension.
        """
        del names
        values = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        return tuple(
            f"{name.replace('_', ' ').capitalize()}: {value:g}."
            for name, value in values.items()
            if isinstance(value, int | float)
        )


class Strategy(Protocol):
    """A strategy. Its proposals depend only on its arguments and the history of `ask` and `tell`."""

    @property
    def result(self) -> Result | None:
        """The result from all scores so far; None before there is one."""
        ...

    def ask(self, count: int) -> Proposal:
        """Return the next batch, of at most ``count`` points."""
        ...

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Add the scores of the oldest open batch: (n,), or (n, k) for a strategy with ``columns`` = k.

        Raises:
            InvalidInput: these are other points, or not one score for each.
        """
        ...


class StrategyFactory(Protocol):
    """A strategy of another package, offered as an entry point of the group ``valerie.strategies``: mostly its class."""

    def __call__(self, domain: Any, *, at_least: float, seed: int, **options: Any) -> Strategy:
        """Return the strategy.

        Args:
            domain: the operational domain, a `valerie.guided.domain.Domain`.
            at_least: scores in 0…1 below it fail.
            seed: of all draws.
            options: those of the study's goal.

        Raises:
            InvalidInput: an option is out of range.
        """
        ...


class OpenBatches:
    """The batches of a strategy without outcomes, oldest first.

    Args:
        columns: number of scores of each point.
        bounded: True if scores lie in 0…1.
    """

    def __init__(self, columns: int = 1, *, bounded: bool = True) -> None:
        self._columns, self._bounded = columns, bounded
        self._batches: deque[UnitPoints] = deque()

    def __len__(self) -> int:
        return len(self._batches)

    def add(self, points: UnitPoints, reason: Reason, level: int = 0) -> Proposal:
        """Return a proposal of the points, and open a batch of them unless it is empty."""
        if len(points):
            self._batches.append(points.copy())
        return Proposal(points, reason, level)

    def close(self, points: UnitPoints, scores: ArrayLike) -> Scores:
        """Close the oldest batch and return its checked scores.

        Raises:
            InvalidInput: these are other points, not one score for each, or a score outside 0…1 or infinite.
        """
        if not self._batches or not np.array_equal(self._batches[0], points):
            raise InvalidInput("not the points of the oldest batch without scores", field="points", value=len(points))
        values = np.asarray(scores, np.float64)
        shape = (len(points),) if self._columns == 1 else (len(points), self._columns)
        if values.shape != shape:
            raise InvalidInput("one score for each point", field="scores", value=values.shape, limit=shape)
        if np.isinf(values).any():
            raise InvalidInput("a score is finite, or NaN where it is undefined", field="scores", value="infinite")
        if self._bounded and ((values < 0) | (values > 1)).any():
            raise InvalidInput("a score lies in 0…1", field="scores", value=float(np.nanmax(np.abs(values))))
        self._batches.popleft()
        return values


def pursue(strategy: Strategy, measure: Callable[[UnitPoints], ArrayLike], *, budget: int, batch: int) -> int:
    """Ask, measure and tell until the strategy ends or the budget is spent.

    Args:
        strategy: the strategy to pursue.
        measure: maps (n, dimensions) points to scores for `tell`, NaN where undefined.
        budget: largest number of evaluations.
        batch: largest number of points at a time.

    Returns:
        The number of evaluations.
    """
    spent = 0
    while spent < budget:
        points = strategy.ask(min(batch, budget - spent)).points
        if not len(points):
            break
        strategy.tell(points, measure(points))
        spent += len(points)
    return spent
