"""Groups of rows by the value of a varied parameter."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.analysis.levels import MAX_LEVELS, levels_of
from valerie.analysis.table import EvaluationTable

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
    assert [level.name for level in levels_of(table, "scene.lamp.on")] == ["false", "true"]
    assert [(level.low, level.high, level.unit) for level in levels_of(table, "scene.a.heading")] == [
        (0.0, 0.0, "°"),
        (90.0, 90.0, "°"),
    ]
    assert [level.name for level in levels_of(table, "scene.a.colour")] == ["blue", "red"]
    assert levels_of(table, "scene.a.heading")[1].rows.tolist() == [True, False, True]


def test_many_numbers_become_a_few_round_ranges_and_each_row_lies_in_one(of):
    x = np.linspace(-2.0, 7.0, 50).tolist()
    levels = levels_of(of(x=x), "scene.a.pos.x")
    assert [(level.low, level.high) for level in levels] == [(-2, 0), (0, 2), (2, 4), (4, 6), (6, 8)]
    assert len(levels) <= MAX_LEVELS
    assert np.sum([level.rows for level in levels], axis=0).tolist() == [1] * 50


def test_a_row_without_a_value_is_in_no_level(of):
    x = [*np.linspace(0.0, 1.0, 20).tolist(), None]
    levels = levels_of(of(x=x), "scene.a.pos.x")
    assert not any(level.rows[-1] for level in levels)
    assert levels_of(of(x=[None, 2.5]), "scene.a.pos.x")[0].rows.tolist() == [False, True]
