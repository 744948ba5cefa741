import pytest

from valerie.analysis.findings.importance import explanations
from valerie.analysis.rows.table import EvaluationTable


def test_each_function_is_explained_by_what_its_scores_follow(dropping_table):
    results = {explanation.function: explanation for explanation in explanations(dropping_table)}

    # a-net falls with the distance, which the position along the street sets; b-net looks at the clothes alone.
    assert results["a-net"].shares[0].factor == "person-1.pos.y"
    assert results["a-net"].measured[0].column == "distance_m"
    assert results["a-net"].measured[0].p_value < 0.001
    assert results["b-net"].shares[0].factor == "person-1.character"
    assert results["b-net"].shares[0].total == pytest.approx(0.0025 / (0.0025 + 0.0009), abs=0.1)
    assert not any(column.named for column in results["b-net"].measured)


def test_a_column_that_some_persons_lack_takes_no_part(dropping_table):
    results = explanations(dropping_table)
    assert "irradiance" not in {column.column for result in results for column in result.measured}


def test_a_function_without_scores_is_not_explained(parameters):
    assert explanations(EvaluationTable.from_rows([], parameters)) == ()
