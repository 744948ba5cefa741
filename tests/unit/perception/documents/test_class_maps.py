import numpy as np
import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.labels import CITYSCAPES, VOID
from valerie.perception.documents.class_maps import CLASS_LISTS, class_lookup, require_person


def test_classes_with_cityscapes_names_map_themselves() -> None:
    table = class_lookup(["sky", "person", "road"], {})
    assert table[:3].tolist() == [10, 11, 0]


def test_ids_that_no_class_has_are_void() -> None:
    assert set(class_lookup(["person"], {})[1:].tolist()) == {VOID}


def test_the_19_classes_are_train_ids_already() -> None:
    assert class_lookup(CLASS_LISTS["cityscapes"], {})[:19].tolist() == list(range(19))


def test_label_ids_become_the_train_ids_of_the_cityscapes_table() -> None:
    table = class_lookup(CLASS_LISTS["cityscapes-label-ids"], {})
    assert table[:34].tolist() == [label.train_id for label in CITYSCAPES]


def test_a_class_is_mapped_by_name_or_by_id() -> None:
    table = class_lookup(["thing", "pedestrian"], {"pedestrian": "person", "0": "building"})
    assert table[:2].tolist() == [2, 11]


def test_the_map_wins_over_the_name() -> None:
    assert class_lookup(["person", "rider"], {"rider": "person"})[1] == 11
    assert class_lookup(["person", "rider"], {"rider": "void"})[1] == VOID


def test_person_or_not_leaves_the_other_class_void_and_never_a_person() -> None:
    assert class_lookup(["not", "human"], {"human": "person"})[:2].tolist() == [VOID, 11]


def test_a_class_that_is_not_evaluated_counts_as_void() -> None:
    assert class_lookup(["person", "lot"], {"lot": "parking"})[1] == VOID


def test_the_table_is_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        class_lookup(["person"], {})[0] = 1


def test_a_misspelt_target_names_its_neighbours() -> None:
    with pytest.raises(UnknownName, match=r"class_map\.human.*persn.*did you mean person") as caught:
        class_lookup(["human"], {"human": "persn"})
    assert caught.value.field == "output.class_map.human"


def test_a_misspelt_class_names_its_neighbours() -> None:
    with pytest.raises(UnknownName, match="did you mean human"):
        class_lookup(["human"], {"humann": "person"})


@pytest.mark.parametrize("key", ["2", "-1", "1.0", "²"])
def test_an_id_that_the_function_does_not_have_is_refused(key: str) -> None:
    with pytest.raises(UnknownName):
        class_lookup(["person", "road"], {key: "person"})


def test_a_class_mapped_by_name_and_by_id_is_refused() -> None:
    with pytest.raises(InvalidInput, match="mapped already"):
        class_lookup(["a", "person"], {"a": "road", "0": "road"})


def test_classes_that_repeat_are_refused() -> None:
    with pytest.raises(InvalidInput, match="must differ; got person"):
        class_lookup(["person", "person"], {})


def test_a_function_that_reaches_no_evaluated_class_is_refused() -> None:
    with pytest.raises(InvalidInput, match="no class leads"):
        class_lookup(["cat", "dog"], {"cat": "void"})


def test_the_table_maps_label_maps_of_any_shape() -> None:
    table = class_lookup(["void", "human"], {"human": "person"})
    np.testing.assert_array_equal(table[np.array([[1, 0], [9, 1]])], [[11, VOID], [VOID, 11]])


@pytest.mark.parametrize(
    ("classes", "class_map", "right"),
    [
        (["road", "human"], {}, "{human: person}"),
        (["road", "human"], {"human": "void"}, "{human: person}"),
        (["road", "person"], {"person": "rider"}, "{person: person}"),
        (["road", "Pedestrian", "adult-person"], {}, "{Pedestrian: person, adult-person: person}"),
        (["road", "human--person--child", "human--rider--cyclist"], {}, "{human--person--child: person}"),
        (["road", "2"], {}, "{NAME: person}"),
    ],
)
def test_a_function_that_cannot_say_person_is_told_the_class_map_that_would_be_right(
    classes: list[str], class_map: dict[str, str], right: str
) -> None:
    with pytest.raises(InvalidInput, match="no class of the function is a person") as refused:
        require_person(classes, class_map)
    assert refused.value.field == "output.class_map"
    assert right in str(refused.value.limit)


@pytest.mark.parametrize(("classes", "class_map"), [(["road", "person"], {}), (["other", "human"], {"1": "person"})])
def test_a_function_that_can_say_person_passes(classes: list[str], class_map: dict[str, str]) -> None:
    require_person(classes, class_map)
