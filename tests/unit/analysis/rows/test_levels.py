"""Groups of rows by the value of a varied parameter."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.analysis.rows.levels import factor_of, factors_of
from valerie.analysis.rows.table import EvaluationTable

TYPES = {"scene.lamp.on": "BOOL", "scene.a.heading": "ANGLE", "scene.a.pos.x": "FLOAT", "scene.a.colour": "CATEGORICAL"}


@pytest.fixture
def of(synthetic):
    def table(**columns):
        paths = {path: columns.get(path.rpartition(".")[2]) for path in TYPES}
        count = max(len(values) for values in columns.values())
        (row, *_) = synthetic(lambda *_: 1.0, xs=[0.0], ys=[5.0])
        own = {name: value for name, value in row.items() if not name.startswith("scene.")}
        rows = [
            {**own, "frame_id": str(k), "variant_index": k, **{p: v[k] if v else None for p, v in paths.items()}}
            for k in range(count)
        ]
        return EvaluationTable.from_rows(rows, TYPES)

    return table


def test_each_of_a_few_values_is_a_level(of):
    table = of(on=[True, False, True], heading=[90.0, 0.0, 90.0], colour=["red", "blue", "red"])
    on, heading, colour = (factor_of(table, path) for path in list(TYPES)[:2] + list(TYPES)[3:])

    assert on.levels == ("false", "true")
    assert heading.levels == ("0°", "90°")
    assert colour.levels == ("blue", "red")
    assert heading.codes.tolist() == colour.codes.tolist() == on.codes.tolist() == [1, 0, 1]
    assert heading.name == "a.heading"


def test_many_numbers_become_a_few_round_ranges_and_each_row_lies_in_one(of):
    x = np.linspace(-2.0, 7.0, 50)
    factor = factor_of(of(x=x.tolist()), "scene.a.pos.x")

    assert factor.levels == ("-2 to 0 m", "0 to 2 m", "2 to 4 m", "4 to 6 m", "6 to 8 m")
    np.testing.assert_array_equal(factor.codes, (x + 2) // 2)


def test_ranges_without_rows_are_no_levels(of):
    x = np.concatenate([np.linspace(0.0, 1.0, 10), np.linspace(9.0, 10.0, 10)])

    assert factor_of(of(x=x.tolist()), "scene.a.pos.x").levels == ("0 to 2 m", "8 to 10 m", "10 to 12 m")


def test_a_row_without_a_value_has_the_default(of):
    factor = factor_of(of(x=[None, 2.5]), "scene.a.pos.x")

    assert factor.levels == ("2.5 m", "default")
    assert factor.codes.tolist() == [1, 0]


def test_what_varies_is_parameters_then_camera_sensor_and_person(dropping_table):
    assert [factor.name for factor in factors_of(dropping_table)] == [
        "person-1.pos.x",
        "person-1.pos.y",
        "person-1.character",
        "camera",
    ]
