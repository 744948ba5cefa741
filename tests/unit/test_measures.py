"""The table of measures, held against the code that computes them and the tables that store them."""

from __future__ import annotations

from dataclasses import fields

import pytest

from valerie.analysis.rows.table import schema_of
from valerie.datasets.index import COLUMNS
from valerie.db import long_table
from valerie.errors import UnknownName
from valerie.measures import MEASURES, OF_FUNCTION, OF_PERSON, WITHOUT_FUNCTION, Source, measure_of, names_from
from valerie.metrics.instances import InstanceCounts
from valerie.rendering.person_light import PersonLight
from valerie.rendering.visibility import Visibility
from valerie.scene.variation.conditions import Conditions


def test_names_are_different_and_a_misspelt_one_is_told() -> None:
    names = [measure.name for measure in MEASURES]
    assert len(set(names)) == len(names)
    assert measure_of("distance_m").title == "distance"
    with pytest.raises(UnknownName, match="distance_m"):
        measure_of("distance")


def test_every_measure_of_a_person_is_computed() -> None:
    visibility = {field.name for field in fields(Visibility)}
    assert set(names_from(Source.PLACE, Source.PIXELS)) <= visibility
    assert {*names_from(Source.LIGHT), "instance_id"} == {field.name for field in fields(PersonLight)}
    assert set(names_from(Source.CONDITIONS)) == {*Conditions._fields, "time_s"}
    scores = InstanceCounts(24001, 3, 1).measures
    assert set(scores) == set(names_from(Source.PERSON_SCORE))
    assert scores.items() >= {"tp": 3, "fn": 1, "pacc": 0.75, "pacc_empty": None}.items()
    assert InstanceCounts(24001, 3, 1, tp_empty=1).measures["pacc_empty"] == 0.25


def test_every_table_has_the_measures_that_belong_to_it() -> None:
    assert schema_of({}).names == [measure.name for measure in MEASURES]
    stored = set(names_from(*OF_PERSON, Source.PICTURE, Source.PERSON_SCORE, Source.FRAME_SCORE))
    assert stored <= set(long_table.COLUMNS)
    assert set(names_from(*WITHOUT_FUNCTION)) <= {name for name, _, _ in COLUMNS}
    assert not set(names_from(*WITHOUT_FUNCTION)) & set(names_from(*OF_FUNCTION))


def test_examples_fit_type_and_bounds() -> None:
    for measure in MEASURES:
        if measure.example is not None:
            assert type(measure.example) is measure.type.python, measure.name
        if isinstance(measure.example, int | float):
            assert measure.low is None or measure.example >= measure.low, measure.name
            assert measure.high is None or measure.example <= measure.high, measure.name


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("distance_m", 17.086, "17.09 m"),
        ("occlusion_rate", 0.0519, "5.2 %"),
        ("bearing_deg", -4.55, "-4.5°"),
        ("pixel_area", 21900, "21,900 pixels"),
        ("tp", 1980, "1,980"),
    ],
)
def test_values_are_shown_with_their_unit(name: str, value: float, text: str) -> None:
    assert measure_of(name).text(value) == text


def test_a_range_names_its_unit_once() -> None:
    assert measure_of("occlusion_rate").range_text(0.05, 0.1) == "5–10 %"
