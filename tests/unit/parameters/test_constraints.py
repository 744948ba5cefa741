from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.constraints import compile_constraint
from valerie.parameters.definitions import ParameterDefinition


def define(name: str, path: str, **given: Any) -> ParameterDefinition:
    return ParameterDefinition.model_validate(
        {"name": name, "path": path, "type": "FLOAT", "default": 2.0, "affects": "geometry", **given}
    )


DEFINITIONS = (
    define("p1", "scene.person-1.pos.x"),
    define("p2", "scene.person-1.pos.y"),
    define("", "scene.person-2.pos.x"),
    define(
        "character", "scene.person-1.character", type="CATEGORICAL", choices=("black-outfit", "yellow-shirt"),
        default="yellow-shirt",
    ),
    define("lit", "scene.lamp-1.on", type="BOOL", default=True),
)  # fmt: skip


NAMES = {name: d for d in DEFINITIONS for name in (d.path, d.name)}


def holds(text: str, p1: float = 0.0, p2: float = 0.0, **more: Any) -> bool:
    values = {"scene.person-1.pos.x": p1, "scene.person-1.pos.y": p2, **more}
    return compile_constraint(text, NAMES).holds(values)


@given(st.integers(-5, 5), st.integers(-5, 5))
def test_a_constraint_means_what_python_means(p1: int, p2: int) -> None:
    for text in (
        "p1 < 3 and (p2 >= 2*p1 or p2 == 1)",
        "not p1 < p2 or p1 + p2 * 2 - 1 > -p1 / 4",
        "-2 <= p1 < p2 != 3",
        "p1 - p2 - 1 < 0 and not not p1 <= 2",
        "(p1 < 1) == (p2 < 1)",
    ):
        assert holds(text, p1, p2) == bool(eval(text, {}, {"p1": p1, "p2": p2}))


def test_names_with_dots_and_hyphens_and_paths_are_understood() -> None:
    assert holds("person-2.pos.x == 2 and scene.person-1.pos.x < 1")
    assert holds("p1-1 < 0")
    assert holds("p1 -p2 == 0")


def test_what_a_variant_does_not_say_has_its_default() -> None:
    assert compile_constraint("character == 'yellow-shirt' and lit", NAMES).holds({})


def test_signs_may_be_typographic() -> None:
    assert holds("p1 × 2 − p2 ÷ 2 == 5", 3, 2)


def test_text_without_quotes_is_told_so() -> None:
    with pytest.raises(InvalidInput, match="text is quoted: 'yellow-shirt'"):
        holds("character == yellow-shirt")


def test_a_constraint_names_the_parameters_that_it_speaks_of() -> None:
    constraint = compile_constraint("p1 < 1 or not lit", NAMES)
    assert constraint.paths == {"scene.person-1.pos.x", "scene.lamp-1.on"}


def test_a_division_by_zero_is_not_met() -> None:
    assert not holds("1 / p1 > 0", 0.0)


@pytest.mark.parametrize(
    "text",
    [
        "", "   ", "p1", "p1 <", "< 3", "p1 < 3 and", "(p1 < 3", "p1 < 3)", "p1 < 3 p2 < 3", "p1 = 3", "p1 < 'a'",
        "character < 'yellow-shirt'", "character == 3", "p1 + character < 3", "lit + 1 < 3", "not p1", "p1 and lit",
        "-lit", "p1 < 3; p2", "p1 ** 2 < 4", "p1 < 1e999", "p1 < [1]", "'a' 'b' == 'c'", "p1 < 3 m", "p1.__class__ < 3",
        "p1 < 3\x00", "1 < 2 < 'a'", "(" * 100 + "p1 < 3" + ")" * 100, "not " * 50 + "lit",
        "-" * 50 + "p1 < 3", "p1 < 3 or " * 500 + "p1 < 3",
    ],
)  # fmt: skip
def test_what_is_no_constraint_is_refused_with_its_field(text: str) -> None:
    with pytest.raises(InvalidInput) as problem:
        compile_constraint(text, NAMES, field="constraints.0")
    assert problem.value.field == "constraints.0"


@pytest.mark.parametrize("text", ["__import__('os')", "lambda: 1", "p3 < 1", "open('x') == 1", "person-1.poss.x < 1"])
def test_an_unknown_name_is_refused_and_never_executed(text: str) -> None:
    with pytest.raises(UnknownName):
        compile_constraint(text, NAMES)


def test_an_error_says_what_a_constraint_may_hold() -> None:
    for text in ("import os", "p1 = 3"):
        with pytest.raises(InvalidInput, match="limit: names, numbers, 'text', < <= > >= == !="):
            compile_constraint(text, NAMES)


def test_an_unknown_choice_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="did you mean yellow-shirt"):
        compile_constraint("character == 'yelow-shirt'", NAMES)


def test_an_error_says_where() -> None:
    with pytest.raises(InvalidInput, match=r"'!' is not expected here \(character 6\)"):
        compile_constraint("p1 < !", NAMES)


@given(st.text(alphabet="p12 <>=()+-*/'.andortlsecr\n", max_size=40))
def test_any_text_is_compiled_or_refused(text: str) -> None:
    try:
        constraint = compile_constraint(text, NAMES)
    except InvalidInput:
        return
    assert constraint.holds({}) in (True, False)
