"""Failures and their distinct modes.

A *mode* is a connected set of failures: variants between two of them fail as well. The strategy counts modes instead of
failures, since many failures with one cause teach little.

Most points explore: they are scrambled Sobol' points of the operational domain, so likely modes are hit first. The others
descend. A descent starts at a passing point whose score is far below the prediction of a surrogate that was not fitted to
it: the surrogate knows the slopes of large modes, so what surprises it may belong to another one. Covariates are further
inputs of the surrogate. A descent spends as little as it can:

1. It steps in `PROBES` random directions and estimates the steepness of the margin. If the boundary is farther away than
   `REACH` at that steepness, it ends.
2. It ends if scores fall on the way from there to a known mode.
3. It takes a simplex gradient (Conn, Scheinberg and Vicente 2009, doi:10.1137/1.9780898718768), one point per parameter,
   and follows it to where the boundary should be. A lower score there starts another gradient, `STEPS` times at most.

Descents get a large share of a batch only while they meet more new modes per point than exploration does.

A failure counts once it has failed under further random seeds. It belongs to a mode if the variant halfway to a member of
the mode fails too. So a bent mode may count as several, and modes that touch as one.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.guided.domain import Axis, Cube, Domain
from valerie.guided.exploration import SpaceFilling
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result, Why
from valerie.guided.surrogate import Covariates, held_out, margins
from valerie.parameters.samplers import UnitPoints

Floats = NDArray[np.float64]

#: Shares of a batch for descents: where they pay less than exploration, and where they pay more.
DESCENDING: Final = (0.03, 0.5)
#: New modes and points of descents that are assumed before any: a descent has to pay soon.
ASSUMED: Final = (0.3, 20)
#: Largest share of a batch for the checks of failures.
CHECKING: Final = 0.2
#: Exploring points before the first descent.
FIRST: Final = 64
#: Directions that a new start tries.
PROBES: Final = 2
#: Length of a step of a gradient, in quantiles.
STEP: Final = 0.01
#: Farthest boundary that a descent aims at, in quantiles.
REACH: Final = 0.3
#: Gradients of a descent at most.
STEPS: Final = 3
#: Share of the passing points that may become starts.
SURPRISING: Final = 0.25
#: Growth of the number of points after which the surrogate is fitted again.
REFIT: Final = 1.2
#: Repeats without a score after which a failure is given up.
UNSCORED: Final = 3
#: Modes that a point is compared with at a time.
COMPARED: Final = 3
#: Standard deviation of a mode's members below which a parameter matters to it.
NARROW: Final = 0.2
#: Fewest members for the shape of a mode.
MEMBERS: Final = 3
#: Points along a gradient, in distances to the expected boundary.
_ALONG: Final = (0.7, 1.1, 1.6)
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
        unscored: failures whose repeats had no score, so that nothing is known of them.
        explored: number of points that explored.
        smallest: smallest probability of a mode that they hit with 95 % probability.
        evaluations: number of all points.
    """

    modes: tuple[Mode, ...]
    failures: int
    unplaced: int
    unrepeated: int
    unscored: int
    explored: int
    smallest: float
    evaluations: int


class _Stage(Enum):
    PROBE = auto()
    COMPARE = auto()
    GRADIENT = auto()
    FOLLOW = auto()


@dataclass(slots=True, eq=False)
class _Descent:
    """A descent: its best row, and the points of its stage: to be asked for, running, and scored."""

    best: int
    stage: _Stage = _Stage.PROBE
    left: list[tuple[UnitPoints, int | None]] = field(default_factory=list)
    waiting: int = 0
    told: list[int] = field(default_factory=list)
    steps: int = 0
    ended: bool = False


@dataclass(slots=True, eq=False)
class _Failure:
    """A failure under examination: requested and confirmed repeats, and modes that it does not belong to."""

    row: int
    asked: int = 0
    repeated: int = 0
    unscored: int = 0
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
        descending: shares of a batch for descents, where they pay less than exploration and where they pay more.

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
        covariates: Covariates | None = None,
        descending: tuple[float, float] = DESCENDING,
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
        self._evaluations = self._unrepeated = self._unscored = self._descended = 0
        self._descents: list[_Descent] = []
        self._started: set[int] = set()
        self._candidates: list[int] = []
        self._fitted = 0
        self._failures: list[_Failure] = []
        self._modes: list[list[int]] = []

    def ask(self, count: int) -> Proposal:
        """Return the next batch."""
        rng = np.random.default_rng([self.seed, 1, self._asked])
        self._asked += 1
        wanted = self._checks(int(CHECKING * count))
        checks = len(wanted)
        if np.count_nonzero(self._explores) >= FIRST:
            wanted += self._descend(rng, min(math.ceil(self._share() * count), count - checks))
        descending = len(wanted) - checks
        explores = self._exploration.take(count - len(wanted))
        points = np.concatenate(
            [np.array([point for point, _ in wanted]).reshape(-1, self.domain.dimensions), explores]
        )
        self._tags.append([tag for _, tag in wanted] + [_EXPLORES] * len(explores))
        explored = int(np.count_nonzero(self._explores))
        numbers = {
            "explored": explored,
            "modes": len(self._modes),
            "smallest": _smallest(explored),
            "exploring": len(explores),
            "descending": descending,
            "low": len(self._descents),
            "checking": checks,
        }
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
        for tag, row, failed, lacks in zip(tags, rows.tolist(), fails.tolist(), np.isnan(values), strict=True):
            if tag.failure is not None:
                if lacks and tag.mode is None:
                    self._lacks_repeat(tag.failure)
                else:
                    self._examined(tag.failure, tag.mode, row, failed=failed)
                continue
            if failed and tag.mode is None:
                self._failures.append(_Failure(row))
            if tag.descent is not None:
                tag.descent.waiting -= 1
                tag.descent.told.append(row)
        for descent in self._descents:
            if not descent.waiting and not descent.left:
                self._go_on(descent)
        self._descents = [descent for descent in self._descents if not descent.ended]
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
        ways = self._moves(point, members)
        nearest = int(np.argmin((ways**2).sum(axis=1)))
        halfway = point + np.where(self._numbers, ways[nearest] / 2, 0.0)
        if isinstance(self.domain, Domain):
            halfway = np.where(self.domain.periodic, halfway % 1.0, halfway)
        return halfway if self.domain.legal(halfway[None])[0] else None

    def _lacks_repeat(self, failure: _Failure) -> None:
        """Repeat a failure once more, since an undefined score is neither a failure nor a pass; give up after a few."""
        failure.waiting -= 1
        failure.asked -= 1
        failure.unscored += 1
        if failure.unscored == UNSCORED:
            self._unscored += 1
            self._failures.remove(failure)

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
        """Return the next points of descents, of new ones where the others wait for scores."""
        left = sum(len(descent.left) for descent in self._descents)
        for row in self._starts(math.ceil((count - left) / PROBES)):
            directions = rng.standard_normal((PROBES, self.domain.dimensions)) * self._numbers
            directions /= np.linalg.norm(directions, axis=1)[:, None] + 1e-12
            begun = _Descent(row)
            begun.left = self._legal(self._points[row] + STEP * directions)
            self._descents.append(begun)
        wanted: list[tuple[UnitPoints, _Tag]] = []
        for descent in self._descents:
            while descent.left and len(wanted) < count:
                point, mode = descent.left.pop(0)
                descent.waiting += 1
                self._descended += 1
                wanted.append((point, _Tag(descent=descent, mode=mode)))
        return wanted

    def _share(self) -> float:
        """Return the share of the next batch for descents, by the rates at which both kinds of points meet new modes.

        For exploration it is the share of points that alone hit a mode (Good 1953, doi:10.1093/biomet/40.3-4.237).
        """
        alone = sum(np.count_nonzero(self._explores[members]) == 1 for members in self._modes)
        won = sum(not self._explores[members[0]] for members in self._modes)
        modes, points = ASSUMED
        exploring = (alone + 1) / max(np.count_nonzero(self._explores), 1)
        pays = (modes + won) / (points + self._descended) > exploring
        return self._descending[1 if pays else 0]

    def _legal(self, points: UnitPoints) -> list[tuple[UnitPoints, int | None]]:
        """Return the legal ones of points, which are reflected where they leave the domain."""
        if isinstance(self.domain, Domain):
            points = np.where(self.domain.periodic, points % 1.0, points)
        points = np.abs(points)
        points = np.clip(np.where(points > 1, 2 - points, points), 0, _BELOW_ONE)
        return [(point, None) for point in points[self.domain.legal(points)]]

    def _go_on(self, descent: _Descent) -> None:
        """Take the scores of a descent's stage and begin the next one, or end it."""
        told = [row for row in descent.told if not np.isnan(self._margins[row])]
        descent.told = []
        start, margin = self._points[descent.best], self._margins[descent.best]
        changes = self._margins[told] - margin
        moves = self._moves(start, self._points[told])
        match descent.stage:
            case _Stage.PROBE:
                # The mean square of a direction's cosine is 1 / dimensions.
                slopes = changes / (np.linalg.norm(moves, axis=1) + 1e-12)
                steepness = math.sqrt(self._numbers.sum() * float((slopes**2).mean())) if told else 0.0
                descent.stage = _Stage.COMPARE
                descent.ended = margin > REACH * steepness
                descent.left = [] if descent.ended else self._comparisons(descent.best)
                if not descent.left and not descent.ended:
                    self._go_on(descent)
            case _Stage.COMPARE:
                descent.ended = bool((changes < 0).any())
                self._take_gradient(descent)
            case _Stage.GRADIENT:
                gradient = np.linalg.lstsq(moves, changes)[0] if told else np.zeros(len(start))
                steepness = float(np.linalg.norm(gradient))
                descent.ended = margin > REACH * steepness
                if not descent.ended:
                    way = -gradient / steepness * (margin / steepness)
                    descent.stage = _Stage.FOLLOW
                    descent.left = self._legal(start + np.outer(_ALONG, way))
                    descent.ended = not descent.left
            case _Stage.FOLLOW:
                lowest = told[int(np.argmin(changes))] if told else descent.best
                improved = self._margins[lowest] < margin - _LEAST
                descent.best = lowest
                descent.ended = not improved or self._margins[lowest] < 0 or descent.steps == STEPS
                self._take_gradient(descent)

    def _take_gradient(self, descent: _Descent) -> None:
        if not descent.ended:
            descent.steps += 1
            descent.stage = _Stage.GRADIENT
            descent.left = self._legal(
                self._points[descent.best] + STEP * np.eye(self.domain.dimensions)[self._numbers]
            )
            descent.ended = not descent.left

    def _moves(self, start: UnitPoints, points: UnitPoints) -> Floats:
        """Return the ways from a point to others, (n, dimensions)."""
        return self.domain.steps(start, points) if isinstance(self.domain, Domain) else points - start

    def _comparisons(self, row: int) -> list[tuple[UnitPoints, int | None]]:
        """Return the points halfway to the modes that most likely contain a point."""
        halfway = {mode: self._halfway(row, mode) for mode in self._likely(row)[:COMPARED]}
        return [(point, mode) for mode, point in halfway.items() if point is not None]

    def _starts(self, count: int) -> list[int]:
        """Return passing rows whose scores are far below what a surrogate expects that was not fitted to them."""
        defined = np.flatnonzero(~np.isnan(self._margins))
        if count <= 0 or len(defined) < FIRST:
            return []
        if len(defined) > REFIT * self._fitted:
            self._fitted = len(defined)
            passing = self._margins[defined] >= 0
            expected = held_out(self._features[defined], self._margins[defined], trend=False)
            surprises = (self._margins[defined] - expected)[passing]
            lowest = np.argsort(surprises, kind="stable")[: math.ceil(SURPRISING * len(surprises))]
            self._candidates = [row for row in defined[passing][lowest].tolist() if row not in self._started]
        chosen, self._candidates = self._candidates[:count], self._candidates[count:]
        self._started.update(chosen)
        return chosen

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
        return Modes(
            tuple(modes),
            repeated,
            unplaced,
            self._unrepeated,
            self._unscored,
            explored,
            _smallest(explored),
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


def _smallest(explored: int) -> float:
    """Return the probability of a mode that so many points hit with 95 % probability."""
    return 1 - 0.05 ** (1 / explored) if explored else 1.0
