import csv
import io
import json

import numpy as np
import pyarrow as pa
import pytest

from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable, combine
from valerie.errors import CorruptArtifact, InvalidInput, UnknownName
from valerie.measures import MEASURES
from valerie.statistics.replicates import replicates
from valerie.statistics.units import Estimand

FLAT = {"xs": [0.0, 1.5], "ys": [5.0, 20.0]}


def half(*_: object) -> float:
    return 0.5


@pytest.fixture
def rows(synthetic):
    return synthetic(half, **FLAT)


def test_rows_become_one_typed_column_each_in_a_fixed_order(rows, parameters):
    table = EvaluationTable.from_rows(rows, parameters)

    assert len(table) == len(rows) == 2 * 2 * 2 * 3 * 2
    assert table.arrow.column_names == [measure.name for measure in MEASURES] + list(parameters)
    assert table.arrow.schema.field("scene.person-1.pos.x").type == pa.float64()
    assert table.arrow["character"].to_pylist() == [row["character"] for row in rows]
    np.testing.assert_array_equal(table.numbers("tp"), [row["tp"] for row in rows])


def test_columns_and_rows_give_the_same_table(rows, parameters):
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    by_column = EvaluationTable.from_columns(columns, parameters)

    assert by_column.arrow.equals(EvaluationTable.from_rows(rows, parameters).arrow)


def test_parquet_gives_back_the_same_table_with_its_gaps_and_types(rows, parameters):
    rows[0] |= {"pixel_area": 0, "tp": 0, "fn": 0, "pacc": None, "undefined_reason": "fully hidden"}
    rows[1] |= {"character": None}
    table = EvaluationTable.from_rows(rows, parameters)
    sink = io.BytesIO()
    table.to_parquet(sink)
    sink.seek(0)
    back = EvaluationTable.from_parquet(sink)

    assert back.arrow.equals(table.arrow)
    assert back.parameters == table.parameters
    assert back.arrow["pacc"][0].as_py() is None
    assert np.isnan(back.numbers("pacc")[0])


def test_csv_has_the_same_values_as_text(rows, parameters, tmp_path):
    rows[0] |= {"pacc": None, "undefined_reason": 'a, "quoted" reason'}
    rows[2] |= {"precision": None, "character": None}
    table = EvaluationTable.from_rows(rows, parameters)
    path = tmp_path / "table.csv"
    table.to_csv(path)
    with path.open(newline="") as stream:
        lines = list(csv.DictReader(stream))
    for text, row in zip(lines, table.arrow.to_pylist(), strict=True):
        for name, value in row.items():
            if value is None:
                assert text[name] == ""
            else:
                assert (text[name] if isinstance(value, str) else json.loads(text[name])) == value


def test_nan_is_an_empty_value(rows, parameters):
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    columns["iou"] = np.full(len(rows), np.nan)
    table = EvaluationTable.from_columns(columns, parameters)

    assert table.arrow["iou"].null_count == len(rows)


def test_an_undefined_pacc_without_reason_is_refused(rows, parameters):
    rows[3]["pacc"] = None
    with pytest.raises(InvalidInput, match="pacc is undefined exactly where"):
        EvaluationTable.from_rows(rows, parameters)


def test_a_reason_beside_a_defined_pacc_is_refused(rows, parameters):
    rows[3]["undefined_reason"] = "fully hidden"
    with pytest.raises(InvalidInput, match="pacc is undefined exactly where"):
        EvaluationTable.from_rows(rows, parameters)


@pytest.mark.parametrize(("column", "value"), [("pacc", 50.0), ("occlusion_rate", -0.1), ("tp", -1)])
def test_values_out_of_bounds_are_refused_by_name(rows, parameters, column, value):
    rows[0][column] = value
    with pytest.raises(InvalidInput, match="out of bounds") as caught:
        EvaluationTable.from_rows(rows, parameters)
    assert caught.value.field == column


def test_an_empty_required_value_is_refused_by_name(rows, parameters):
    rows[0]["function"] = None
    with pytest.raises(InvalidInput) as caught:
        EvaluationTable.from_rows(rows, parameters)
    assert caught.value.field == "function"


def test_a_missing_column_is_named(rows, parameters):
    columns = {key: [row[key] for row in rows] for key in rows[0] if key != "camera"}
    with pytest.raises(InvalidInput) as caught:
        EvaluationTable.from_columns(columns, parameters)
    assert caught.value.field == "camera"


def test_columns_of_different_length_are_refused(rows, parameters):
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    columns["tp"] = columns["tp"][:-1]
    with pytest.raises(InvalidInput, match="differ in length"):
        EvaluationTable.from_columns(columns, parameters)


def test_an_unknown_column_lists_near_matches(rows, parameters):
    rows[0]["occlusion_rat"] = 0.1
    with pytest.raises(UnknownName, match="occlusion_rate"):
        EvaluationTable.from_rows(rows, parameters)


def test_text_in_a_number_column_is_refused_by_name(rows, parameters):
    rows[0]["distance_m"] = "far"
    with pytest.raises(InvalidInput) as caught:
        EvaluationTable.from_rows(rows, parameters)
    assert caught.value.field == "distance_m"


def test_an_unknown_parameter_type_is_refused(rows):
    with pytest.raises(UnknownName, match="parameter type"):
        EvaluationTable.from_rows(rows, {"scene.person-1.pos.x": "REAL"})


def test_a_table_may_be_empty(parameters):
    table = EvaluationTable.from_rows([], parameters)

    assert len(table) == 0
    assert table.codes("function").names == ()
    assert len(table.places) == len(table.units.index) == len(table.evaluations) == 0


def test_another_file_is_refused():
    with pytest.raises(CorruptArtifact, match="not a Parquet"):
        EvaluationTable.from_parquet(io.BytesIO(b"not parquet at all"))
    sink = io.BytesIO()
    pa.parquet.write_table(pa.table({"a": [1]}), sink)
    sink.seek(0)
    with pytest.raises(CorruptArtifact, match="no parameter types"):
        EvaluationTable.from_parquet(sink)


def test_codes_number_the_names_in_order_and_gaps_as_minus_one(rows, parameters):
    rows[0]["character"] = None
    codes = EvaluationTable.from_rows(rows, parameters).codes("character")

    assert codes.names == ("black-outfit", "yellow-shirt")
    names = [None if i < 0 else codes.names[i] for i in codes.index]
    assert names == [row["character"] for row in rows]
    np.testing.assert_array_equal(codes.where("yellow-shirt"), [r["character"] == "yellow-shirt" for r in rows])
    assert not codes.where("nobody").any()


def test_codes_of_a_selection_name_only_what_is_left(rows, parameters):
    table = EvaluationTable.from_rows(rows, parameters)
    selected = table.select(table.codes("function").where("b-net"))

    assert selected.codes("function").names == ("b-net",)
    assert len(selected) == len(table) // 2


def test_a_column_of_names_has_no_numbers(rows, parameters):
    table = EvaluationTable.from_rows(rows, parameters)
    with pytest.raises(InvalidInput, match="names, not numbers"):
        table.numbers("camera")
    with pytest.raises(UnknownName):
        table.numbers("distance")


def of_designs(rows, parameters, **designs):
    """A table of the rows once for each run, with the design of that run."""
    repeated = [{**row, "run_id": run} for run in designs for row in rows]
    return EvaluationTable.from_rows(repeated, parameters, designs)


def test_listed_variants_share_a_place_where_the_person_stands_alike(rows, parameters):
    table = of_designs(rows, parameters, r=Design((("grid", 8),), site=3))
    positions = [(row["scene.person-1.pos.x"], row["scene.person-1.pos.y"]) for row in rows]
    pairs = set(zip(positions, table.places.tolist(), strict=True))

    assert len(pairs) == len(set(positions)) == len({place for _, place in pairs}) == 4
    assert (table.units.estimand, table.units.count) == (Estimand.LISTED_GRID, 8)


def test_a_row_knows_its_block_and_equal_blocks_of_runs_are_one(rows, parameters):
    two, other = Design((("grid", 3), ("grid", 5)), site=1), Design((("random", 8),), site=1)
    table = of_designs(rows, parameters, a=two, b=other, c=Design(two.blocks, site=2))
    variants, runs = table.numbers("variant_index"), table.codes("run_id")
    for run in "ac":
        assert table.blocks[runs.where(run)].tolist() == (variants[runs.where(run)] >= 3).tolist()
    assert set(table.blocks[runs.where("b")].tolist()) == {2}


def test_suns_and_headings_are_no_further_places(rows, parameters):
    suns = [{**row, "scene.sun-1.azimuth": float(sun), "variant_index": 8 * sun + row["variant_index"]}
            for sun in range(2) for row in rows]  # fmt: skip
    table = of_designs(suns, {**parameters, "scene.sun-1.azimuth": "ANGLE"}, r=Design((("grid", 16),)))

    assert table.places.max() + 1 == 4


def test_where_no_person_moves_other_positions_make_the_place(rows):
    for row in rows:
        row["scene.car-1.pos.y"] = row.pop("scene.person-1.pos.y")
        del row["scene.person-1.pos.x"]
    types = {"scene.person-1.character": "CATEGORICAL", "scene.car-1.pos.y": "FLOAT"}

    assert of_designs(rows, types, r=Design((("grid", 8),))).places.max() + 1 == 2


@pytest.mark.parametrize("design", ["random", "sobol", "halton", "latin_hypercube"])
def test_a_drawn_variant_is_a_place_and_a_unit(rows, parameters, design):
    table = of_designs(rows, parameters, r=Design(((design, 8),)))
    variants = {row["variant_index"] for row in rows}

    assert table.places.max() + 1 == table.units.count == len(variants) == 8
    assert table.units.estimand is Estimand.DESIGN_BOX


def test_designs_that_are_drawn_together_know_their_replicates(synthetic, parameters):
    rows = synthetic(lambda *_: 0.5, xs=[0.0], ys=np.arange(5.0, 105.0).tolist(), characters=("one",))
    table = of_designs(rows, parameters, r=Design((("sobol", 60), ("latin_hypercube", 40))))
    expected = np.concatenate([replicates(60), 8 + replicates(40)])

    np.testing.assert_array_equal(table.units.replicate, expected)
    assert table.units.replicate.max() + 1 == 16


def test_a_list_repeated_on_several_sites_is_a_sample_of_sites(rows, parameters):
    grid = (("grid", 8),)
    table = of_designs(rows, parameters, a=Design(grid, site=1), b=Design(grid, site=2), c=Design(grid, site=2))

    assert (table.units.estimand, table.units.count) == (Estimand.SITES, 2)
    np.testing.assert_array_equal(table.places, np.repeat([0, 1, 1], len(rows)))


def test_a_list_beside_a_drawn_design_is_no_sample(rows, parameters):
    table = of_designs(rows, parameters, r=Design((("random", 4), ("grid", 4))))

    assert table.units.estimand is Estimand.LISTED_GRID
    assert table.places.max() + 1 == 4 + 2  # four drawn variants, two positions of the grid


def test_of_an_unknown_design_each_variant_is_a_place_and_nothing_is_a_sample(rows, parameters):
    table = EvaluationTable.from_rows(rows, parameters)

    assert table.places.max() + 1 == 8
    assert table.units.estimand is Estimand.LISTED_GRID


def test_tables_of_runs_on_several_sites_join_to_a_sample_of_sites(rows, parameters):
    def of_site(site):
        renamed = [{**row, "run_id": f"r{site}"} for row in rows]
        return EvaluationTable.from_rows(renamed, parameters, {f"r{site}": Design((("grid", 8),), site=site)})

    joined = EvaluationTable.joined([of_site(site) for site in range(6)])

    assert len(joined) == 6 * len(rows)
    assert (joined.units.estimand, joined.units.count) == (Estimand.SITES, 6)
    assert joined.codes("run_id").names == tuple(f"r{site}" for site in range(6))
    with pytest.raises(InvalidInput, match="different parameters"):
        EvaluationTable.joined([of_site(0), EvaluationTable.from_rows([], {})])


def test_the_designs_survive_parquet(rows, parameters):
    table = of_designs(rows, parameters, a=Design((("random", 4), ("grid", 4)), site=1), b=Design((("sobol", 8),)))
    sink = io.BytesIO()
    table.to_parquet(sink)
    sink.seek(0)

    assert EvaluationTable.from_parquet(sink).designs == table.designs


def test_combine_tells_tuples_apart_as_python_does():
    generator = np.random.default_rng(5)
    keys = [generator.integers(0, 7, 500), generator.choice([0.5, np.nan, -1.0], 500), generator.integers(-3, 3, 500)]
    combined = combine(keys)
    tuples = [tuple(None if np.isnan(v) else float(v) for v in row) for row in zip(*keys, strict=True)]

    assert len(set(zip(tuples, combined.tolist(), strict=True))) == len(set(tuples)) == combined.max() + 1
