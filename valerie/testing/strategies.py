"""Contract of strategies: subclass `StrategyContract`, override its fixture ``build``, and run it with pytest."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import is_dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.guided.strategy import Result, Strategy

Points = NDArray[np.float64]


class StrategyContract:
    """Tests of a strategy. ``batches`` batches of ``size`` points are evaluated; scores below 0.5 fail, some are undefined."""

    dimensions = 3
    size = 16
    batches = 5
    #: Number of scores per point.
    columns = 1

    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        """Return a function that builds the strategy under test, always with the same arguments and seed."""
        raise NotImplementedError("override the fixture `build`")

    def score(self, points: Points) -> Points:
        """Return scores in [0, 1], below 0.5 in one corner and NaN in another."""
        scores = np.clip(points[:, :2].mean(axis=1) + 0.2, 0, 1)
        return self.columned(np.where(points[:, -1] > 0.9, np.nan, scores))

    def columned(self, scores: Points) -> Points:
        """Repeat each point's score as often as the strategy takes scores."""
        return scores if self.columns == 1 else np.repeat(scores[:, None], self.columns, axis=1)

    def history(self, strategy: Strategy) -> list[Points]:
        """Return the batches of a strategy that is asked, told and asked again."""
        batches = []
        for _ in range(self.batches):
            points = strategy.ask(self.size).points
            if not len(points):
                break
            batches.append(points.copy())
            strategy.tell(points, self.score(points))
        return batches

    def test_points_lie_in_the_unit_cube_and_are_no_more_than_asked_for(self, build: Callable[[], Strategy]) -> None:
        batches = self.history(build())
        assert batches
        for points in batches:
            assert 0 < len(points) <= self.size
            assert points.shape[1] == self.dimensions
            assert points.dtype == np.float64
            assert ((points >= 0) & (points < 1)).all()

    def test_the_same_history_leads_to_the_same_points(self, build: Callable[[], Strategy]) -> None:
        first = self.history(build())
        np.random.seed(1)  # noqa: NPY002  a strategy that draws from the global generator would show here
        second = self.history(build())
        assert len(first) == len(second)
        assert all(np.array_equal(one, other) for one, other in zip(first, second, strict=True))

    def test_a_batch_may_be_asked_for_while_another_is_in_work(self, build: Callable[[], Strategy]) -> None:
        def overlapping() -> list[Points]:
            strategy, asked, open_ = build(), [], deque[Points]()
            for _ in range(2 * self.batches):
                points = strategy.ask(self.size).points
                asked.append(points.copy())
                if len(points):
                    open_.append(points)
                if len(open_) > 1 or (open_ and not len(points)):
                    strategy.tell(open_[0], self.score(open_.popleft()))
            return asked

        first, second = overlapping(), overlapping()
        assert sum(map(len, first))
        assert all(np.array_equal(one, other) for one, other in zip(first, second, strict=True))

    def test_reason_and_result_can_be_shown(self, build: Callable[[], Strategy]) -> None:
        strategy = build()
        for _ in range(self.batches):
            proposal = strategy.ask(self.size)
            assert proposal.reason.name
            assert all(isinstance(number, int | float) for number in proposal.reason.numbers.values())
            assert all(0 <= dimension < self.dimensions for dimension in proposal.reason.parameters)
            if not len(proposal):
                break
            strategy.tell(proposal.points, self.score(proposal.points))
        result: Any = strategy.result
        if result is not None:
            assert isinstance(result, Result)
            assert is_dataclass(type(result))
            assert all(isinstance(sentence, str) for sentence in result.sentences(("x",) * self.dimensions))

    def test_a_strategy_works_when_no_score_is_defined(self, build: Callable[[], Strategy]) -> None:
        strategy = build()
        for _ in range(self.batches):
            points = strategy.ask(self.size).points
            if not len(points):
                break
            strategy.tell(points, self.columned(np.full(len(points), np.nan)))

    def test_scores_of_other_points_are_refused(self, build: Callable[[], Strategy]) -> None:
        strategy = build()
        points = strategy.ask(self.size).points
        with pytest.raises(InvalidInput, match="points"):
            strategy.tell(points + 0.001, self.score(points))
        with pytest.raises(InvalidInput, match="scores"):
            strategy.tell(points, self.score(points)[:-1])
        strategy.tell(points, self.score(points))
