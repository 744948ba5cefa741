"""Reasons of strategies in words."""

from __future__ import annotations

import pytest

from valerie.guided.compare import Compare
from valerie.guided.domain import Cube
from valerie.guided.estimate import Estimate
from valerie.guided.find import Find
from valerie.guided.map import Map
from valerie.guided.rank import Rank
from valerie.guided.strategy import Reason, Strategy, Why
from valerie.guided.verify import Verify
from valerie.studies.wording import reason_text

NAMES = ("distance", "sun", "heading")


@pytest.mark.parametrize(
    "strategy",
    [
        Estimate(Cube(3), at_least=0.5, seed=0),
        Find(Cube(3), at_least=0.5, seed=0),
        Map(Cube(3), at_least=0.5, seed=0),
        Rank(Cube(3), seed=0),
        Verify(Cube(3), bound=0.9, at_least=None, seed=0),
        Compare(Cube(3), within=0.1, seed=0),
    ],
    ids=lambda strategy: type(strategy).__name__,
)
def test_the_first_reason_of_a_strategy_is_a_sentence_with_its_numbers(strategy: Strategy) -> None:
    text = reason_text(strategy.ask(16).reason, NAMES)
    assert text.endswith(".")
    assert any(character.isdigit() for character in text)


def test_a_reason_names_the_parameters_that_it_is_about() -> None:
    assert "distance, heading" in reason_text(Reason(Why.BOUNDARY, parameters=(0, 2)), NAMES)


def test_a_reason_of_someone_elses_strategy_is_shown_by_its_name_and_numbers() -> None:
    assert reason_text(Reason("corners", {"points": 8, "share": 0.25}), NAMES) == "corners: points 8, share 0.25."
    assert reason_text(Reason("corners"), NAMES) == "corners."
