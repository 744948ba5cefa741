from typing import Any

import pytest

from valerie.perception.documents.cards import card_rows
from valerie.perception.documents.function import FunctionDocument, parse_function
from valerie.perception.documents.training_data import has_seen, trained_on
from valerie.perception.shipped import FUNCTIONS, function_document


def document(**entries: Any) -> FunctionDocument:
    return parse_function({"name": "mine", "kind": "predictions", **entries})


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_shipped_functions_were_trained_on_the_sites_that_their_cards_state(name: str) -> None:
    shipped = function_document(name)
    card = dict(card_rows(shipped.card(), shipped))
    assert card["trained on"].startswith("urban-street ")
    assert has_seen(shipped, "urban-street", 1000)
    assert has_seen(shipped, "urban-street", 1124)
    # The default of runs, and the sites kept apart.
    assert not any(has_seen(shipped, "urban-street", seed) for seed in (0, 7, 900, 999, 1133))
    assert not has_seen(shipped, "my-street", None)


@pytest.mark.parametrize(
    ("part", "seed", "seen"),
    [("1000-1094; 1100", 1094, True), ("1000-1094; 1100", 1095, False), ("1000-1094; 1100", 1100, True), ("", 3, True)],
)
def test_a_document_states_the_sites_of_its_training(part: str, seed: int, seen: bool) -> None:
    stated = document(trained_on={"urban-street": part, "Cityscapes": "train"})
    assert has_seen(stated, "urban-street", seed) is seen
    assert has_seen(stated, "Cityscapes", None)
    assert dict(card_rows(stated.card(), stated))["trained on"] == f"urban-street {part}".strip() + ", Cityscapes train"


def test_without_a_statement_nothing_is_known() -> None:
    assert trained_on(document()) == {}
    assert not has_seen(document(), "urban-street", 1000)
    assert "trained on" not in dict(card_rows(document().card(), document()))


def test_an_absent_statement_changes_no_digest() -> None:
    assert document(trained_on={}).digest == document().digest
    assert document(trained_on={"Cityscapes": "train"}).digest != document().digest
