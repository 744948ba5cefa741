"""Specs of runs over the region of a selection."""

import numpy as np
import pytest

from tests.planted_tables import DEFINITION, X, planted_table
from valerie.analysis.findings.child_specs import similar_spec
from valerie.analysis.rows.table import EvaluationTable
from valerie.parameters.definitions import ParameterDefinition
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.resolving.spec import parse

SUN = "scene.sun-1.elevation"


@pytest.fixture
def names() -> dict[str, ParameterDefinition]:
    sun = ParameterDefinition.model_validate(
        {"path": SUN, "type": "ANGLE", "affects": "light", "minimum": -12, "maximum": 85, "default": 45}
    )
    return {name: one for one in (DEFINITION, sun) for name in (one.path, one.name)}


@pytest.fixture
def spec() -> RunSpec:
    return parse(
        "name: planted\nasset: urban-street\n"
        "vary:\n- [person-1.pos.x, HOMOGENEOUS, 0, 9, 1]\n- [sun-1.elevation, CHOICE, [40, -3]]"
    )


@pytest.fixture
def table() -> EvaluationTable:
    """Ten positions, by day and at dusk."""
    plain = planted_table([0.5] * 20, [*range(10)] * 2)
    columns = {name: plain.arrow[name] for name in plain.arrow.column_names}
    return EvaluationTable.from_columns(columns | {SUN: [40.0] * 10 + [-3.0] * 10}, {X: "FLOAT", SUN: "ANGLE"})


def test_more_like_these_leaves_a_listed_value_as_it_is(
    table: EvaluationTable, spec: RunSpec, names: dict[str, ParameterDefinition]
) -> None:
    dusk = table.select(table.numbers(SUN) < 0)
    child = similar_spec(dusk, table, spec, names, 50)
    assert child.name == "planted similar"
    (block,) = child.blocks
    assert {point[SUN] for point in block.points} == {-3}
    (block,) = similar_spec(table, table, spec, names, 50).blocks
    assert {point[SUN] for point in block.points} == {-3, 40}


def test_more_like_these_stays_in_the_range_of_the_selection(
    table: EvaluationTable, spec: RunSpec, names: dict[str, ParameterDefinition]
) -> None:
    x = table.numbers(X)
    (block,) = similar_spec(table.select((x >= 3) & (x <= 6)), table, spec, names, 200).blocks
    moved = np.array([point[X] for point in block.points], np.float64)
    assert (moved.min() >= 3, moved.max() <= 6) == (True, True)
    assert np.any(moved < 3.2)
    assert np.any(moved > 5.8)


def test_more_like_these_repeats_no_variant(
    table: EvaluationTable, spec: RunSpec, names: dict[str, ParameterDefinition]
) -> None:
    one = table.select((table.numbers(X) == 4) & (table.numbers(SUN) < 0))
    (block,) = similar_spec(one, table, spec, names, 50).blocks
    assert block.points == ({X: 4, SUN: -3},)
