"""Failures and their distinct modes.

A *mode* is a connected set of failures: variants between two of them fail as well. The strategy counts modes instead of
failures, since many failures with one cause teach little.

Most points explore: they are scrambled Sobol' points of the operational domain, so likely modes are hit first. The others
descend: from the passing exploring points, the lowest score first. A descent spends as little as it can:

1. It ends if scores fall on the way from there to the mode that most likely contains the start.
2. It steps in `PROBES` random directions and estimates the steepness of the margin. If the boundary is farther away than
   `REACH` at that steepness, it ends.
3. It takes a simplex gradient (Conn, Scheinberg and Vicente 2009, doi:10.1137/1.9780898718768), one point per parameter,
   and follows it to where the boundary should be. A lower score there starts another gradient, `STEPS` times at most.

Descents begin only while they promise more new modes per point than exploration does (`Find._pays`). The promise shrinks with
each descent that reaches no failure.

A failure counts once it has failed under further random seeds. It belongs to a mode if the variant halfway to a member of
the mode fails too. So a bent mode may count as several, and modes that touch as one. Covariates make the variant halfway
one that is halfway in them too.
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
from valerie.guided.surrogate import Covariates, margins
from valerie.parameters.samplers import UnitPoints

Floats = NDArray[np.float64]

#: Largest share of a batch for descents.
DESCENDING: Final = 0.5
#: New modes and points of descents that are assumed before any, if each descent reaches a failure.
ASSUMED: Final = (2, 20)
#: Descents under way at most: so many, and as many again for each that reached a failure.
TRIED: Final = 4
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
#: Repeats without a score after which a failure is given up.
UNSCORED: Final = 3
#: Modes that a failure is compared with at a time.
COMPARED: Final = 3
#: Variants between two points of which one halfway in covariates is chosen.
BETWEEN: Final = 64
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
    COMPARE = auto()
    PROBE = auto()
    GRADIENT = auto()
    FOLLOW = auto()


@dataclass(slots=True, eq=False)
class _Descent:
    """A descent: its best row, and the points of its stage: to be asked for, running, and scored."""

    best: int
    stage: _Stage = _Stage.COMPARE
    left: list[UnitPoints] = field(default_factory=list)
    waiting: int = 0
    told: list[int] = field(default_factory=list)
    steps: int = 0
    ended: bool = False


@dataclass(slots=True, eq=False)
class _Failure:
    """A failure under examination: requested and confirmed repeats, and modes that it does not belong to."""

    row: int
    followed: bool
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
        covariates: (n, dimensions) points to (n, k) free numbers of about 0…1, e.g. distances. They are asked for `BETWEEN`
            variants per comparison with a mode.

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
    ) -> None:
        if not 0 < at_least < 1:
            raise InvalidInput("a bound of scores in 0…1", field="at_least", value=at_least, limit="above 0, below 1")
        if repeats < 0:
            raise InvalidInput("a number of seeds", field="repeats", value=repeats, limit=">= 0")
        self.domain, self.at_least, self.seed, self.repeats = domain, at_least, seed, repeats
        self._covariates = covariates
        self._numbers = np.ones(domain.dimensions, np.bool_)
        if isinstance(domain, Domain):
            self._numbers = np.array([axis is not Axis.UNORDERED for axis in domain.axes])
        self._exploration = SpaceFilling(domain, seed)
        self._open = OpenBatches()
        self._tags: deque[list[_Tag]] = deque()
        self._points = np.empty((0, domain.dimensions))
        self._features = np.empty((0, 0))
        self._margins = np.empty(0)
        self._explores = np.empty(0, np.bool_)
        self._evaluations = self._unrepeated = self._unscored = 0
        self._descents: list[_Descent] = []
        self._started: set[int] = set()
        self._descended = self._finished = self._reached = self._won = 0
        self._failures: list[_Failure] = []
        self._modes: list[list[int]] = []

    def ask(self, count: int) -> Proposal:
        """Return the next batch."""
        wanted = self._checks(int(CHECKING * count))
        checks = len(wanted)
        if np.count_nonzero(self._explores) >= FIRST:
            wanted += self._descend(min(math.ceil(DESCENDING * count), count - checks))
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
            stage = None if tag.descent is None else tag.descent.stage
            if failed and stage is not _Stage.COMPARE:
                self._failures.append(_Failure(row, followed=stage is _Stage.FOLLOW))
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
        return sorted(range(len(self._modes)), key=lambda mode: self._strangeness(row, mode))

    def _strangeness(self, row: int, mode: int) -> float:
        middle, variance = _shape(self._features[self._modes[mode]])
        return float(((self._features[row] - middle) ** 2 / variance + np.log(variance)).sum())

    def _halfway(self, row: int, mode: int) -> UnitPoints | None:
        """Return the legal variant halfway between a point and the nearest member of a mode; None without one.

        With covariates, each parameter has the value of one of them or the one halfway, so that the features are about halfway.
        """
        members = self._modes[mode]
        ways = self._moves(self._points[row], self._points[members])
        nearest = int(np.argmin((ways**2).sum(axis=1)))
        shares = np.full((1, self.domain.dimensions), 0.5)
        if self._covariates is not None:
            mixed = np.random.default_rng([self.seed, 2]).integers(0, 3, (BETWEEN, self.domain.dimensions)) / 2
            shares = np.concatenate([shares, mixed])
        between = self._legal(self._points[row] + np.where(self._numbers, ways[nearest] * shares, 0.0))
        if len(between) < 2:
            return np.asarray(between[0]) if len(between) else None
        gaps = self._with_covariates(between) - self._features[[row, members[nearest]]].mean(axis=0)
        nearest = int(np.argmin((gaps**2 / _shape(self._features[members])[1]).sum(axis=1)))
        return np.asarray(between[nearest])

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
                self._won += failure.followed

    def _descend(self, count: int) -> list[tuple[UnitPoints, _Tag]]:
        """Return the next points of descents, of new ones where the others wait for scores and while descents pay."""
        wanted: list[tuple[UnitPoints, _Tag]] = []
        for descent in self._descents:
            self._take_points(descent, wanted, count)
        most = TRIED * (1 + self._reached) - len(self._descents)
        for row in self._starts()[: max(most, 0)] if self._pays() else []:
            if len(wanted) >= count:
                break
            self._started.add(row)
            begun = _Descent(row)
            halfway = self._halfway(row, self._likely(row)[0]) if self._modes else None
            if halfway is None:
                self._take_probes(begun)
            else:
                begun.left = [halfway]
            if not begun.ended:
                self._descents.append(begun)
                self._take_points(begun, wanted, count)
        return wanted

    def _take_points(self, descent: _Descent, wanted: list[tuple[UnitPoints, _Tag]], count: int) -> None:
        while descent.left and len(wanted) < count:
            descent.waiting += 1
            self._descended += 1
            wanted.append((descent.left.pop(0), _Tag(descent=descent)))

    def _starts(self) -> list[int]:
        """Return the passing rows that explored and began no descent yet, the lowest score first."""
        rows = np.flatnonzero(self._explores & (self._margins >= 0))
        lowest = rows[np.argsort(self._margins[rows], kind="stable")]
        return [row for row in lowest.tolist() if row not in self._started]

    def _pays(self) -> bool:
        """Return True if a point of a descent promises more new modes than one that explores.

        For exploration it is the share of points that alone hit a mode (Good 1953, doi:10.1093/biomet/40.3-4.237).
        """
        alone = sum(np.count_nonzero(self._explores[members]) == 1 for members in self._modes)
        modes, points = ASSUMED
        promised = modes * (1 + self._reached) / (1 + self._finished)
        explored = int(np.count_nonzero(self._explores))
        return bool((promised + self._won) / (points + self._descended) > (alone + 1) / max(explored, 1))

    def _legal(self, points: UnitPoints) -> UnitPoints:
        """Return the legal ones of points, which are reflected where they leave the domain."""
        if isinstance(self.domain, Domain):
            points = np.where(self.domain.periodic, points % 1.0, points)
        points = np.abs(points)
        points = np.clip(np.where(points > 1, 2 - points, points), 0, _BELOW_ONE)
        return points[self.domain.legal(points)]

    def _go_on(self, descent: _Descent) -> None:
        """Take the scores of a descent's stage and begin the next one, or end it."""
        stage = descent.stage
        told = [row for row in descent.told if not np.isnan(self._margins[row])]
        descent.told = []
        start, margin = self._points[descent.best], self._margins[descent.best]
        changes = self._margins[told] - margin
        moves = self._moves(start, self._points[told])
        match stage:
            case _Stage.COMPARE:
                descent.ended = bool((changes < 0).any())
                if not descent.ended:
                    self._take_probes(descent)
            case _Stage.PROBE:
                # The mean square of a direction's cosine is 1 / dimensions.
                slopes = changes / (np.linalg.norm(moves, axis=1) + 1e-12)
                steepness = math.sqrt(self._numbers.sum() * float((slopes**2).mean())) if told else 0.0
                descent.ended = margin > REACH * steepness
                self._take_gradient(descent)
            case _Stage.GRADIENT:
                gradient = np.linalg.lstsq(moves, changes)[0] if told else np.zeros(len(start))
                steepness = float(np.linalg.norm(gradient))
                descent.ended = margin > REACH * steepness
                if not descent.ended:
                    way = -gradient / steepness * (margin / steepness)
                    descent.stage = _Stage.FOLLOW
                    descent.left = list(self._legal(start + np.outer(_ALONG, way)))
                    descent.ended = not descent.left
            case _Stage.FOLLOW:
                lowest = told[int(np.argmin(changes))] if told else descent.best
                improved = self._margins[lowest] < margin - _LEAST
                descent.best = lowest
                descent.ended = not improved or self._margins[lowest] < 0 or descent.steps == STEPS
                self._take_gradient(descent)
        if descent.ended and stage is not _Stage.COMPARE:
            self._finished += 1
            self._reached += bool(self._margins[descent.best] < 0)

    def _take_probes(self, descent: _Descent) -> None:
        rng = np.random.default_rng([self.seed, 1, descent.best])
        directions = rng.standard_normal((PROBES, self.domain.dimensions)) * self._numbers
        directions /= np.linalg.norm(directions, axis=1)[:, None] + 1e-12
        descent.stage = _Stage.PROBE
        descent.left = list(self._legal(self._points[descent.best] + STEP * directions))
        descent.ended = not descent.left

    def _take_gradient(self, descent: _Descent) -> None:
        if not descent.ended:
            descent.steps += 1
            descent.stage = _Stage.GRADIENT
            steps = STEP * np.eye(self.domain.dimensions)[self._numbers]
            descent.left = list(self._legal(self._points[descent.best] + steps))
            descent.ended = not descent.left

    def _moves(self, start: UnitPoints, points: UnitPoints) -> Floats:
        """Return the ways from a point to others, (n, dimensions)."""
        return self.domain.steps(start, points) if isinstance(self.domain, Domain) else points - start

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
        narrow = np.flatnonzero(_shape(points)[1] < NARROW**2) if len(members) >= MEMBERS else np.empty(0, np.int64)
        hits = int(np.count_nonzero(self._explores[members]))
        return Mode(points[middle], tuple(narrow.tolist()), len(members), hits, hits / max(explored, 1))


def _shape(members: Floats) -> tuple[Floats, Floats]:
    """Return mean and variance of a mode's members; with few members the variance shrinks towards that of the domain."""
    middle = members.mean(axis=0)
    return middle, (((members - middle) ** 2).sum(axis=0) + 3 / 12) / (len(members) + 3)


def _smallest(explored: int) -> float:
    """Return the probability of a mode that so many points hit with 95 % probability."""
    return 1 - 0.05 ** (1 / explored) if explored else 1.0
