"""The strategy of a study in step with its batches.

Batch k depends on the outcomes of the batches up to k − 2, so that one batch runs while the next is proposed. The
order of calls is always ask 0, ask 1, tell 0, ask 2, tell 1, ask 3 …; replaying the stored batches in this order makes the
strategy propose the same points again. An empty batch has no run, and the strategy does not see it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from inspect import signature
from typing import Any, Final, Protocol

import numpy as np

from valerie import plugins
from valerie.errors import Conflict, InvalidInput
from valerie.guided import cascade, compare, rank
from valerie.guided import map as mapping
from valerie.guided.cascade import Cascade, TwoEngines
from valerie.guided.compare import Compare, Difference
from valerie.guided.estimate import Estimate, FailureRate
from valerie.guided.explain import MinimalPair
from valerie.guided.find import Find, Modes
from valerie.guided.map import Boundary, Map
from valerie.guided.rank import Rank
from valerie.guided.strategy import Proposal, Result, Strategy, StrategyFactory
from valerie.guided.verify import Verification, Verify
from valerie.parameters.samplers import UnitPoints
from valerie.plain import json_values
from valerie.runs.document.run_spec import RunSpec, engine_name
from valerie.runs.study.study_document import (
    CascadeGoal,
    CompareGoal,
    EstimateGoal,
    ExplainGoal,
    FindGoal,
    MapGoal,
    Outcomes,
    PluginGoal,
    RankGoal,
    StudyResult,
    VerifyGoal,
)
from valerie.studies.boundary import BoundarySlice, slice_of
from valerie.studies.pairs import ExplainFromScratch
from valerie.studies.resolved import ResolvedStudy
from valerie.studies.wording import in_quantity, result_sentences

#: A batch depends on the outcomes of the batches up to this many before it.
LAG: Final = 2
#: Range of the default number of first points of `estimate`. A model needs 20 defined scores; some may be undefined.
_FIRST: Final = (24, 256)
#: Modes, and rises and falls of a comparison, that are shown as pictures.
_SHOWN: Final = 6


class StoredBatch(Protocol):
    """The part of a stored batch that a pursuit reads."""

    @property
    def count(self) -> int:
        """Number of requested points."""
        ...

    @property
    def points(self) -> list[list[float]]:
        """(n, dimensions) proposed points."""
        ...

    @property
    def outcomes(self) -> Outcomes | None:
        """Outcomes; None while the batch runs."""
        ...


class Pursuit:
    """A strategy and its progress through the batches of a study.

    Args:
        study: the study.

    Attributes:
        strategy: the strategy of the study's goal.
        asked, told: numbers of batches, empty ones included.
    """

    def __init__(self, study: ResolvedStudy) -> None:
        self.study = study
        self.asked = self.told = 0
        self.strategy = strategy_of(study)
        self._batches: list[UnitPoints] = []
        self._levels: list[int] = []

    def follow(self, batches: Sequence[StoredBatch], *, everything: bool = False) -> None:
        """Replay the stored batches that the strategy does not know yet.

        Args:
            batches: all batches of the study, in order.
            everything: also tell the last batches, after which nothing more can be asked.

        Raises:
            Conflict: the proposed points differ from the stored ones, which another version of the strategy proposed.
        """
        for batch in batches[self.asked :]:
            proposal = self.ask(batches, batch.count)
            if proposal.points.tolist() != batch.points:
                raise Conflict(
                    f"batch {self.asked} of this study was proposed by another version of the strategy: "
                    "start the study again; products are reused"
                )
        if everything:
            self._tell(batches, len(batches))

    def ask(self, batches: Sequence[StoredBatch], count: int) -> Proposal:
        """Tell the strategy the outcomes that the next batch may depend on, and return that batch.

        Args:
            batches: all batches of the study; those up to two before the next have outcomes or are empty.
            count: largest number of points.
        """
        self.tell_due(batches)
        proposal = self.strategy.ask(count)
        self._check(proposal.points, count)
        self._batches.append(proposal.points)
        self._levels.append(proposal.level)
        self.asked += 1
        return proposal

    def _check(self, points: UnitPoints, count: int) -> None:
        """Refuse what no strategy may propose; those of other packages are not ours to trust."""
        dimensions = self.study.domain.dimensions
        if points.ndim != 2 or points.shape[1] != dimensions or len(points) > count:
            limit = f"at most {count} points of {dimensions} coordinates"
            raise InvalidInput(
                "the strategy proposes points of another shape", field="goal", value=points.shape, limit=limit
            )
        if not ((points >= 0) & (points <= 1)).all():
            raise InvalidInput("the strategy proposes points outside the unit cube", field="goal", limit="0…1")

    def tell_due(self, batches: Sequence[StoredBatch]) -> None:
        """Tell the strategy every batch that the next one depends on; each has outcomes or is empty."""
        self._tell(batches, self.asked - LAG + 1)

    def agrees(self, batches: Sequence[StoredBatch]) -> bool:
        """Return True if the last batch asked for is still the stored one; it may have been replaced since."""
        if self.asked > len(batches):
            return False
        return not self.asked or self._batches[-1].tolist() == batches[self.asked - 1].points

    def spec(self, number: int, *, parent: str | None) -> RunSpec:
        """Return the spec of the run of a batch.

        A point that the same render engine has evaluated before is evaluated under another random seed.

        Args:
            number: of the batch.
            parent: id of the run before it.
        """
        points, level = self._batches[number], self._levels[number]
        before = zip(self._batches[:number], self._levels, strict=False)
        earlier = {point.tobytes() for batch, other in before if other == level for point in batch}
        again = any(point.tobytes() in earlier for point in points)
        seed = self.study.document.spec.seed + (number if again else 0)
        return self.study.spec(points, number, parent=parent, seed=seed, level=level)

    @property
    def waits(self) -> bool:
        """True while a proposed batch has no outcomes."""
        return any(len(points) for points in self._batches[self.told :])

    def result(self) -> StudyResult | None:
        """Return the result from all outcomes so far; None before there is one."""
        known = self._known()
        if known is None:
            return None
        known = in_quantity(known, self.study)
        return StudyResult(
            sentences=result_sentences(known, self.study),
            numbers=json_values(known),
            batches=self.told,
            further=self._further(known),
        )

    def enough(self) -> str | None:
        """Return the reason why the stop rule ends the study; None if it does not."""
        width, known = self.study.document.stop.width, self._known()
        if width is None or not isinstance(known, FailureRate):
            return None
        interval = known.assumption_free
        if interval.high - interval.low > width:
            return None
        return f"the interval is {interval.high - interval.low:.4g} wide; {width:g} was requested"

    def _further(self, known: Result) -> int | None:
        """Return the expected number of further variants until the study can end by itself."""
        width = self.study.document.stop.width
        match known:
            case Verification(further=int(further)):
                each = known.evaluations / (known.evaluations - known.undefined)
            case Difference(further=int(further)):
                each = 1 + known.undefined / known.pairs
            case FailureRate(assumption_free=interval) if width is not None:
                # The width shrinks with the root of the number of variants.
                further, each = known.evaluations, ((interval.high - interval.low) / width) ** 2 - 1
            case _:
                return None
        return math.ceil(further * each) if further * each > 0 else None

    def decisive(self) -> list[tuple[int, int, str]]:
        """Return the variants to look at: (batch, index, description), from the outcomes so far."""
        named: list[tuple[str, UnitPoints]] = []
        match known := self._known():
            case MinimalPair():
                named = [
                    ("It fails", known.failing),
                    ("The last that does not fail", known.inner),
                    ("It passes", known.passing),
                ]
            case Modes():
                named = [(f"Mode {number}", mode.example) for number, mode in enumerate(known.modes[:_SHOWN], 1)]
            case Boundary():
                named = [("Next to the bound", point) for point in known.nearest]
            case Difference():
                second = self.study.document.spec.functions[1]
                named = [(f"{second} does worse", point) for point in known.falls[: _SHOWN // 2]]
                named += [(f"{second} does better", point) for point in known.rises[: _SHOWN // 2]]
            case TwoEngines():
                named = [("The engines disagree", point) for point in known.disagree[: _SHOWN // 2]]
        places = [(place, words + self._engine(place[0])) for words, point in named for place in self._places(point)]
        unique = dict(reversed(places))
        return [(*place, words) for place, words in reversed(unique.items())]

    def pair(self) -> tuple[tuple[int, int], tuple[int, int]] | None:
        """Return the failing and the passing variant of a minimal pair, (batch, index) each; None where there is none."""
        known = self._known()
        if not isinstance(known, MinimalPair):
            return None
        return self._places(known.failing)[0], self._places(known.passing)[0]

    def boundary(self) -> BoundarySlice | None:
        """Return the slice of a map over the two parameters that matter most; None for other goals, or too early."""
        known = self._known()
        if not isinstance(self.strategy, Map) or not isinstance(known, Boundary):
            return None
        return slice_of(self.strategy, self.study.domain, known.nearest[0])

    def _engine(self, number: int) -> str:
        """Return the render engine of a batch as the end of a title; empty where the study has only one."""
        renderers = self.study.renderers
        return f", {engine_name(renderers[self._levels[number]])}" if len(renderers) > 1 else ""

    def _places(self, point: UnitPoints) -> list[tuple[int, int]]:
        """Return the first place of a point, (batch, index), for each render engine."""
        first: dict[int, tuple[int, int]] = {}
        for number, (points, level) in enumerate(zip(self._batches, self._levels, strict=True)):
            for index in np.flatnonzero((points == point).all(axis=1)) if len(points) else ():
                first.setdefault(level, (number, int(index)))
        return list(first.values())

    def _known(self) -> Result | None:
        strategy = self.strategy
        if isinstance(strategy, Estimate) and strategy.result is not None:
            return strategy.rate(1 - 0.05 / looks_of(self.study))
        return strategy.result

    def _tell(self, batches: Sequence[StoredBatch], end: int) -> None:
        end = max(end, self.told)
        for batch, points in zip(batches[self.told : end], self._batches[self.told : end], strict=True):
            if len(points):
                assert batch.outcomes is not None, "only ended batches are told"
                if isinstance(self.strategy, Cascade) and batch.outcomes.cpu_seconds is not None:
                    self.strategy.spend(self._levels[self.told], batch.outcomes.cpu_seconds, len(points))
                self.strategy.tell(points, batch.outcomes.values)
            self.told += 1


def strategy_of(study: ResolvedStudy) -> Strategy:
    """Return the strategy of a study's goal, before anything is asked.

    Raises:
        InvalidInput: the budget is too small for any answer.
    """
    document, goal, domain = study.document, study.document.goal, study.domain
    at_least, seed = study.measure.at_least, document.spec.seed
    if document.budget.variants < (fewest := _fewest(study)):
        refusal = f"{goal.name} needs more variants before it can answer"
        raise InvalidInput(refusal, field="budget.variants", value=document.budget.variants, limit=f">= {fewest}")
    match goal:
        case EstimateGoal():
            return Estimate(domain, at_least=at_least, seed=seed, first=first_of(study))
        case FindGoal():
            return Find(domain, at_least=at_least, seed=seed, repeats=goal.repeats)
        case MapGoal():
            return Map(domain, at_least=at_least, seed=seed)
        case VerifyGoal():
            share = goal.share is not None
            bound, passes = (goal.share or at_least), (at_least if share else None)
            return Verify(domain, bound=bound, at_least=passes, seed=seed, confidence=goal.confidence)
        case CompareGoal():
            passes = at_least if goal.of == "share" else None
            return Compare(domain, within=goal.within, seed=seed, at_least=passes, level=goal.level)
        case RankGoal():
            return Rank(domain, seed=seed)
        case CascadeGoal():
            return Cascade(domain, seed=seed, at_least=at_least if goal.of == "rate" else None)
        case ExplainGoal():
            pair = None
            if goal.failing is not None and goal.passing is not None:
                pair = domain.point(goal.failing), domain.point(goal.passing)
            return ExplainFromScratch(domain, pair, at_least=at_least, seed=seed, batch=document.batch)
        case PluginGoal():
            return _plugged(study, goal)


def _plugged(study: ResolvedStudy, goal: PluginGoal) -> Strategy:
    """Return a strategy of another package.

    Raises:
        UnknownName, InvalidInput: it is not installed or not allowed, or refuses its options.
    """
    factory: StrategyFactory = plugins.strategy_of(goal.name)
    arguments: dict[str, Any] = {"at_least": study.measure.at_least, "seed": study.document.spec.seed, **goal.options}
    try:
        signature(factory).bind(study.domain, **arguments)
    except TypeError as problem:
        raise InvalidInput(
            f"the strategy {goal.name} refuses them: {problem}", field="goal.options", value=goal.options
        ) from None
    return factory(study.domain, **arguments)


def _fewest(study: ResolvedStudy) -> int:
    """Return the least number of variants that can lead to an answer."""
    match study.document.goal:
        case EstimateGoal():
            return first_of(study)
        case MapGoal():
            return mapping.FIRST
        case CompareGoal():
            return compare.FEWEST
        case CascadeGoal():
            # Pairs are drawn from cheap points whose scores are known.
            batch = study.document.batch
            return max(LAG, math.ceil(cascade.FEWEST / batch)) * batch + cascade.FEWEST
        case RankGoal():
            return rank.TRAJECTORIES * (study.domain.dimensions + 1)
    return 1


def first_of(study: ResolvedStudy) -> int:
    """Return the number of operational points at the beginning of an estimate."""
    document = study.document
    first = document.goal.first if isinstance(document.goal, EstimateGoal) else None
    return first or max(_FIRST[0], min(_FIRST[1], document.budget.variants // 4))


def looks_of(study: ResolvedStudy) -> int:
    """Return the largest number of looks at an estimate; without a stop rule 1, the one at the end."""
    document = study.document
    if document.stop.width is None:
        return 1
    return 1 + math.ceil((document.budget.variants - first_of(study)) / document.batch)
