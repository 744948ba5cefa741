"""Names of the scene graph: classes, instances, inheritance."""

import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.paths import parse_path
from valerie.scene.graph.naming import ObjectLabel, likely_name, node_name, object_labels, parse_object_name

PERSON, CAR, LIGHT, BUILDING, STATIC = 24, 26, 19, 11, 4


def test_an_object_name_is_class_and_instance_even_when_the_class_has_a_hyphen() -> None:
    assert parse_object_name("traffic-light-3") == ("traffic-light", 3)
    assert parse_object_name("person-1") == ("person", 1)
    assert parse_object_name("yellow-shirt") is None


def test_a_part_inherits_label_and_instance_of_the_object_it_is_part_of() -> None:
    labels = object_labels(["scene.car-3", "scene.car-3.door-1", "scene.car-3.door-1.handle"], {})
    assert set(labels.values()) == {ObjectLabel(CAR, CAR * 1000 + 3)}


def test_a_bag_belongs_to_the_person_even_if_its_name_states_a_class() -> None:
    labels = object_labels(["scene.person-2", "scene.person-2.bicycle-1"], {})
    assert labels["scene.person-2.bicycle-1"] == ObjectLabel(PERSON, PERSON * 1000 + 2)


def test_classes_without_instances_have_instance_id_zero() -> None:
    assert object_labels(["scene.traffic-light-3"], {})["scene.traffic-light-3"] == ObjectLabel(LIGHT, 0)


def test_objects_below_a_group_without_class_are_objects_of_their_own() -> None:
    labels = object_labels(["scene.block", "scene.block.building-1", "scene.block.car-2"], {})
    assert labels["scene.block"] == ObjectLabel(0, 0)
    assert labels["scene.block.building-1"].label_id == BUILDING
    assert labels["scene.block.car-2"].instance_id == CAR * 1000 + 2


def test_node_classes_win_over_names_and_are_inherited() -> None:
    labels = object_labels(["scene.car-1", "scene.car-1.door-1"], {"scene.car-1": "static"})
    assert labels["scene.car-1"].label_id == labels["scene.car-1.door-1"].label_id == STATIC


def test_an_object_that_node_classes_name_gets_the_first_free_number_with_all_its_parts() -> None:
    labels = object_labels(["scene.Anna", "scene.Anna.hat", "scene.person-1"], {"scene.Anna": "person"})
    assert labels["scene.Anna"] == labels["scene.Anna.hat"] == ObjectLabel(PERSON, PERSON * 1000 + 2)
    assert labels["scene.person-1"].instance_id == PERSON * 1000 + 1


def test_two_objects_with_one_instance_id_are_refused_by_name() -> None:
    with pytest.raises(InvalidInput, match=r"scene\.a\.person-1 and scene\.b\.person-1"):
        object_labels(["scene.a", "scene.b", "scene.a.person-1", "scene.b.person-1"], {})


def test_an_instance_number_above_the_limit_is_refused() -> None:
    with pytest.raises(InvalidInput, match="999"):
        object_labels(["scene.person-1000"], {})


def test_an_unknown_class_in_node_classes_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="building"):
        object_labels(["scene.a"], {"scene.a": "bulding"})


@pytest.mark.parametrize("given", ["Cube.001", "7up", "Röhre", "a--b-", "-", "", None, "door 2"])
def test_any_name_from_a_file_becomes_one_that_may_stand_in_a_path(given: str | None) -> None:
    name = node_name(given, 7)
    assert parse_path(f"scene.{name}.rot.z")[1] == name


def test_a_good_name_is_kept() -> None:
    assert node_name("traffic-light-3", 0) == "traffic-light-3"


@pytest.mark.parametrize(
    ("name", "likely"),
    [
        ("Person_01", "person-1"),
        ("person3", "person-3"),
        ("CAR 2", "car-2"),
        ("buildings_7", "building-7"),
        ("TrafficLight.004", "traffic-light-4"),
        ("traffic_sign", "traffic-sign-1"),
        ("Cube_001", None),
        ("house-1", None),
        ("", None),
    ],
)
def test_likely_names(name: str, likely: str | None) -> None:
    assert likely_name(name) == likely
