import pytest

from valerie.analysis.report.examples import choose_examples
from valerie.analysis.rows.table import EvaluationTable


@pytest.fixture
def rows(synthetic):
    grid = synthetic(lambda *_: 0.6, xs=[0.0, 1.0], ys=[5.0, 9.0])
    for row in grid:
        row["occlusion_rate"] = 0.02
    return grid


def change(rows, frame, **values):
    """Change values in the rows of a frame; ``pacc`` may be a mapping from function to value."""
    for row in rows:
        if row["frame_id"] == frame:
            pacc = values.get("pacc", row["pacc"])
            pacc = pacc[row["function"]] if isinstance(pacc, dict) else pacc
            row |= {**values, "pacc": pacc}


def test_the_extremes_are_chosen_and_named(rows, parameters):
    change(rows, "000001-0", pacc=0.99)
    change(rows, "000002-0", pacc=0.05)
    change(rows, "000003-0", pacc=0.01, occlusion_rate=0.5)
    change(rows, "000004-0", pacc=0.3, occlusion_rate=0.9)
    change(rows, "000005-0", pacc={"a-net": 0.95, "b-net": 0.1})
    examples = {e.title: e for e in choose_examples(EvaluationTable.from_rows(rows, parameters))}

    assert {title: e.frame_id for title, e in examples.items()} == {
        "Best seen": "000001-0",
        "Worst in plain sight": "000002-0",
        "Worst of all": "000003-0",
        "Most occluded": "000004-0",
        "Most disputed": "000005-0",
    }
    assert examples["Most disputed"].pacc == {"a-net": 0.95, "b-net": 0.1}


def test_examples_have_a_time_only_in_runs_of_several_moments(rows, parameters):
    still = choose_examples(EvaluationTable.from_rows(rows, parameters))
    assert not any("time_s" in example.measures for example in still)
    change(rows, "000001-0", pacc=0.99, time_s=0.75)
    examples = choose_examples(EvaluationTable.from_rows(rows, parameters))
    assert [example.measures["time_s"] for example in examples if example.title == "Best seen"] == [0.75]


def test_no_frame_is_shown_twice(rows, parameters):
    frames = [e.frame_id for e in choose_examples(EvaluationTable.from_rows(rows, parameters))]

    assert len(frames) == len(set(frames)) >= 3


def test_a_person_without_pacc_is_no_example(rows, parameters):
    change(rows, "000001-0", pacc=None, undefined_reason="fully hidden", occlusion_rate=1.0)
    frames = [e.frame_id for e in choose_examples(EvaluationTable.from_rows(rows, parameters))]

    assert "000001-0" not in frames


def test_without_defined_persons_there_are_no_examples(parameters):
    assert choose_examples(EvaluationTable.from_rows([], parameters)) == ()


def test_examples_name_the_light(rows, parameters):
    change(rows, "000001-0", pacc=0.99, sun_elevation_deg=-3.0)
    (best, *_) = choose_examples(EvaluationTable.from_rows(rows, parameters))
    assert best.measures["sun_elevation_deg"] == -3.0
