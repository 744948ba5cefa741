"""Coverage of an operational design domain, counted by hand."""

from __future__ import annotations

import pytest

from tests.planted_tables import planted_table
from valerie.analysis.report.odd import Covered, odd_coverage, odd_json, odd_table
from valerie.analysis.rows.table import EvaluationTable
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.odd import OddAttribute, OddBranch

RAIN, LAMPS, WET, FOG = "scene.environment.rain", "scene.environment.street_lamps", "scene.wet", "scene.fog"
DECLARED = [
    {"path": RAIN, "type": "FLOAT", "minimum": 0, "maximum": 50, "unit": "mm/h", "default": 0,
     "odd": "rainfall", "source": "a standard"},
    {"path": LAMPS, "type": "CATEGORICAL", "choices": ["auto", "on", "off"], "default": "auto",
     "odd": "artificial illumination"},
    {"path": WET, "type": "BOOL", "default": False, "odd": "drivable area surface"},
    {"path": FOG, "type": "FLOAT", "minimum": 20, "maximum": 200, "unit": "m", "default": 200, "odd": "particulates"},
    {"path": "scene.camera-1.pos.x", "type": "FLOAT", "unit": "m", "default": 0},
]  # fmt: skip
DEFINITIONS = [ParameterDefinition.model_validate({"affects": "light", **name}) for name in DECLARED]


@pytest.fixture(scope="module")
def table() -> EvaluationTable:
    """Four frames, the last two rows of one frame; the rain of frame 1 and the lamps of frame 3 are the defaults."""
    planted = planted_table([0.5] * 5, [0, 1, 2, 3, 3])
    columns = planted.arrow.to_pylist()
    rain, lamps, wet = (12.0, None, 50.0, 12.0, 12.0), ("on", "on", "off", None, None), (True, False, False, True, True)
    rows = [{**row, RAIN: r, LAMPS: lamp, WET: w} for row, r, lamp, w in zip(columns, rain, lamps, wet, strict=True)]
    kinds = {**planted.parameters, RAIN: "FLOAT", LAMPS: "CATEGORICAL", WET: "BOOL"}
    return EvaluationTable.from_rows(rows, kinds)


def test_levels_and_pairs_are_counted_by_frame_and_missing_values_are_defaults(table: EvaluationTable) -> None:
    coverage = odd_coverage(DEFINITIONS, table, {FOG: 100.0})
    rain, lamps, wet = coverage.varied
    assert rain == Covered(
        OddAttribute.RAINFALL,
        "environment.rain",
        "a standard",
        ("0…10 mm/h", "10…20 mm/h", "20…30 mm/h", "30…40 mm/h", "40…50 mm/h"),
        (1, 2, 0, 0, 1),  # 0, twice 12, and 50, which belongs to the last part
    )
    assert rain.holes == ("20…30 mm/h", "30…40 mm/h")
    assert (lamps.levels, lamps.frames) == (("auto", "on", "off"), (1, 2, 1))
    assert (wet.levels, wet.frames) == (("false", "true"), (2, 2))
    pair = coverage.pairs[0]
    assert pair.frames == ((0, 1, 0), (1, 1, 0), (0, 0, 0), (0, 0, 0), (0, 0, 1))
    assert pair.possible == 9
    assert pair.holes == (
        ("0…10 mm/h", "auto"), ("0…10 mm/h", "off"), ("10…20 mm/h", "off"), ("40…50 mm/h", "auto"), ("40…50 mm/h", "on"),
    )  # fmt: skip
    assert len(coverage.pairs) == 3


def test_a_value_at_a_bound_of_two_levels_is_in_the_upper_one() -> None:
    planted = planted_table([0.5] * 6, range(6))
    rows = [{**row, FOG: k / 5} for k, row in enumerate(planted.arrow.to_pylist())]
    table = EvaluationTable.from_rows(rows, {**planted.parameters, FOG: "FLOAT"})
    share = {
        "name": "mist",
        "path": FOG,
        "type": "FLOAT",
        "minimum": 0,
        "maximum": 1,
        "default": 0,
        "odd": "particulates",
    }
    (fog,) = odd_coverage([ParameterDefinition.model_validate({"affects": "light", **share})], table, {}).varied
    assert fog.parameter == "fog"  # as findings name it
    assert fog.frames == (1, 1, 1, 1, 2)  # 0.6, which is 0.6000000000000001 as three fifths of 1, is no hole


def test_what_is_held_and_what_nothing_stands_for_is_named(table: EvaluationTable) -> None:
    coverage = odd_coverage(DEFINITIONS, table, {FOG: 100.0})
    assert [(hole.parameter, hole.value) for hole in coverage.held] == [("fog", "100 m")]
    assert OddAttribute.WIND in coverage.absent
    assert OddAttribute.PARTICULATES not in coverage.absent
    assert [(hole.parameter, hole.value) for hole in odd_coverage(DEFINITIONS, table, {}).held] == [("fog", "200 m")]


def test_json_and_table_hold_every_level_and_every_pair(table: EvaluationTable) -> None:
    coverage = odd_coverage(DEFINITIONS, table, {})
    rows = odd_table(coverage).to_pylist()
    assert len(rows) == (5 + 3 + 2) + (15 + 10 + 6)
    frames = 4  # each is at one level of every parameter, and at one pair of levels of every two
    assert sum(row["frames"] for row in rows) == frames * (3 + 3)
    document = odd_json(coverage)
    assert [name["branch"] for name in document["varied"]] == [
        OddBranch.ENVIRONMENT, OddBranch.ENVIRONMENT, OddBranch.SCENERY,
    ]  # fmt: skip
    assert document["pairs"][0]["first"] == "environment.rain"


def test_a_run_without_such_parameters_covers_nothing_and_says_so(table: EvaluationTable) -> None:
    coverage = odd_coverage(DEFINITIONS[-1:], table, {})
    assert (coverage.varied, coverage.pairs, coverage.held) == ((), (), ())
    assert coverage.absent == tuple(OddAttribute)
    assert odd_table(coverage).num_rows == 0
