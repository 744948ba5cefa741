import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import ParameterDefinition, wrap


def define(**given: Any) -> ParameterDefinition:
    return ParameterDefinition.model_validate(
        {"path": "scene.person-1.pos.x", "type": "FLOAT", "default": 0, "affects": "geometry", **given}
    )


def test_the_name_follows_from_the_path_and_the_papers_word_for_the_path_is_understood() -> None:
    definition = ParameterDefinition.model_validate(
        {"scene_graph_ref": "scene.person-1.pos.x", "type": "FLOAT", "default": 0, "affects": "geometry"}
    )
    assert definition.name == "person-1.pos.x"
    assert definition.path == "scene.person-1.pos.x"


def test_an_angle_is_a_full_turn_in_degrees_unless_declared_otherwise() -> None:
    heading = define(type="ANGLE")
    assert (heading.minimum, heading.maximum, heading.unit) == (0.0, 360.0, "deg")


def test_a_definition_survives_json() -> None:
    definition = define(minimum=-1, maximum=2, unit="m", description="across")
    assert ParameterDefinition.model_validate_json(definition.model_dump_json()) == definition


@pytest.mark.parametrize(
    "given",
    [
        {"minimum": 2, "maximum": 1},
        {"minimum": 1, "maximum": 2, "default": 0},
        {"minimum": math.nan},
        {"maximum": math.inf},
        {"maximum": 1e13},
        {"default": math.nan},
        {"type": "ANGLE", "minimum": 0, "maximum": 361},
        {"type": "ANGLE", "minimum": 0},
        {"type": "CATEGORICAL", "default": "a"},
        {"type": "CATEGORICAL", "choices": ["a", "a"], "default": "a"},
        {"type": "CATEGORICAL", "choices": ["a"], "minimum": 0, "default": "a"},
        {"type": "BOOL", "default": 1},
        {"type": "INT", "default": 0.5},
        {"choices": ["a"]},
        {"path": "person.x"},
    ],
)
def test_a_declaration_that_contradicts_itself_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput):
        define(**given)


def test_a_value_takes_the_form_of_its_type() -> None:
    assert repr(define().check(3)) == "3.0"
    assert repr(define().check(-0.0)) == "0.0"
    assert repr(define(type="INT").check(3.0)) == "3"
    assert define(type="BOOL", default=True).check(False) is False
    assert define(type="CATEGORICAL", choices=("a", "b"), default="a").check("b") == "b"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 10**400, "3", True, None, [1.0], 20.000001])
def test_what_is_no_number_of_the_range_is_refused(value: object) -> None:
    with pytest.raises(InvalidInput) as problem:
        define(minimum=0, maximum=20).check(value, field="p1")
    assert problem.value.field == "p1"


def test_an_unknown_choice_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="did you mean yellow-shirt"):
        define(type="CATEGORICAL", choices=("black-outfit", "yellow-shirt"), default="yellow-shirt").check(
            "yelow-shirt"
        )


def test_an_angle_is_periodic_within_its_declared_window() -> None:
    full, signed = define(type="ANGLE"), define(type="ANGLE", minimum=-90, maximum=90)
    assert full.check(360) == full.check(-720) == 0.0
    assert full.check(-90) == 270.0
    assert signed.check(315) == -45.0
    with pytest.raises(InvalidInput):
        signed.check(180)


@given(st.floats(-1e6, 1e6), st.sampled_from([0.0, -180.0, -90.0, 30.0]))
def test_a_wrapped_angle_lies_in_its_window_and_is_the_same_angle(degrees: float, start: float) -> None:
    turned = wrap(degrees, start)
    assert start <= turned < start + 360.0
    assert math.isclose(math.remainder(turned - degrees, 360.0), 0.0, abs_tol=1e-8)
    assert wrap(turned, start) == turned


def test_a_tiny_negative_angle_does_not_become_a_whole_turn() -> None:
    assert wrap(-1e-300) == 0.0


def test_a_value_in_words_has_its_unit_if_it_is_a_number() -> None:
    across, heading = define(unit="m"), define(type="ANGLE")
    assert [across.text(0.1 + 0.2), across.text(1234.5678, 4), heading.text(90.0)] == ["0.3 m", "1235 m", "90 deg"]
    assert define(type="INT", unit="px").text(12_345_678) == "12345678 px"
    assert define().text(2.5) == "2.5"
    assert [define(type="BOOL", default=True).text(value) for value in (True, False)] == ["true", "false"]
    assert define(type="CATEGORICAL", choices=["a", "b"], default="a", unit="").text("b") == "b"
