"""Failures and their distinct modes.

A *mode* is a connected set of failures: variants between two of them fail as well. The strategy counts modes instead of
failures, since many failures with one cause teach little.

Most points explore: they are scrambled Sobol' points of the operational domain, so likely modes are hit first. The others
descend. A descent starts at a point with a low score and no better point nearby (nearest-better distance: Preuss 2010,
doi:10.1007/978-3-642-12239-2_40). It ends at once if scores fall on the way from there to a known mode. Each round draws
candidates around its best point that differ in a few coordinates, and asks for those to which a linear radial basis
function, fitted to the evaluated points nearby, gives the lowest scores (Regis and Shoemaker 2013,
doi:10.1080/0305215X.2012.687731). Covariates are further coordinates of that function. A descent without improvement
halves its reach, and ends after `PATIENCE` such rounds.

A failure counts once it has failed under further random seeds. It belongs to a mode if the variant halfway to a member of
the mode fails too. So a bent mode may count as several, and modes that touch as one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.guided.domain import Axis, Cube, Domain
from valerie.guided.exploration import SpaceFilling
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Why
from valerie.guided.surrogate import margins
from valerie.parameters.samplers import UnitPoints

Floats = NDArray[np.float64]

#: Largest share of a batch for descents.
DESCENDING: Final = 0.4
#: Largest share of a batch for the checks of failures.
CHECKING: Final = 0.2
#: Exploring points before the first descent.
FIRST: Final = 128
#: Points of a descent in each round.
ROUND: Final = 4
#: Rounds without improvement after which a descent ends.
PATIENCE: Final = 2
#: A start with a better point within this distance is skipped; in median distances between explored points.
NEARBY: Final = 0.3
#: Share of the passing points, those with the lowest scores, among which starts are sought.
LOWEST: Final = 0.1
#: Modes that a point is compared with at a time.
COMPARED: Final = 3
#: Standard deviation of a mode's members below which a parameter matters to it.
NARROW: Final = 0.2
#: Fewest members for the shape of a mode.
MEMBERS: Final = 3
#: Radii of a mode within which a point with a low score belongs to it.
_SLOPE: Final = 1.5
_REACH: Final = 0.3
_CANDIDATES: Final = 100
_NEIGHBOURS: Final = 60
#: Smaller improvements of a margin do not count.
_LEAST: Final = 0.02
_BELOW_ONE: Final = float(np.nextafter(1.0, 0.0))


@dataclass(frozen=True, slots=True)
class Mode:
    """A mode of failures.

    Attributes:
        example: (dimensions,) the member nearest to the middle of all.
        narrow: dimensions in which its members are similar, so these parameters matter; empty below `MEMBERS` members.
        failures: number of its members.
        explored: members among the points that explored.
        probability: share of the explored points, an estimate of the mode's probability in operation; 0 if only a
            descent met it.
    """

    example: UnitPoints
    narrow: tuple[int, ...]
    failures: int
    explored: int
    probability: float


@dataclass(frozen=True, slots=True)
class Modes(Result):
    """The modes so far.

    Attributes:
        modes: likely ones first.
        failures: number of variants that failed under every seed.
        unplaced: number of these that are not yet compared with all modes.
        unrepeated: failures that did not repeat under another seed.
        explored: number of points that explored.
        smallest: smallest probability of a mode that they hit with 95 % probability.
        evaluations: number of all points.
    """

    modes: tuple[Mode, ...]
    failures: int
    unplaced: int
    unrepeated: int
    explored: int
    smallest: float
    evaluations: int


@dataclass(slots=True, eq=False)
class _Descent:
    """A descent: its best row, the reach of its candidates, and the state of its round."""

    best: int
    reach: float = _REACH
    compared: bool = False
    known: bool = False
    rounds: int = 0
    misses: int = 0
    waiting: int = 0
    improved: bool = False


@dataclass(slots=True, eq=False)
class _Failure:
    """A failure under examination: requested and confirmed repeats, and modes that it does not belong to."""

    row: int
    asked: int = 0
    repeated: int = 0
    waiting: int = 0
    apart: set[int] = field(default_factory=set)
    joined: int | None = None


@dataclass(frozen=True, slots=True)
class _Tag:
    """The purpose of a point: for a descent or a failure; halfway to a mode, or not."""

    descent: _Descent | None = None
    failure: _Failure | None = None
    mode: int | None = None


_EXPLORES: Final = _Tag()


class Find:
    """Strategy that finds failures and their modes.

    Args:
        domain: the operational domain.
        at_least: scores in [0, 1] below it fail.
        seed: of all draws.
        repeats: further seeds under which a failure must fail; 0 if nothing is random. Evaluate a repeated point under
            another seed.
        covariates: (n, dimensions) points to (n, k) free numbers of about 0…1, e.g. distances.
        descending: share of a batch for descents, at most.

    Raises:
        InvalidInput: a bound outside 0…1, or negative repeats.
    """

    def __init__(
        self,
        domain: Cube,
        *,
        at_least: float,
        seed: int,
        repeats: int = 1,
        covariates: Callable[[UnitPoints], Floats] | None = None,
        descending: float = DESCENDING,
    ) -> None:
        if not 0 < at_least < 1:
            raise InvalidInput("a bound of scores in 0…1", field="at_least", value=at_least, limit="above 0, below 1")
        if repeats < 0:
            raise InvalidInput("a number of seeds", field="repeats", value=repeats, limit=">= 0")
        self.domain, self.at_least, self.seed, self.repeats = domain, at_least, seed, repeats
        self._covariates, self._descending = covariates, descending
        self._numbers = np.ones(domain.dimensions, np.bool_)
        if isinstance(domain, Domain):
            self._numbers = np.array([axis is not Axis.UNORDERED for axis in domain.axes])
        self._exploration = SpaceFilling(domain, seed)
        self._open = OpenBatches()
        self._tags: deque[list[_Tag]] = deque()
        self._asked = 0
        self._points = np.empty((0, domain.dimensions))
        self._features = np.empty((0, 0))
        self._margins = np.empty(0)
        self._explores = np.empty(0, np.bool_)
        self._evaluations = self._unrepeated = 0
        self._descents: list[_Descent] = []
        self._started: set[int] = set()
        self._failures: list[_Failure] = []
        self._modes: list[list[int]] = []

    def ask(self, count: int) -> Proposal:
        """Return the next batch."""
        rng = np.random.default_rng([self.seed, 1, self._asked])
        self._asked += 1
        wanted = self._checks(int(CHECKING * count))
        checks = len(wanted)
        if np.count_nonzero(self._explores) >= FIRST:
            wanted += self._descend(rng, min(int(self._descending * count), count - checks))
        descending = len(wanted) - checks
        explores = self._exploration.take(count - len(wanted))
        points = np.concatenate(
            [np.array([point for point, _ in wanted]).reshape(-1, self.domain.dimensions), explores]
        )
        self._tags.append([tag for _, tag in wanted] + [_EXPLORES] * len(explores))
        numbers = {"exploring": len(explores), "descending": descending, "low": len(self._descents), "checking": checks}
        return self._open.add(points, Reason(Why.SEARCH, numbers))

    def tell(self, points: UnitPoints, scores: ArrayLike) -> None:
        """Take the scores of the oldest batch that has none.

        Raises:
            InvalidInput: these are other points, not one score for each, or a score outside 0…1.
        """
        values = self._open.close(points, scores)
        tags = self._tags.popleft()
        self._evaluations += len(points)
        fails = values < self.at_least
        new = np.array([tag.failure is None or tag.mode is not None for tag in tags], np.bool_)
        rows = len(self._points) + np.cumsum(new) - 1
        self._points = np.concatenate([self._points, points[new]])
        self._features = self._with_covariates(points[new], self._features)
        self._margins = np.concatenate([self._margins, margins(values[new], self.at_least)])
        self._explores = np.concatenate([self._explores, np.array([tag is _EXPLORES for tag in tags])[new]])
        for tag, row, failed in zip(tags, rows.tolist(), fails.tolist(), strict=True):
            if tag.failure is not None:
                self._examined(tag.failure, tag.mode, row, failed=failed)
                continue
            if failed and tag.mode is None:
                self._failures.append(_Failure(row))
            if tag.descent is not None:
                self._descended(tag.descent, tag.mode, row)
        self._descents = [descent for descent in self._descents if self._goes_on(descent)]
        self._place()

    def _with_covariates(self, points: UnitPoints, before: Floats | None = None) -> Floats:
        features = self.domain.features(points)
        if self._covariates is not None:
            features = np.column_stack([features, self._covariates(points)])
        return features if before is None or not len(before) else np.concatenate([before, features])

    def _checks(self, count: int) -> list[tuple[UnitPoints, _Tag]]:
        """Return repeats of new failures, and points halfway to modes."""
        wanted: list[tuple[UnitPoints, _Tag]] = []
        for failure in self._failures:
            if len(wanted) >= count:
                break
            if failure.joined is not None or failure.waiting:
                continue
            if failure.asked < self.repeats:
                failure.asked += 1
                failure.waiting += 1
                wanted.append((self._points[failure.row], _Tag(failure=failure)))
                continue
            left = [mode for mode in self._likely(failure.row) if mode not in failure.apart]
            for mode in left[: COMPARED if failure.apart else 1]:
                halfway = self._halfway(failure.row, mode)
                if halfway is None:
                    failure.apart.add(mode)
                    continue
                failure.waiting += 1
                wanted.append((halfway, _Tag(failure=failure, mode=mode)))
        return wanted

    def _likely(self, row: int) -> list[int]:
        """Return the modes, the one that most likely contains a point first."""
        return sorted(range(len(self._modes)), key=lambda mode: self._strangeness(self._points[row], mode))

    def _shape(self, mode: int) -> tuple[Floats, Floats]:
        """Return mean and variance of a mode's members; with few members the variance shrinks towards that of the domain."""
        members = self._points[self._modes[mode]]
        middle = members.mean(axis=0)
        return middle, (((members - middle) ** 2).sum(axis=0) + 3 / 12) / (len(members) + 3)

    def _strangeness(self, point: UnitPoints, mode: int) -> float:
        middle, variance = self._shape(mode)
        return float(((point - middle) ** 2 / variance + np.log(variance)).sum())

    def _halfway(self, row: int, mode: int) -> UnitPoints | None:
        """Return the legal point between a failure and the nearest member of a mode; None without one."""
        point, members = self._points[row], self._points[self._modes[mode]]
        ways = self.domain.steps(point, members) if isinstance(self.domain, Domain) else members - point
        nearest = int(np.argmin((ways**2).sum(axis=1)))
        halfway = point + np.where(self._numbers, ways[nearest] / 2, 0.0)
        if isinstance(self.domain, Domain):
            halfway = np.where(self.domain.periodic, halfway % 1.0, halfway)
        return halfway if self.domain.legal(halfway[None])[0] else None

    def _examined(self, failure: _Failure, mode: int | None, row: int, *, failed: bool) -> None:
        failure.waiting -= 1
        if mode is None:
            failure.repeated += failed
            if not failed:
                self._unrepeated += 1
                self._failures.remove(failure)
        elif not failed:
            failure.apart.add(mode)
        elif failure.joined is None:
            failure.joined = mode
            self._modes[mode] += [failure.row, row]

    def _place(self) -> None:
        """Put failures into modes, or begin new ones."""
        for failure in self._failures:
            ready = failure.joined is None and not failure.waiting and failure.repeated >= self.repeats
            if ready and len(failure.apart) == len(self._modes):
                failure.joined = len(self._modes)
                self._modes.append([failure.row])

    def _descend(self, rng: np.random.Generator, count: int) -> list[tuple[UnitPoints, _Tag]]:
        resting = [descent for descent in self._descents if not descent.waiting]
        missing = count // (ROUND - 1) - len(resting)
        if missing > 0:
            begun = [_Descent(row) for row in self._starts(missing)]
            self._descents += begun
            resting += begun
        wanted: list[tuple[UnitPoints, _Tag]] = []
        for descent in resting:
            tagged = self._comparisons(descent)
            if not tagged:
                tagged = [(point, _Tag(descent=descent)) for point in self._round(rng, descent)]
                descent.rounds += 1
            if len(wanted) + len(tagged) > count:
                break
            descent.waiting, descent.improved, descent.compared = len(tagged), False, True
            wanted += tagged
        return wanted

    def _comparisons(self, descent: _Descent) -> list[tuple[UnitPoints, _Tag]]:
        """Return the points halfway from a new start to the modes that most likely contain it."""
        if descent.compared:
            return []
        halfway = {mode: self._halfway(descent.best, mode) for mode in self._likely(descent.best)[:COMPARED]}
        return [(point, _Tag(descent=descent, mode=mode)) for mode, point in halfway.items() if point is not None]

    def _starts(self, count: int) -> list[int]:
        """Return rows with low scores and no better point nearby, lowest first."""
        defined = np.flatnonzero(~np.isnan(self._margins))
        if len(defined) < _NEIGHBOURS:
            return []
        order = defined[np.argsort(self._margins[defined], kind="stable")]
        nearby = (NEARBY * self._usual_distance(defined)) ** 2
        passing = order[self._margins[order] >= 0]
        lowest = passing[: int(LOWEST * len(passing))]
        lowest = lowest[~self._on_known_slopes(self._points[lowest])]
        chosen: list[int] = []
        for row in lowest.tolist():
            if len(chosen) == count:
                break
            if row in self._started:
                continue
            better = order[self._margins[order] < self._margins[row]]
            if (((self._features[better] - self._features[row]) ** 2).sum(axis=1) >= nearby).all():
                self._started.add(row)
                chosen.append(row)
        return chosen

    def _usual_distance(self, defined: NDArray[np.int64]) -> float:
        """Return the median distance from an explored point to the next one."""
        explored = defined[self._explores[defined]]
        some = self._features[explored[:: max(len(explored) // 64, 1)]]
        others = self._features[explored]
        squares = (some**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2 * some @ others.T
        return float(np.sqrt(np.median(np.partition(np.maximum(squares, 0), 1, axis=1)[:, 1])))

    def _on_known_slopes(self, points: UnitPoints) -> NDArray[np.bool_]:
        lies = np.zeros(len(points), np.bool_)
        for mode, members in enumerate(self._modes):
            middle, variance = self._shape(mode)
            narrow = variance < NARROW**2
            if len(members) >= MEMBERS and narrow.any():
                # A ball of radius r has the variance r² / (k + 2) in each of its k dimensions.
                radii = ((points - middle) ** 2 / variance)[:, narrow].sum(axis=1) / (narrow.sum() + 2)
                lies |= radii < _SLOPE**2
        return lies

    def _round(self, rng: np.random.Generator, descent: _Descent) -> UnitPoints:
        """Return the candidates around a descent's best point with the lowest scores by a local model."""
        from scipy.interpolate import RBFInterpolator

        best = self._points[descent.best]
        defined = np.flatnonzero(~np.isnan(self._margins))
        squares = ((self._features[defined] - self._features[descent.best]) ** 2).sum(axis=1)
        near = defined[np.argsort(squares, kind="stable")[:_NEIGHBOURS]]
        shape = (_CANDIDATES, self.domain.dimensions)
        moved = rng.random(shape) < max(0.3, 2 / self.domain.dimensions)
        moved[np.arange(_CANDIDATES), rng.integers(0, self.domain.dimensions, _CANDIDATES)] = True
        drawn = np.where(self._numbers, best + descent.reach * rng.standard_normal(shape), rng.random(shape))
        candidates = np.where(moved, drawn, best)
        if isinstance(self.domain, Domain):
            candidates = np.where(self.domain.periodic, candidates % 1.0, candidates)
        candidates = np.abs(candidates)  # reflected where they leave the domain
        candidates = np.clip(np.where(candidates > 1, 2 - candidates, candidates), 0, _BELOW_ONE)
        candidates = candidates[self.domain.legal(candidates)]
        if len(candidates) <= ROUND:
            return candidates
        model = RBFInterpolator(self._features[near], self._margins[near], kernel="linear", smoothing=1e-3, degree=0)
        predicted = model(self._with_covariates(candidates))
        chosen: list[int] = []
        for row in np.argsort(predicted, kind="stable").tolist():
            gaps = [np.abs(candidates[row] - candidates[other]).max() for other in chosen]
            if not gaps or min(gaps) > 0.2 * descent.reach:
                chosen.append(row)
            if len(chosen) == ROUND:
                break
        return candidates[chosen]

    def _descended(self, descent: _Descent, mode: int | None, row: int) -> None:
        descent.waiting -= 1
        if mode is not None:  # scores fall on the way to a known mode
            descent.known |= bool(self._margins[row] < self._margins[descent.best])
        elif self._margins[row] < self._margins[descent.best] - _LEAST:
            descent.best, descent.improved = row, True

    def _goes_on(self, descent: _Descent) -> bool:
        if descent.waiting:
            return True
        if descent.known or self._margins[descent.best] < 0:
            return False
        if descent.improved:
            return True
        if descent.rounds:
            descent.misses += 1
            descent.reach /= 2
        return descent.misses < PATIENCE

    @property
    def result(self) -> Modes | None:
        """The modes so far; None before any score."""
        if not self._evaluations:
            return None
        explored = int(np.count_nonzero(self._explores))
        modes = sorted(
            (self._described(number, explored) for number in range(len(self._modes))),
            key=lambda mode: (-mode.probability, -mode.failures),
        )
        repeated = sum(failure.repeated >= self.repeats for failure in self._failures)
        unplaced = sum(failure.joined is None for failure in self._failures)
        smallest = 1 - 0.05 ** (1 / explored) if explored else 1.0
        return Modes(
            tuple(modes),
            repeated,
            unplaced,
            self._unrepeated,
            explored,
            smallest,
            self._evaluations,
        )

    def _described(self, number: int, explored: int) -> Mode:
        members = self._modes[number]
        points = self._points[members]
        middle = int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1)))
        narrow = (
            np.flatnonzero(self._shape(number)[1] < NARROW**2) if len(members) >= MEMBERS else np.empty(0, np.int64)
        )
        hits = int(np.count_nonzero(self._explores[members]))
        return Mode(points[middle], tuple(narrow.tolist()), len(members), hits, hits / max(explored, 1))
