from dataclasses import asdict

import orjson
import pytest

from valerie.errors import UnknownName
from valerie.labels import TRAIN_LABELS
from valerie.perception.base import FunctionCard, judged_ids


def card(*judged_by: str) -> FunctionCard:
    return FunctionCard("f", "0" * 64, "test", "fp32", "numpy", {}, judged_by)


def test_a_card_comes_back_from_json_as_it_was() -> None:
    narrow = card("car", "person")
    assert FunctionCard(**orjson.loads(orjson.dumps(asdict(narrow)))) == narrow
    assert narrow.judged_by == ("person", "car")
    assert narrow.judged_ids == (11, 13)


def test_all_classes_are_spelt_in_one_way() -> None:
    assert card(*(label.name for label in TRAIN_LABELS)) == card()
    assert card().judged_ids == judged_ids(()) == tuple(range(19))


def test_a_card_that_is_judged_by_an_unknown_class_is_refused() -> None:
    with pytest.raises(UnknownName, match=r"judged_by: unknown evaluated class 'persons'; did you mean person"):
        card("persons")
