"""Reasons of strategies in words."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.guided_peers import cube as square
from valerie.guided.cascade import Cascade
from valerie.guided.compare import Compare
from valerie.guided.domain import Cube
from valerie.guided.estimate import Estimate
from valerie.guided.find import Find
from valerie.guided.map import Map
from valerie.guided.rank import Rank
from valerie.guided.strategy import Reason, Strategy, Why
from valerie.guided.verify import Verify
from valerie.studies.pairs import ExplainFromScratch
from valerie.studies.reasons import reason_text

NAMES = ("distance", "sun", "heading")


def score(points: np.ndarray) -> np.ndarray:
    """Scores of which a fifth fail; some are undefined."""
    scores = np.clip(0.2 + 0.8 * points[:, 0] + 0.2 * points[:, 1], 0, 1)
    return np.where(points[:, 2] > 0.95, np.nan, scores)


def reasons(strategy: Strategy, *, batches: int = 12, columns: int = 1) -> list[tuple[Reason, str]]:
    """Return the reasons of a strategy that learns a batch after the next one is proposed, as a study does."""
    given, waiting = [], []
    for _ in range(batches):
        proposal = strategy.ask(32)
        given.append((proposal.reason, reason_text(proposal.reason, NAMES), len(proposal)))
        waiting += [proposal.points] if len(proposal) else []
        while len(waiting) > 1 or (waiting and not len(proposal)):
            points = waiting.pop(0)
            strategy.tell(points, score(points) if columns == 1 else np.column_stack([score(points)] * columns))
    return [(reason, text) for reason, text, count in given if count]


STRATEGIES: dict[str, Callable[[], Strategy]] = {
    "estimate": lambda: Estimate(Cube(3), at_least=0.5, seed=0, first=64, pool=500),
    "find": lambda: Find(Cube(3), at_least=0.5, seed=0),
    "map": lambda: Map(Cube(3), at_least=0.5, seed=0),
    "rank": lambda: Rank(Cube(3), seed=0),
    "verify": lambda: Verify(Cube(3), bound=0.81, at_least=0.5, seed=0),
    "compare": lambda: Compare(Cube(3), within=0.01, seed=0),
    "cascade": lambda: Cascade(Cube(3), seed=0, costs=(1, 25)),
    "explain": lambda: ExplainFromScratch(square(3), None, at_least=0.5, seed=0, batch=32),
}


@pytest.mark.parametrize("goal", STRATEGIES)
def test_every_batch_says_what_was_known_what_is_uncertain_and_what_it_decides(goal: str) -> None:
    texts = reasons(STRATEGIES[goal](), columns=2 if goal == "compare" else 1)
    assert len(texts) >= 3
    for reason, text in texts:
        assert len(re.findall(r"[a-z%)\d]\.( |$)", text)) >= 3, text
        assert "nan" not in text
        points = reason.numbers.get("points", reason.numbers.get("exploring"))
        assert points is not None
        assert re.search(rf"\b{points} (points?|explore)", text) or "operational" in reason.numbers, text
    known = [text.split(". ")[0] for _, text in texts]
    assert len(set(known)) > 1, "what is known changes from batch to batch"


def test_a_comparison_with_few_pairs_forecasts_nothing() -> None:
    (_, first), (_, second), *later = reasons(Compare(Cube(3), within=0.01, seed=0), columns=2)
    assert "more at the present spread" not in first + second
    assert "more at the present spread" in later[-1][1]


def test_a_reason_names_the_parameters_that_it_is_about() -> None:
    assert "distance, heading" in reason_text(Reason(Why.BOUNDARY, {"points": 3}, (0, 2)), NAMES)


def test_a_reason_of_someone_elses_strategy_is_shown_by_its_name_and_numbers() -> None:
    assert reason_text(Reason("corners", {"points": 8, "share": 0.25}), NAMES) == "corners: points 8, share 0.25."
    assert reason_text(Reason("corners"), NAMES) == "corners."
