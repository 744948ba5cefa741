import math

import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.quantities import to_unit


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("30 cm", "m", 0.3),
        ("1500mm", "m", 1.5),
        ("0.02 km", "m", 20.0),
        ("5 cm", "mm", 50.0),
        ("-0.5 EV", "EV", -0.5),
        ("30 %", "", 0.3),
        ("45 °", "deg", 45.0),
        ("1e1 m", "m", 10.0),
        ("7 W/m²", "W/m²", 7.0),
    ],
)
def test_a_quantity_is_converted_in_decimals(text: str, unit: str, number: float) -> None:
    assert to_unit(text, unit) == (number, True)


def test_radians_become_degrees() -> None:
    assert math.isclose(to_unit(f"{math.pi!r} rad", "deg").number, 180.0, rel_tol=1e-15)


@pytest.mark.parametrize("value", [3, 3.0, "3"])
def test_a_number_without_unit_takes_the_declared_unit_and_says_so(value: object) -> None:
    assert to_unit(value, "m") == (3.0, False)


def test_an_unknown_unit_lists_near_matches_or_those_that_fit() -> None:
    with pytest.raises(UnknownName, match=r"unknown unit 'ft'; known: cm, km, m, mm$"):
        to_unit("3 ft", "m")
    with pytest.raises(UnknownName, match=r"vary\.0\.step: unknown unit 'degs'; did you mean deg"):
        to_unit("3 degs", "deg", field="vary.0.step")


@pytest.mark.parametrize(
    "value",
    ["3 deg", "3 %", "m", "", "3 m m", "nan", "inf", "1e400", "1e999999999", "9" * 400, "0x10", "1_000", True, None,
     math.nan, math.inf, 1e13, 10**400, [3]],
)  # fmt: skip
def test_what_is_no_usable_length_is_refused(value: object) -> None:
    with pytest.raises(InvalidInput):
        to_unit(value, "m")
