"""Minimal pairs: the smallest part of the difference between a failing and a passing variant that still flips the verdict.

First, QuickXplain (Junker 2004, AAAI, 167-172) reduces the changed parameters to a set in which all are needed. Then the
numbers among them move together towards the passing variant until they come within `TOLERANCE` of the boundary. Finally,
each remaining change is undone separately; if the variant still fails, the change is dropped and the numbers move on. The
result is minimal with respect to single removals, but not necessarily the smallest possible set.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.guided.domain import Axis, Domain
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Why
from valerie.parameters.samplers import UnitPoints

#: Largest distance of the failing variant from the boundary in any number, as a share of the domain.
TOLERANCE: Final = 0.01


class Verdict(StrEnum):
    """The verdict on one variant."""

    PASS = "pass"  # noqa: S105  not a password
    FAIL = "fail"
    #: Its score is undefined.
    UNDEFINED = "undefined"


@dataclass(frozen=True, slots=True)
class MinimalPair(Result):
    """A failing variant that differs minimally from a passing one.

    Attributes:
        passing: (dimensions,) the passing variant.
        failing: (dimensions,) the failing variant.
        changed: dimensions in which they differ; without any one of these changes, the variant does not fail.
        inner: (dimensions,) the variant just before the boundary: it does not fail, and is within `TOLERANCE` of
            ``failing`` in every number, or within one step. Equal to ``passing`` where only unordered values change.
        inner_verdict: verdict on ``inner``: ``pass``, or ``undefined`` where the failure borders on undefined scores.
        evaluations: number of variants evaluated, without the first two.
    """

    passing: UnitPoints
    failing: UnitPoints
    changed: tuple[int, ...]
    inner: UnitPoints
    inner_verdict: Verdict
    evaluations: int


_Evaluating = Generator[list[UnitPoints], None, None]


class Explain:
    """Strategy that finds a minimal pair.

    Args:
        domain: of both variants.
        failing, passing: (dimensions,) points with known verdicts.
        at_least: scores below it fail.
        batch: number of variants that can be evaluated at the same time. 1 needs the fewest evaluations; larger batches
            need fewer rounds, since both halves of a set are tried together and the path to the boundary is divided into
            more parts.

    Attributes:
        result: the pair; None while the search goes on.

    Raises:
        InvalidInput: the variants do not differ, or have other dimensions than the domain.
    """

    def __init__(
        self, domain: Domain, failing: ArrayLike, passing: ArrayLike, *, at_least: float, batch: int = 1
    ) -> None:
        self.domain, self.at_least, self.batch = domain, at_least, batch
        self.result: MinimalPair | None = None
        ends = np.array([np.asarray(failing, np.float64), np.asarray(passing, np.float64)])
        if ends.shape != (2, domain.dimensions):
            raise InvalidInput("not of this domain", field="failing", value=ends.shape[1:], limit=domain.dimensions)
        self._failing: UnitPoints
        self._passing: UnitPoints
        self._failing, self._passing = domain.snapped(ends)
        if not self._changed(self._failing):
            raise InvalidInput("the failing and the passing variant do not differ", field="failing")
        self._numbers = np.array([axis is not Axis.UNORDERED for axis in domain.axes])
        self._verdicts = {self._failing.tobytes(): Verdict.FAIL, self._passing.tobytes(): Verdict.PASS}
        self._open = OpenBatches(bounded=False)
        self._evaluations = 0
        self._step = Reason(Why.NEEDED, parameters=tuple(self._changed(self._failing)))
        self._search = self._minimize()
        self._wanted = next(self._search, [])

    def ask(self, count: int) -> Proposal:
        """Return the next variants to evaluate."""
        points, self._wanted = self._wanted[:count], self._wanted[count:]
        reason = replace(self._step, numbers={"points": len(points)}) if points else Reason(Why.VERDICTS)
        if self.result is not None:
            reason = Reason(Why.MINIMAL)
        return self._open.add(np.array(points).reshape(-1, self.domain.dimensions), reason)

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none."""
        for point, score in zip(points, self._open.close(points, scores).tolist(), strict=True):
            verdict = Verdict.FAIL if score < self.at_least else Verdict.PASS
            self._verdicts[point.tobytes()] = Verdict.UNDEFINED if math.isnan(score) else verdict
        self._evaluations += len(points)
        if not self._open and not self._wanted:
            self._wanted = next(self._search, [])

    def _minimize(self) -> _Evaluating:
        needed = yield from self._needed([], self._changed(self._failing))
        failing = self._with(needed)
        while True:
            self._step = Reason(Why.BOUNDARY, parameters=tuple(self._changed(failing)))
            failing, inner = yield from self._to_boundary(failing)
            self._step = Reason(Why.REMOVAL, parameters=tuple(self._changed(failing)))
            removals = []
            for dimension in self._changed(failing):
                removals.append(failing.copy())
                removals[-1][dimension] = self._passing[dimension]
            yield from self._evaluate(removals)
            smaller = [point for point in removals if self._fails(point)]
            if not smaller:
                break
            failing = smaller[0]
        self.result = MinimalPair(
            self._passing,
            failing,
            tuple(self._changed(failing)),
            inner,
            self._verdicts[inner.tobytes()],
            self._evaluations,
        )

    def _needed(self, kept: list[int], changes: list[int]) -> Generator[list[UnitPoints], None, list[int]]:
        """Return a minimal part of ``changes`` that fails together with ``kept``, as all of ``changes`` do."""
        if len(changes) == 1:
            return changes
        first, second = changes[: len(changes) // 2], changes[len(changes) // 2 :]
        halves = [self._with(kept + half) for half in (first, second)]
        yield from self._evaluate(halves[: self.batch])
        for half, point in zip((first, second), halves[: self.batch], strict=False):
            if self._fails(point):
                return (yield from self._needed(kept, half))
        of_second = yield from self._needed(kept + first, second)
        point = self._with(kept + of_second)
        yield from self._evaluate([point])
        if self._fails(point):
            return of_second
        return of_second + (yield from self._needed(kept + of_second, first))

    def _to_boundary(self, failing: UnitPoints) -> Generator[list[UnitPoints], None, tuple[UnitPoints, UnitPoints]]:
        """Return the failing and the non-failing variant on both sides of the boundary."""
        steps = np.where(self._numbers, self.domain.steps(self._passing, failing), 0.0)
        low, high = 0.0, 1.0
        inner = np.where(self._numbers, self._passing, failing)
        yield from self._evaluate([inner])
        if self._fails(inner):  # the numbers are not needed
            return inner, self._passing
        if not steps.any():
            return failing, self._passing
        while (high - low) * np.abs(steps).max() > TOLERANCE:
            rounds = math.ceil(math.log((high - low) * np.abs(steps).max() / TOLERANCE, self.batch + 1) - 1e-9)
            parts = math.ceil(((high - low) * np.abs(steps).max() / TOLERANCE) ** (1 / rounds) - 1e-9)
            shares = [low + (high - low) * part / parts for part in range(1, parts)]
            points = list(self.domain.snapped(self._wrapped(failing, np.array(shares)[:, None] * steps)))
            yield from self._evaluate(points)
            ends = [(low, inner), *zip(shares, points, strict=True), (high, failing)]
            fails = next(place for place, (_, point) in enumerate(ends) if self._fails(point))
            (low, inner), (high, failing) = ends[fails - 1], ends[fails]
        return failing, inner

    def _wrapped(self, failing: UnitPoints, ways: NDArray[np.float64]) -> UnitPoints:
        points = np.where(self._numbers, self._passing, failing) + ways
        return np.asarray(np.where(self.domain.periodic, points % 1.0, points))

    def _with(self, changes: list[int]) -> UnitPoints:
        point: UnitPoints = self._passing.copy()
        point[changes] = self._failing[changes]
        return point

    def _changed(self, point: UnitPoints) -> list[int]:
        return [int(dimension) for dimension in np.flatnonzero(point != self._passing)]

    def _evaluate(self, points: list[UnitPoints]) -> _Evaluating:
        """Request the missing verdicts of points."""
        new = {point.tobytes(): point for point in points if point.tobytes() not in self._verdicts}
        if new:
            yield list(new.values())

    def _fails(self, point: UnitPoints) -> bool:
        return self._verdicts[point.tobytes()] is Verdict.FAIL
