"""Sentences about comparisons."""

import pytest

from valerie.analysis.comparison.wording import difference_of_specs


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"distribution": "CHOICE", "values": [40, -3]}, "CHOICE 40, -3"),
        ({"distribution": "HOMOGENEOUS", "minimum": 0, "maximum": 9, "step": 1.5}, "HOMOGENEOUS 0, 9, 1.5"),
        ({"distribution": "UNIFORM", "minimum": 0, "maximum": 9, "count": 5}, "UNIFORM 0, 9 count 5"),
        ({"distribution": "UNIFORM", "minimum": None, "maximum": None, "count": None}, "UNIFORM"),
        ({"width": 96, "height": 54}, "width 96, height 54"),
        (["camera-1", "camera-2"], "camera-1, camera-2"),
        (True, "true"),
    ],
)
def test_a_setting_is_said_as_a_spec_writes_it(value: object, words: str) -> None:
    assert difference_of_specs("vary.x", value, None) == f"vary.x ({words} here, not set there)"
